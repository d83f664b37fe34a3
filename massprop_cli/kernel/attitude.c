/* Filters of logged attitudes (massprop_cli/prepare/attitudefilter.py): the same equations, cycle by cycle. Both carry an error whose first
 * three states turn with the body, x' = [A B; 0 I] x, with A and B (3, 3) side by side; all other states stay. */
#include <math.h>
#include <string.h>

#include "host.h"
#include "linalg.h"

SHARED void mp_host_reference_attitude(long count, const double *turn, const double *white, const double *vectors, const double *duration,
                             const double *variance, const long *edges, const double *logged, const double *share, const double *uneven,
                             double *spread, double *attitude, double *drawn);
SHARED double mp_host_reference_error(long count, const double *turn, const double *white, const double *drive, const double *observation,
                                     const double *offset, const double *sigma, double *states, double *each);

static void product(const double a[4], const double b[4], double out[4]) {
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    out[2] = a[0] * b[2] + a[2] * b[0] + a[3] * b[1] - a[1] * b[3];
    out[3] = a[0] * b[3] + a[3] * b[0] + a[1] * b[2] - a[2] * b[1];
}

static void of_vector(const double vector[3], double out[4]) {
    double half = 0.5 * sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
    double by = half > 0 ? 0.5 * sin(half) / half : 0.5;
    int i;
    out[0] = cos(half);
    for (i = 0; i < 3; i++) out[i + 1] = by * vector[i];
}

static void vector_of(const double q[4], double out[3]) {
    double sine = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3]), by = sine > 0 ? 2 * atan2(sine, fabs(q[0])) / sine : 2.0;
    int i;
    for (i = 0; i < 3; i++) out[i] = (q[0] < 0 ? -by : by) * q[i + 1];
}

/* The inverse of a symmetric (3, 3). */
static void inverse(const double *a, double out[9]) {
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            const double *p = a + 3 * ((j + 1) % 3), *q = a + 3 * ((j + 2) % 3);
            out[3 * i + j] = p[(i + 1) % 3] * q[(i + 2) % 3] - p[(i + 2) % 3] * q[(i + 1) % 3];
        }
    {
        double determinant = a[0] * out[0] + a[1] * out[3] + a[2] * out[6];
        for (i = 0; i < 9; i++) out[i] /= determinant;
    }
}

/* spread (n, n) becomes F spread F' + white; turn (3, 6) is [A B]. */
static void carried(int n, const double *turn, const double *white, double *spread) {
    double rows[3 * 10];
    int i, j, k;
    for (i = 0; i < 3; i++)
        for (j = 0; j < n; j++) {
            rows[i * n + j] = 0;
            for (k = 0; k < 6; k++) rows[i * n + j] += turn[6 * i + k] * spread[k * n + j];
        }
    memcpy(spread, rows, (size_t)(3 * n) * sizeof rows[0]);
    for (i = 0; i < n; i++) {
        double row[3];
        for (j = 0; j < 3; j++) {
            row[j] = 0;
            for (k = 0; k < 6; k++) row[j] += spread[i * n + k] * turn[6 * j + k];
        }
        memcpy(spread + i * n, row, sizeof row);
    }
    for (i = 0; i < n * n; i++) spread[i] += white[i];
}

/* spread (n, n) less by the inverse of what was measured times by', kept symmetric; gain (n, 3) = by times that. */
static void conditioned(int n, const double *by, const double *inverted, double *gain, double *spread) {
    int i, j, k;
    for (i = 0; i < n; i++)
        for (j = 0; j < 3; j++) {
            gain[3 * i + j] = 0;
            for (k = 0; k < 3; k++) gain[3 * i + j] += by[3 * i + k] * inverted[3 * k + j];
        }
    for (i = 0; i < n; i++)
        for (j = 0; j <= i; j++) {
            double less = 0;
            for (k = 0; k < 3; k++) less += gain[3 * i + k] * by[3 * j + k];
            spread[i * n + j] = spread[j * n + i] = (spread[i * n + j] + spread[j * n + i]) / 2 - less;
        }
}

/* The mean error that a cycle's logged attitudes show of a reference that is `here` at its start and turns by `vector`. */
static void shown(const double here[4], const double *vector, long from, long to, const double *logged, const double *share,
                  const double *uneven, double out[3]) {
    long m;
    int i;
    out[0] = out[1] = out[2] = 0;
    for (m = from; m < to; m++) {
        double partly[3], turned[4], path[4], apart[4], one[3];
        for (i = 0; i < 3; i++) partly[i] = uneven[3 * m + i] + share[m] * vector[i];
        of_vector(partly, turned);
        product(here, turned, path);
        for (i = 1; i < 4; i++) path[i] = -path[i];
        product(path, logged + 4 * m, apart);
        vector_of(apart, one);
        for (i = 0; i < 3; i++) out[i] += one[i] / (double)(to - from);
    }
}

