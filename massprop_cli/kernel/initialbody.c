/* Where fits of hypotheses begin: with the body that plain regression of motion on commands gives, for the ground:
 * massprop_cli/diagnosis/initialbody.py, which has it in NumPy as well. */
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "host.h"
#include "linalg.h"
#include "hypothesis.h"

#define PLAIN 27 /* three coefficients of each axis: of torque and of force or the vertical on the rate, of force on specific force */
#define SUM 1e-9 /* part of a column that those before it leave of it, below which it is their sum */
#define NOWHERE (-1)
#define LEAST 0.03
#define FARTHEST 0.3

SHARED int mp_host_plain(const long *sizes, const long *places, const double *numbers, const double *const *triangles, const double *x,
                         const unsigned char *suspects, double *room, double *plain);
SHARED int mp_host_initial_bodies(const long *sizes, const long *places, const double *numbers, const double *const *triangles,
                         const double *turns, const double *plain, double *x, double *spreads);

/* Least squares of what was measured on `count` columns of `rows` that stand one behind the other in `a`, and behind them the three that
 * were measured; the first `wanted` coefficients (wanted, 3), six at most. A column that those before it are the sum of has none, nor one
 * that is nothing beside its parts: `sums` are squares of the size of these, of the first three columns and of the second. */
static void regressed(double *a, long rows, long count, int wanted, const double *sums, double *out) {
    double *measured = a + count * rows;
    long j, k, r, kept = 0, place[6];
    int axis;
    for (j = 0; j < count; j++) { /* Householder (1958) */
        double *own = a + kept * rows, whole = 0.0, norm = 0.0, square;
        if (kept < j) memcpy(own, a + j * rows, (size_t)rows * sizeof own[0]);
        for (r = 0; j >= 6 && r < rows; r++) whole += own[r] * own[r];
        if (j < 6) whole = sums[j / 3];
        for (r = kept; r < rows; r++) norm += own[r] * own[r];
        if (j < wanted) place[j] = norm > SUM * SUM * whole ? kept : NOWHERE;
        if (!(norm > SUM * SUM * whole)) continue;
        norm = own[kept] > 0.0 ? -sqrt(norm) : sqrt(norm);
        own[kept] -= norm;
        square = -norm * own[kept]; /* half of the vector's */
        for (k = j + 1; k < count + 3; k++) {
            double *other = a + k * rows, along = 0.0;
            for (r = kept; r < rows; r++) along += own[r] * other[r];
            along /= square;
            for (r = kept; r < rows; r++) other[r] -= along * own[r];
        }
        own[kept++] = norm; /* the diagonal; what is below it isn't read again */
    }
    for (axis = 0; axis < 3; axis++, measured += rows) {
        for (k = kept - 1; k >= 0; k--) {
            for (j = k + 1; j < kept; j++) measured[k] -= a[j * rows + k] * measured[j];
            measured[k] /= a[k * rows + k];
        }
        for (k = 0; k < wanted; k++) out[3 * k + axis] = place[k] == NOWHERE ? 0.0 : measured[place[k]];
    }
}

/* A triangle times a sum of its columns. */
static void add_column(const mp_sensor *told, long column, double by, double *out) {
    const double *own = told->triangle + column * told->rows;
    long r, end = column < told->rows ? column + 1 : told->rows;
    for (r = 0; by != 0.0 && r < end; r++) out[r] += by * own[r];
}

static long precession_of(const mp_hypotheses *about, long channel) {
    return about->places[HYPOTHESIS_PRECESSION] + HYPOTHESIS_PER_AXIS * (channel - about->thrusting);
}

/* To (3) columns along each axis, what a channel's momentum does that turns with the body. */
static void add_precession(const mp_hypotheses *about, const mp_sensor *told, long channel, const double *torque, double *out) {
    double turned[3][3];
    int i, k;
    mp_hypothesis_precession(torque, turned);
    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++) add_column(told, precession_of(about, channel) + k, turned[i][k], out + i * told->rows);
}

