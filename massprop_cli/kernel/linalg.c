#include "linalg.h"

#include <math.h>

int mp_finite(const mp_real *v, int count) {
    int i, fine = 1;
    for (i = 0; i < count; i++) fine &= v[i] - v[i] == R(0);
    return fine;
}

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

/* What a column's reflection takes: `own` its diagonal, `power` the square of what stands below. Nothing to do where that is none. */
static int reflected(mp_real *own, mp_real power, mp_real *over, mp_real *tau) {
    mp_real alpha = *own, beta;
    if (power == R(0)) return 0;
    beta = MP_SQRT(alpha * alpha + power);
    if (alpha > R(0)) beta = -beta;
    *over = R(1) / (alpha - beta);
    *tau = (beta - alpha) / beta;
    *own = beta;
    return 1;
}

/* One column's reflection of six rows, which is nearly all that a cycle folds, in one sweep. The rows are arguments, since only of those do
   compilers believe `restrict`, without which they take one number at a time. */
static void reflect6(mp_real *restrict own, mp_real *restrict r0, mp_real *restrict r1, mp_real *restrict r2, mp_real *restrict r3,
                     mp_real *restrict r4, mp_real *restrict r5, int count, const mp_real part[6], mp_real tau) {
    const mp_real p0 = part[0], p1 = part[1], p2 = part[2], p3 = part[3], p4 = part[4], p5 = part[5];
    int c;
    for (c = 0; c < count; c++) {
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

static void fold6(mp_real *triangle, int size, mp_real *rows) {
    mp_real *r0 = rows, *r1 = r0 + size, *r2 = r1 + size, *r3 = r2 + size, *r4 = r3 + size, *r5 = r4 + size, *own = triangle;
    int i, left;
    for (left = size; left > 0; own += left--) {
        mp_real p[6], power, over, tau;
        p[0] = *r0++;
        p[1] = *r1++;
        p[2] = *r2++;
        p[3] = *r3++;
        p[4] = *r4++;
        p[5] = *r5++;
        power = (p[0] * p[0] + p[1] * p[1]) + (p[2] * p[2] + p[3] * p[3]) + (p[4] * p[4] + p[5] * p[5]);
        if (!reflected(own, power, &over, &tau)) continue;
        for (i = 0; i < 6; i++) p[i] *= over;
        reflect6(own + 1, r0, r1, r2, r3, r4, r5, left - 1, p, tau);
    }
}

/* One column's reflection of any number of rows. */
static void reflect(mp_real *own, mp_real *rows, int size, int count, int column, mp_real over, mp_real tau) {
    mp_real sum[MP_WIDTH];
    int from = column + 1, left = size - from, i, c;
    for (c = 0; c < left; c++) sum[c] = own[from + c];
    for (i = 0; i < count; i++) {
        const mp_real *r = rows + i * size + from;
        mp_real by = r[-1] * over;
        if (by == R(0)) continue;
        for (c = 0; c < left; c++) sum[c] += by * r[c];
    }
    for (c = 0; c < left; c++) {
        sum[c] *= tau;
        own[from + c] -= sum[c];
    }
    for (i = 0; i < count; i++) {
        mp_real *r = rows + i * size + from, by = r[-1] * over;
        if (by == R(0)) continue;
        for (c = 0; c < left; c++) r[c] -= by * sum[c];
    }
}

void mp_fold(mp_real *triangle, int size, mp_real *rows, int count) {
    int j, i;
    if (count == 6) {
        fold6(triangle, size, rows);
        return;
    }
    for (j = 0; j < size; j++) {
        mp_real *own = triangle + AT(size, j) - j;
        mp_real power = R(0), over, tau;
        for (i = 0; i < count; i++) power += rows[i * size + j] * rows[i * size + j];
        if (reflected(own + j, power, &over, &tau)) reflect(own, rows, size, count, j, over, tau);
    }
}

/* Columns that are done with go along: six at a time are quicker than fewer. */
void mp_root6(mp_real (*a)[6], int n, mp_real out[6][6]) {
    int i, j, k;
    for (j = 0; j < 6; j++) {
        mp_real alpha = R(1), power = R(0), over, tau, sum[6];
        for (k = 0; k < n; k++) power += a[k][j] * a[k][j];
        for (i = 0; i < 6; i++) {
            out[i][j] = i == j ? R(1) : R(0);
            sum[i] = R(0);
        }
        if (!reflected(&alpha, power, &over, &tau)) continue;
        for (k = 0; k < n; k++) {
            mp_real *row = a[k], part = row[j] * over;
            for (i = 0; i < 6; i++) sum[i] += part * row[i];
        }
        for (i = 0; i < 6; i++) sum[i] *= tau;
        for (k = 0; k < n; k++) {
            mp_real *row = a[k], part = row[j] * over;
            for (i = 0; i < 6; i++) row[i] -= part * sum[i];
        }
        /* the row of the unit matrix reflected, with a positive diagonal */
        for (i = j; i < 6; i++) out[i][j] = i == j ? -alpha : sum[i];
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

void mp_forward6(const mp_real *triangle, int size, int n, mp_real (*a)[6]) {
    int i, j, k;
    for (i = 0; i < n; i++) {
        const mp_real *own = triangle + AT(size, i) - i;
        mp_real solved[6];
        for (k = 0; k < 6; k++) solved[k] = a[i][k] / own[i];
        for (k = 0; k < 6; k++) a[i][k] = solved[k];
        for (j = i + 1; j < n; j++) {
            mp_real *other = a[j], by = own[j];
            for (k = 0; k < 6; k++) other[k] -= solved[k] * by;
        }
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

void mp_level(const mp_real up[3], const mp_real v[3], mp_real out[3]) {
    mp_real along = mp_dot(up, v);
    int i;
    for (i = 0; i < 3; i++) out[i] = v[i] - up[i] * along;
}
