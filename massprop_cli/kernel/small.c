#include "small.h"

#include <math.h>

mp_real mp_max(mp_real a, mp_real b) { return a > b ? a : b; }
mp_real mp_min(mp_real a, mp_real b) { return a < b ? a : b; }
mp_real mp_abs(mp_real a) { return a < R(0) ? -a : a; }

int mp_finite(const mp_real *v, int count) {
    int i, fine = 1;
    for (i = 0; i < count; i++) fine &= v[i] - v[i] == R(0);
    return fine;
}

mp_real mp_dot(const mp_real a[3], const mp_real b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

void mp_cross(const mp_real a[3], const mp_real b[3], mp_real out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

void mp_cross_matrix(const mp_real v[3], mp_real out[3][3]) {
    out[0][0] = out[1][1] = out[2][2] = R(0);
    out[0][1] = -v[2];
    out[0][2] = v[1];
    out[1][0] = v[2];
    out[1][2] = -v[0];
    out[2][0] = -v[1];
    out[2][1] = v[0];
}

void mp_times(const mp_real a[3][3], const mp_real v[3], mp_real out[3]) {
    int i;
    for (i = 0; i < 3; i++) out[i] = mp_dot(a[i], v);
}

void mp_product(const mp_real a[3][3], const mp_real b[3][3], mp_real out[3][3]) {
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) out[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
}

void mp_inverse(const mp_real a[3][3], mp_real out[3][3]) {
    mp_real cofactors[3][3], determinant;
    int i, j;
    mp_cross(a[1], a[2], cofactors[0]);
    mp_cross(a[2], a[0], cofactors[1]);
    mp_cross(a[0], a[1], cofactors[2]);
    determinant = mp_dot(a[0], cofactors[0]);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) out[i][j] = cofactors[j][i] / determinant;
}

void mp_rotations(const mp_real vector[3], mp_real whole[3][3], mp_real mean[3][3]) {
    mp_real square = mp_dot(vector, vector), term = R(1), sum[3] = {R(0), R(0), R(0)}, turn[3][3], twice[3][3];
    int i, j, k;
    /* sin a / a, (1 - cos a) / a^2 and (a - sin a) / a^3 */
    for (k = 0; k <= TERMS; k++) {
        sum[0] += term;
        sum[1] += term / R(2 * k + 2);
        sum[2] += term / R((2 * k + 2) * (2 * k + 3));
        term *= -square / R((2 * k + 2) * (2 * k + 3));
    }
    mp_cross_matrix(vector, turn);
    mp_product((const mp_real(*)[3])turn, (const mp_real(*)[3])turn, twice);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            whole[i][j] = (i == j ? R(1) : R(0)) + sum[0] * turn[i][j] + sum[1] * twice[i][j];
            mean[i][j] = (i == j ? R(1) : R(0)) + sum[1] * turn[i][j] + sum[2] * twice[i][j];
        }
}

void mp_tensor(const mp_real six[6], mp_real out[3][3]) {
    out[0][0] = six[0];
    out[0][1] = out[1][0] = six[1];
    out[0][2] = out[2][0] = six[2];
    out[1][1] = six[3];
    out[1][2] = out[2][1] = six[4];
    out[2][2] = six[5];
}

void mp_elements(const mp_real a[3][3], mp_real six[6]) {
    six[0] = a[0][0];
    six[1] = a[0][1];
    six[2] = a[0][2];
    six[3] = a[1][1];
    six[4] = a[1][2];
    six[5] = a[2][2];
}