/* (3) columns of sums of the channels: along each axis of what those give that nobody suspects. What all of them make alone, squared. */
static double add_sums(const mp_hypotheses *about, const mp_sensor *told, const double *given, const unsigned char *suspects, double *out) {
    double all = 0.0;
    long c, r;
    int i;
    for (c = 0; c < about->channels; c++) {
        const double *own = told->triangle + (about->places[HYPOTHESIS_CHANNELS] + c) * told->rows;
        double square = 0.0;
        for (r = 0; r < told->rows; r++) square += own[r] * own[r];
        for (i = 0; i < 3; i++) {
            all += given[3 * c + i] * given[3 * c + i] * square;
            add_column(told, about->places[HYPOTHESIS_CHANNELS] + c, suspects[c] ? 0.0 : given[3 * c + i], out + i * told->rows);
        }
        if (c >= about->thrusting && !suspects[c]) add_precession(about, told, c, given + 3 * c, out);
    }
    return all;
}

/* Of one hypothesis, the columns that a sensor's motion is regressed on: `first` and `second` (channels, 3) times the channels, the
 * second of them perhaps the vertical; the suspected channels alone; the products of rates; and the vertical where it is felt. */
static void plain_of(const mp_hypotheses *about, const mp_sensor *told, const double *first, const double *second, const unsigned char *suspects,
                     int felt, double *room, double *out) {
    long channels = about->places[HYPOTHESIS_CHANNELS], p = told->rows, suspected = 0, count, at, c;
    long up = about->pivoted ? about->places[HYPOTHESIS_UP] : -1;
    double sums[2] = {0.0, 0.0};
    int i;
    for (c = 0; c < about->channels; c++) suspected += suspects[c] ? 1 + 3 * (c >= about->thrusting) : 0;
    count = 12 + suspected + (felt && up >= 0 ? 3 : 0);
    memset(room, 0, (size_t)(p * (count + 3)) * sizeof room[0]);
    sums[0] = add_sums(about, told, first, suspects, room);
    if (second != NULL) sums[1] = add_sums(about, told, second, suspects, room + 3 * p);
    for (i = 0; second == NULL && i < 3; i++) add_column(told, up + i, 1.0, room + (3 + i) * p);
    for (c = 0; second == NULL && c < 3 * p; c++) sums[1] += room[3 * p + c] * room[3 * p + c];
    at = 6;
    for (c = 0; c < about->channels; c++)
        if (suspects[c]) {
            add_column(told, channels + c, 1.0, room + at++ * p);
            for (i = 0; c >= about->thrusting && i < 3; i++) add_column(told, precession_of(about, c) + i, 1.0, room + at++ * p);
        }
    for (i = 0; i < 6; i++) add_column(told, about->places[HYPOTHESIS_PRODUCTS] + i, 1.0, room + at++ * p);
    for (i = 0; felt && up >= 0 && i < 3; i++) add_column(told, up + i, 1.0, room + at++ * p);
    for (i = 0; i < 3; i++) memcpy(room + (count + i) * p, told->measured + i * p, (size_t)p * sizeof room[0]);
    regressed(room, p, count, felt ? 3 : 6, sums, out);
}

/* plain (H, 27) of x (H, entries) where suspects (H, channels) have a response of their own.
 * room: 6 channels + columns (4 channels + 18). */
int mp_host_plain(const long *sizes, const long *places, const double *numbers, const double *const *triangles, const double *x,
                  const unsigned char *suspects, double *room, double *plain) {
    static const double origin[3] = {0.0, 0.0, 0.0};
    mp_hypotheses about;
    mp_sensor sensors[2];
    long h, c;
    mp_hypotheses_of(sizes, places, numbers, &about);
    mp_sensors_of(sizes, triangles, sensors);
    for (h = 0; h < sizes[0]; h++) {
        double *torque = room, *force = torque + 3 * about.channels, *rest = force + 3 * about.channels, *own = plain + h * PLAIN;
        const unsigned char *suspected = suspects + h * about.channels;
        for (c = 0; c < about.channels; c++)
            mp_hypothesis_wrench(&about, x + h * about.entries, c, about.pivoted ? about.bearing : origin, force + 3 * c, torque + 3 * c);
        plain_of(&about, sensors, torque, about.pivoted ? NULL : force, suspected, 0, rest, own);
        plain_of(&about, sensors + 1, force, torque, suspected, 1, rest, own + 18);
    }
    return MP_OK;
}