/* white (K, 6, 6), edges (K + 1) of what is logged (m, 4); spread (6, 6) as it begins; attitude (K + 1, 4), whose first is given. */
void mp_host_reference_attitude(long count, const double *turn, const double *white, const double *vectors, const double *duration,
                      const double *variance, const long *edges, const double *logged, const double *share, const double *uneven,
                      double *spread, double *attitude, double *drawn) {
    double bias[3] = {0, 0, 0};
    long k;
    int i, j;
    for (k = 0; k < count; k++) {
        double vector[3], onward[4], whole[3], size = 0, *here = attitude + 4 * k, *next = here + 4;
        for (i = 0; i < 3; i++) vector[i] = vectors[3 * k + i] - bias[i] * duration[k];
        carried(6, turn + 18 * k, white + 36 * k, spread);
        of_vector(vector, onward);
        if (edges[k] < edges[k + 1]) {
            double residual[3], by[18], measured[9], inverted[9], gain[18], moved[6], turned[4], both[4];
            shown(here, vector, edges[k], edges[k + 1], logged, share, uneven, residual);
            for (i = 0; i < 6; i++) memcpy(by + 3 * i, spread + 6 * i, 3 * sizeof by[0]);
            for (i = 0; i < 9; i++) measured[i] = by[i] + (i % 4 == 0 ? variance[k] : 0);
            inverse(measured, inverted);
            conditioned(6, by, inverted, gain, spread);
            for (i = 0; i < 6; i++) moved[i] = gain[3 * i] * residual[0] + gain[3 * i + 1] * residual[1] + gain[3 * i + 2] * residual[2];
            for (i = 0; i < 3; i++) bias[i] += moved[3 + i];
            of_vector(moved, turned);
            product(onward, turned, both);
            memcpy(onward, both, sizeof both);
        }
        vector_of(onward, whole);
        for (i = 0; i < 3; i++) drawn[3 * k + i] = whole[i] - vectors[3 * k + i];
        product(here, onward, next);
        for (j = 0; j < 4; j++) size += next[j] * next[j];
        for (j = 0; j < 4; j++) next[j] /= sqrt(size);
    }
}

/* white (K, 10, 10), observation (K, 3, 10), offset (K, 3), sigma (K) infinite where none; of states (K + 1, 10) and their covariance
 * each (K + 1, 10, 10) the first are given. The chi-square of the innovations. */
double mp_host_reference_error(long count, const double *turn, const double *white, const double *drive, const double *observation,
                              const double *offset, const double *sigma, double *states, double *each) {
    double chi_square = 0;
    long k;
    int i, j, l;
    for (k = 0; k < count; k++) {
        const double *own = observation + 30 * k, *by_turn = turn + 18 * k;
        double *state = states + 10 * (k + 1), *spread = each + 100 * (k + 1);
        memcpy(state, state - 10, 10 * sizeof state[0]);
        memcpy(spread, spread - 100, 100 * sizeof spread[0]);
        if (sigma[k] - sigma[k] == 0) {
            double residual[3], by[30], measured[9], inverted[9], gain[30];
            for (i = 0; i < 10; i++)
                for (j = 0; j < 3; j++) {
                    by[3 * i + j] = 0;
                    for (l = 0; l < 10; l++) by[3 * i + j] += spread[10 * i + l] * own[10 * j + l];
                }
            for (i = 0; i < 3; i++) {
                residual[i] = offset[3 * k + i];
                for (l = 0; l < 10; l++) residual[i] -= own[10 * i + l] * state[l];
                for (j = 0; j < 3; j++) {
                    measured[3 * i + j] = i == j ? sigma[k] * sigma[k] : 0;
                    for (l = 0; l < 10; l++) measured[3 * i + j] += own[10 * i + l] * by[3 * l + j];
                }
            }
            inverse(measured, inverted);
            conditioned(10, by, inverted, gain, spread);
            for (i = 0; i < 3; i++)
                for (j = 0; j < 3; j++) chi_square += residual[i] * inverted[3 * i + j] * residual[j];
            for (i = 0; i < 10; i++)
                for (j = 0; j < 3; j++) state[i] += gain[3 * i + j] * residual[j];
        }
        {
            double turned[3];
            for (i = 0; i < 3; i++) {
                turned[i] = -drive[3 * k + i];
                for (l = 0; l < 6; l++) turned[i] += by_turn[6 * i + l] * state[l];
            }
            memcpy(state, turned, sizeof turned);
        }
        carried(10, by_turn, white + 100 * k, spread);
    }
    return chi_square;
}