/* One plane rotation that clears a[p][q]. */
static void turned(mp_real a[3][3], mp_real axes[3][3], int p, int q) {
    mp_real off = a[p][q], ratio, t, c, s;
    int i;
    if (mp_abs(off) <= MP_EPSILON * R(0.01) * (mp_abs(a[p][p]) + mp_abs(a[q][q]))) {
        a[p][q] = a[q][p] = R(0);
        return;
    }
    ratio = (a[q][q] - a[p][p]) / (off + off);
    if (!mp_finite(&ratio, 1)) {
        a[p][q] = a[q][p] = R(0);
        return;
    }
    t = (ratio < R(0) ? R(-1) : R(1)) / (mp_abs(ratio) + MP_SQRT(ratio * ratio + R(1)));
    c = R(1) / MP_SQRT(t * t + R(1));
    s = t * c;
    for (i = 0; i < 3; i++) {
        mp_real x = a[i][p], y = a[i][q];
        a[i][p] = c * x - s * y;
        a[i][q] = s * x + c * y;
    }
    for (i = 0; i < 3; i++) {
        mp_real x = a[p][i], y = a[q][i], u = axes[i][p], v = axes[i][q];
        a[p][i] = c * x - s * y;
        a[q][i] = s * x + c * y;
        axes[i][p] = c * u - s * v;
        axes[i][q] = s * u + c * v;
    }
    a[p][q] = a[q][p] = R(0);
}

void mp_eigen(const mp_real given[3][3], mp_real values[3], mp_real axes[3][3]) {
    mp_real a[3][3];
    int i, j, sweep;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            a[i][j] = given[i][j];
            axes[i][j] = i == j ? R(1) : R(0);
        }
    for (sweep = 0; sweep < 8; sweep++) {
        turned(a, axes, 0, 1);
        turned(a, axes, 0, 2);
        turned(a, axes, 1, 2);
    }
    for (i = 0; i < 3; i++) values[i] = a[i][i];
    for (i = 0; i < 2; i++)
        for (j = 0; j < 2 - i; j++)
            if (values[j] > values[j + 1]) {
                int k;
                mp_real kept = values[j];
                values[j] = values[j + 1];
                values[j + 1] = kept;
                for (k = 0; k < 3; k++) {
                    kept = axes[k][j];
                    axes[k][j] = axes[k][j + 1];
                    axes[k][j + 1] = kept;
                }
            }
}

int mp_cholesky(mp_real *a, int n) {
    int i, j, k;
    for (j = 0; j < n; j++) {
        for (i = j; i < n; i++) {
            mp_real sum = a[i * n + j];
            for (k = 0; k < j; k++) sum -= a[i * n + k] * a[j * n + k];
            if (i == j) {
                if (!(sum > R(0))) return 0;
                a[j * n + j] = MP_SQRT(sum);
            } else {
                a[i * n + j] = sum / a[j * n + j];
            }
        }
        for (i = 0; i < j; i++) a[i * n + j] = R(0);
    }
    return 1;
}

void mp_solved(const mp_real *a, int n, mp_real *b) {
    int i, j;
    for (i = 0; i < n; i++) {
        for (j = 0; j < i; j++) b[i] -= a[i * n + j] * b[j];
        b[i] /= a[i * n + i];
    }
    for (i = n - 1; i >= 0; i--) {
        for (j = i + 1; j < n; j++) b[i] -= a[j * n + i] * b[j];
        b[i] /= a[i * n + i];
    }
}

/* One column's reflection of six rows, which is nearly all that a cycle folds, in one sweep. */
static void reflect6(mp_real *restrict own, mp_real *restrict rows, int size, int from, const mp_real part[6], mp_real tau) {
    mp_real *restrict r0 = rows, *restrict r1 = rows + size, *restrict r2 = rows + 2 * size;
    mp_real *restrict r3 = rows + 3 * size, *restrict r4 = rows + 4 * size, *restrict r5 = rows + 5 * size;
    const mp_real p0 = part[0], p1 = part[1], p2 = part[2], p3 = part[3], p4 = part[4], p5 = part[5];
    int c;
    for (c = from; c < size; c++) {
        mp_real sum = (own[c] + p0 * r0[c] + p1 * r1[c] + p2 * r2[c] + p3 * r3[c] + p4 * r4[c] + p5 * r5[c]) * tau;
        own[c] -= sum;
        r0[c] -= p0 * sum;
        r1[c] -= p1 * sum;
        r2[c] -= p2 * sum;
        r3[c] -= p3 * sum;
        r4[c] -= p4 * sum;
        r5[c] -= p5 * sum;
    }
}