/* x (H, entries) with the body that plain (H, 27) makes, and spreads (H, 10) the sizes of the body's entries; turns (H, 2, 3, 3). */
int mp_host_initial_bodies(const long *sizes, const long *places, const double *numbers, const double *const *triangles, const double *turns,
                  const double *plain, double *x, double *spreads) {
    mp_hypotheses about;
    long h;
    (void)triangles;
    mp_hypotheses_of(sizes, places, numbers, &about);
    for (h = 0; h < sizes[0]; h++) {
        const double *own = plain + h * PLAIN, *felt = own + 18;
        double *body = x + h * about.entries, *spread = spreads + h * 10;
        double gain[3][3], turn[3][3], base[3][3], back[3][3], response[3][6], turned[3][6], inverted[3][3], inertia[3][3], lever[3][3];
        double top = 1e-12, largest = 0.0, along = 0.0, mu, size = 0.0, length, vector[3];
        mp_real half[3][3], principal[3], axes[3][3];
        int s, i, j, k, element = 0;
        for (i = 0; i < 3; i++)
            for (k = 0; k < 6; k++) response[i][k] = own[3 * k + i];
        for (s = 0; s < 2; s++) {
            mp_hypothesis_gain(&about, body, s, gain);
            memcpy(base, turns + 18 * h + 9 * s, sizeof base);
            mp_hypothesis_product(gain, base[0], 3, turn[0]);
            mp_hypothesis_inverse(turn, back);
            if (s == 0) mp_hypothesis_product(back, response[0], 6, turned[0]);
        }
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) {
                half[i][j] = (mp_real)((turned[i][j] + turned[j][i]) / 2);
                along += back[i][j] * felt[3 * i + j] / 3; /* the trace of the response turned back, of which coefficient i is of force i */
                largest = fabs(felt[3 * i + j]) > largest ? fabs(felt[3 * i + j]) : largest;
            }
        mp_eigen((const mp_real(*)[3])half, principal, axes);
        for (k = 0; k < 3; k++) top = fabs((double)principal[k]) > top ? fabs((double)principal[k]) : top;
        memset(inverted, 0, sizeof inverted);
        for (k = 0; k < 3; k++) {
            double value = (double)principal[k] > LEAST * top ? (double)principal[k] : LEAST * top;
            size += 1.0 / value;
            for (i = 0; i < 3; i++)
                for (j = 0; j < 3; j++) inverted[i][j] += (double)axes[i][k] * value * (double)axes[j][k];
        }
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) base[i][j] = turned[i][3 + j];
        mp_hypothesis_inverse(inverted, inertia);
        mp_hypothesis_product(inertia, base[0], 3, lever[0]);
        mu = along > LEAST * largest ? along : LEAST * largest;
        mu = mu > 1e-9 ? mu : 1e-9;
        size = sqrt(size * mu) / (about.pivoted ? mu : 1.0);
        for (i = 0; i < 3; i++) { /* on a bearing the first moment instead of the CG */
            int next = (i + 1) % 3, last = (i + 2) % 3;
            vector[i] = -(lever[last][next] - lever[next][last]) / 2 / (about.pivoted ? about.gravity : 1.0);
        }
        length = sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
        length = length > 1e-12 ? length : 1e-12;
        for (i = 0; i < 3; i++) {
            body[6 + i] = vector[i] * (FARTHEST * size < length ? FARTHEST * size / length : 1.0);
            for (j = i; j < 3; j++) body[element++] = inverted[i][j];
            spread[6 + i] = size;
        }
        for (i = 0; i < 6; i++) spread[i] = top;
        body[HYPOTHESIS_MU] = spread[9] = mu;
    }
    return MP_OK;
}