/* The same of any number of rows. */
static void reflect(mp_real *own, mp_real *rows, int size, int count, int column, mp_real over, mp_real tau) {
    mp_real sum[MP_WIDTH];
    int i, c;
    for (c = column + 1; c < size; c++) sum[c] = own[c];
    for (i = 0; i < count; i++) {
        const mp_real *row = rows + i * size;
        mp_real part = row[column] * over;
        if (part == R(0)) continue;
        for (c = column + 1; c < size; c++) sum[c] += part * row[c];
    }
    for (c = column + 1; c < size; c++) sum[c] *= tau;
    for (c = column + 1; c < size; c++) own[c] -= sum[c];
    for (i = 0; i < count; i++) {
        mp_real *row = rows + i * size;
        mp_real part = row[column] * over;
        if (part == R(0)) continue;
        for (c = column + 1; c < size; c++) row[c] -= part * sum[c];
    }
}

void mp_fold(mp_real *triangle, int size, mp_real *rows, int count) {
    int j, i;
    for (j = 0; j < size; j++) {
        mp_real *own = triangle + AT(size, j) - j;
        mp_real power = R(0), alpha, beta, over, tau, part[6];
        for (i = 0; i < count; i++) power += rows[i * size + j] * rows[i * size + j];
        if (power == R(0)) continue;
        alpha = own[j];
        beta = MP_SQRT(alpha * alpha + power);
        if (alpha > R(0)) beta = -beta;
        over = R(1) / (alpha - beta);
        tau = (beta - alpha) / beta;
        own[j] = beta;
        if (count == 6) {
            for (i = 0; i < 6; i++) part[i] = rows[i * size + j] * over;
            reflect6(own, rows, size, j + 1, part, tau);
        } else {
            reflect(own, rows, size, count, j, over, tau);
        }
    }
}

void mp_lower(mp_real *a, int rows, int columns) {
    int i, r, c;
    for (i = 0; i < rows; i++) {
        mp_real *own = a + i * columns;
        mp_real power = R(0), alpha = own[i], beta, over, tau;
        for (c = i + 1; c < columns; c++) power += own[c] * own[c];
        if (power > R(0)) {
            beta = MP_SQRT(alpha * alpha + power);
            if (alpha > R(0)) beta = -beta;
            over = R(1) / (alpha - beta);
            tau = (beta - alpha) / beta;
            for (c = i + 1; c < columns; c++) own[c] *= over;
            for (r = i + 1; r < rows; r++) {
                mp_real *next = a + r * columns;
                mp_real sum = next[i];
                for (c = i + 1; c < columns; c++) sum += own[c] * next[c];
                sum *= tau;
                next[i] -= sum;
                for (c = i + 1; c < columns; c++) next[c] -= own[c] * sum;
            }
            own[i] = beta;
            for (c = i + 1; c < columns; c++) own[c] = R(0);
        }
        if (own[i] < R(0))
            for (r = i; r < rows; r++) a[r * columns + i] = -a[r * columns + i];
    }
}

void mp_back(const mp_real *triangle, int size, int first, int n, mp_real *b) {
    int i, j;
    for (i = n - 1; i >= 0; i--) {
        const mp_real *own = triangle + AT(size, first + i) - i;
        mp_real sum = b[i];
        for (j = i + 1; j < n; j++) sum -= own[j] * b[j];
        b[i] = sum / own[i];
    }
}

void mp_forward(const mp_real *triangle, int size, int n, mp_real *a) {
    int i, j;
    for (i = 0; i < n; i++) {
        const mp_real *own = triangle + AT(size, i) - i;
        a[i] /= own[i];
        for (j = i + 1; j < n; j++) a[j] -= a[i] * own[j];
    }
}

void mp_inverse10(const mp_real *triangle, int size, int first, mp_real out[10][10]) {
    int i, j, k;
    for (i = 9; i >= 0; i--) {
        const mp_real *own = triangle + AT(size, first + i) - i;
        for (j = 0; j < 10; j++) {
            mp_real sum = i == j ? R(1) : R(0);
            for (k = i + 1; k <= j; k++) sum -= own[k] * out[k][j];
            out[i][j] = j < i ? R(0) : sum / own[i];
        }
    }
}
