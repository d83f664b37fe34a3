/* Hypotheses held against the triangles of one log, each fitted with a body, for the ground: massprop_cli/diagnosis/comparison.py, which has
 * it in NumPy as well. */
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "host.h"
#include "linalg.h"
#include "hypothesis.h"

#define HALF_STEP 1e-6
#define LIGHTEST 10.0 /* times as heavy that a body may become by one step */
#define SLENDER 1e-4  /* least principal response over the largest */
#define ROUNDING 1e-9 /* part of the cost up to which a step that doesn't help ends a fit */

SHARED int mp_host_residuals(const long *sizes, const long *places, const double *numbers, const double *const *triangles, const double *x,
                        const double *turns, const double *freed, double *room, double *left);
SHARED int mp_host_fitted(const long *sizes, const long *places, const double *numbers, const double *const *triangles,
                          const double *turns, const double *freed, const double *moves, const double *pulled, const double *ends,
                          double *room, double *x, double *left, double *spread);

/* Four columns at once: a row is read and written once for all of them. */
static void four_added(const double by[4], const double *const column[4], long end, double *row) {
    const double *a = column[0], *b = column[1], *c = column[2], *d = column[3];
    long r;
    for (r = 0; r < end; r++) row[r] += (by[0] * a[r] + by[1] * b[r]) + (by[2] * c[r] + by[3] * d[r]);
}

/* (6, columns) what coefficients (columns, 6) do to both triangles, less what was measured where that is wanted, over the noise; rows
 * beyond a triangle's are nothing. */
static void against(const mp_hypotheses *about, const mp_sensor sensors[2], const mp_hypothesis *one, const double *made, int measured,
                    double *left) {
    long p = about->columns, r, c;
    int s, a;
    memset(left, 0, (size_t)(6 * p) * sizeof left[0]);
    for (s = 0; s < 2; s++) {
        const mp_sensor *own = sensors + s;
        for (a = 0; a < 3; a++) {
            double *row = left + (3 * s + a) * p, along = 0.0, over = 1.0 / own->root[3 * s + a];
            const double *freed = one->freed[s], *columns[4];
            double bys[4];
            int held = 0;
            for (r = 0; measured && r < own->rows; r++) row[r] = -own->measured[a * own->rows + r];
            for (c = 0; c < p; c++) {
                double by = made[c * 6 + 3 * s + a];
                if (by == 0.0) continue; /* most are, of what isn't supposed */
                bys[held] = by;
                columns[held++] = own->triangle + c * own->rows;
                if (held < 4) continue;
                four_added(bys, columns, c < own->rows ? c + 1 : own->rows, row);
                held = 0;
            }
            for (c = 0; c < held; c++)
                for (r = 0; r < own->rows; r++) row[r] += bys[c] * columns[c][r];
            if (freed != NULL) {
                for (r = 0; r < own->rows; r++) along += freed[r] * row[r];
                for (r = 0; r < own->rows; r++) row[r] -= along * freed[r];
            }
            for (r = 0; r < own->rows; r++) row[r] *= over;
        }
    }
}

static void left_of(const mp_hypotheses *about, const mp_sensor sensors[2], const double *x, const mp_hypothesis *one, double *made,
                    double *left) {
    mp_hypothesis_coefficients(about, x, one, made);
    against(about, sensors, one, made, 1, left);
}

/* turns (H, 2, 3, 3); freed (H, rows of both) or NULL. */
static mp_hypothesis one_of(const long *sizes, const double *turns, const double *freed, long h) {
    mp_hypothesis one;
    const double *own = freed == NULL ? NULL : freed + h * (sizes[5] + sizes[6]);
    one.gyro = turns + h * 18;
    one.accelerometer = one.gyro + 9;
    one.freed[0] = own;
    one.freed[1] = own == NULL ? NULL : own + sizes[5];
    return one;
}

/* (H, 6, columns) for x (H, entries). room: 6 columns. */
int mp_host_residuals(const long *sizes, const long *places, const double *numbers, const double *const *triangles, const double *x,
                 const double *turns, const double *freed, double *room, double *left) {
    mp_hypotheses about;
    mp_sensor sensors[2];
    long h;
    mp_hypotheses_of(sizes, places, numbers, &about);
    mp_sensors_of(sizes, triangles, sensors);
    for (h = 0; h < sizes[0]; h++) {
        mp_hypothesis one = one_of(sizes, turns, freed, h);
        left_of(&about, sensors, x + h * about.entries, &one, room, left + h * 6 * about.columns);
    }
    return MP_OK;
}

static int is_body(const double *x) {
    mp_real given[3][3], values[3], axes[3][3];
    double own[3][3];
    int i, j;
    for (i = 0; i < 10; i++)
        if (!(x[i] - x[i] == 0.0)) return 0;
    mp_hypothesis_tensor(x, own);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) given[i][j] = (mp_real)own[i][j];
    mp_eigen((const mp_real(*)[3])given, values, axes);
    return (double)values[0] > SLENDER * fabs((double)values[2]) && x[HYPOTHESIS_MU] > 0.0;
}

/* a x = b for b (n, m), in place, by elimination with pivots; 0 where a is singular. */
static int eliminated(double *a, int n, double *b, int m) {
    int i, j, k;
    for (k = 0; k < n; k++) {
        int best = k;
        for (i = k + 1; i < n; i++)
            if (fabs(a[i * n + k]) > fabs(a[best * n + k])) best = i;
        if (a[best * n + k] == 0.0) return 0; /* what is no number goes on as such, and leads to no body */
        for (j = 0; best != k && j < n; j++) {
            double kept = a[k * n + j];
            a[k * n + j] = a[best * n + j];
            a[best * n + j] = kept;
        }
        for (j = 0; best != k && j < m; j++) {
            double kept = b[k * m + j];
            b[k * m + j] = b[best * m + j];
            b[best * m + j] = kept;
        }
        for (i = k + 1; i < n; i++) {
            double by = a[i * n + k] / a[k * n + k];
            for (j = k + 1; j < n; j++) a[i * n + j] -= by * a[k * n + j];
            for (j = 0; j < m; j++) b[i * m + j] -= by * b[k * m + j];
        }
    }
    for (i = n - 1; i >= 0; i--)
        for (j = 0; j < m; j++) {
            for (k = i + 1; k < n; k++) b[i * m + j] -= a[i * n + k] * b[k * m + j];
            b[i * m + j] /= a[i * n + i];
        }
    return 1;
}

/* In four sums, which needn't wait for one another. */
static double dot(const double *a, const double *b, long count) {
    double sums[4] = {0.0, 0.0, 0.0, 0.0};
    long i;
    for (i = 0; i + 4 <= count; i += 4) {
        sums[0] += a[i] * b[i];
        sums[1] += a[i + 1] * b[i + 1];
        sums[2] += a[i + 2] * b[i + 2];
        sums[3] += a[i + 3] * b[i + 3];
    }
    for (; i < count; i++) sums[0] += a[i] * b[i];
    return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

/* Where the numbers of one fit stand. */
typedef struct {
    double *made, *moving, *other, *slopes, *moved, *normal, *damped, *step, *offset; /* slopes (n, 6, columns) */
} room_of;

static room_of divided(double *room, long p, long nx, long n) {
    room_of own;
    own.made = room;
    own.moving = own.made + 6 * p;
    own.other = own.moving + 6 * p;
    own.slopes = own.other + 6 * p;
    own.moved = own.slopes + 6 * p * n;
    own.normal = own.moved + nx;
    own.damped = own.normal + n * n;
    own.step = own.damped + n * n;
    own.offset = own.step + n;
    return own;
}

/* The derivative along each move: coefficients by differences, in which what is left is linear. */
static void sloped(const mp_hypotheses *about, const mp_sensor sensors[2], const mp_hypothesis *one, const double *moves, long n, const double *x,
                   const room_of *own) {
    long k, i, all = 6 * about->columns;
    mp_hypothesis_coefficients(about, x, one, own->made);
    for (k = 0; k < n; k++) {
        for (i = 0; i < about->entries; i++) own->moved[i] = x[i] + HALF_STEP * moves[i * n + k];
        mp_hypothesis_coefficients(about, own->moved, one, own->moving);
        for (i = 0; i < all; i++) own->moving[i] = (own->moving[i] - own->made[i]) * (1.0 / HALF_STEP);
        against(about, sensors, one, own->moving, 0, own->slopes + k * all);
    }
}

static void normal_of(const room_of *own, long all, long n, const double *pulled) {
    long i, j;
    for (i = 0; i < n; i++)
        for (j = 0; j <= i; j++) own->normal[i * n + j] = own->normal[j * n + i] = dot(own->slopes + i * all, own->slopes + j * all, all);
    for (i = 0; i < n; i++) own->normal[i * n + i] += pulled[i] * pulled[i];
}

/* Damped Gauss-Newton steps of one hypothesis (massprop_cli/diagnosis/comparison.py, _Descent). ends: a change of -2 log likelihood that
 * ends it, measurements less coefficients, and the most steps. */
static int descended(const mp_hypotheses *about, const mp_sensor sensors[2], const mp_hypothesis *one, const double *moves, long n,
                     const double *pulled, const double *ends, const room_of *own, double *x, double *left, double *spread) {
    long all = 6 * about->columns, i, k;
    double cost, damping = 1e-6;
    int again, due = 1;
    left_of(about, sensors, x, one, own->made, left);
    cost = dot(left, left, all);
    memset(own->offset, 0, (size_t)n * sizeof own->offset[0]);
    for (again = 0; again < (int)ends[2]; again++) {
        double then, gained;
        int wrong, better;
        if (due) {
            sloped(about, sensors, one, moves, n, x, own);
            normal_of(own, all, n, pulled);
        }
        due = 0;
        memcpy(own->damped, own->normal, (size_t)(n * n) * sizeof own->damped[0]);
        for (k = 0; k < n; k++) {
            own->step[k] = -pulled[k] * pulled[k] * own->offset[k] - dot(own->slopes + k * all, left, all);
            own->damped[k * n + k] += damping * own->normal[k * n + k];
        }
        if (!eliminated(own->damped, (int)n, own->step, 1)) return MP_NOT_FINITE;
        for (i = 0; i < about->entries; i++) {
            own->moved[i] = x[i];
            for (k = 0; k < n; k++) own->moved[i] += moves[i * n + k] * own->step[k];
        }
        /* a mass that the log doesn't tell may be any; what it does tell must not wait for it */
        if (own->moved[HYPOTHESIS_MU] < x[HYPOTHESIS_MU] / LIGHTEST) own->moved[HYPOTHESIS_MU] = x[HYPOTHESIS_MU] / LIGHTEST;
        wrong = !is_body(own->moved);
        if (wrong) memcpy(own->moved, x, (size_t)about->entries * sizeof x[0]);
        left_of(about, sensors, own->moved, one, own->made, own->other);
        then = dot(own->other, own->other, all);
        for (k = 0; k < n; k++) then += pulled[k] * pulled[k] * (own->offset[k] + own->step[k]) * (own->offset[k] + own->step[k]);
        better = then < cost && !wrong;
        gained = better ? cost - then : wrong || !(then <= cost * (1.0 + ROUNDING)) ? HUGE_VAL : 0.0;
        damping = better ? damping / 10.0 : damping * 10.0 + 1e-4;
        if (better) {
            memcpy(x, own->moved, (size_t)about->entries * sizeof x[0]);
            memcpy(left, own->other, (size_t)all * sizeof left[0]);
            for (k = 0; k < n; k++) own->offset[k] += own->step[k];
            cost = then;
            due = 1;
        }
        if (!(gained > ends[0] * (1.0 + cost / ends[1]))) break;
    }
    memset(own->damped, 0, (size_t)(n * n) * sizeof own->damped[0]);
    for (k = 0; k < n; k++) own->damped[k * n + k] = 1.0;
    if (!eliminated(own->normal, (int)n, own->damped, (int)n)) return MP_NOT_FINITE;
    for (k = 0; k < n; k++) spread[k] = own->damped[k * n + k] < 0.0 ? 0.0 : sqrt(own->damped[k * n + k]);
    return MP_OK;
}

/* Each hypothesis fitted: x (H, entries) from where it begins to where it ends along moves (H, entries, n), left (H, 6, columns),
 * spread (H, n). room: 18 columns + (6 columns + 2 n + 2) n + entries. */
int mp_host_fitted(const long *sizes, const long *places, const double *numbers, const double *const *triangles, const double *turns,
                   const double *freed, const double *moves, const double *pulled, const double *ends, double *room, double *x,
                   double *left, double *spread) {
    mp_hypotheses about;
    mp_sensor sensors[2];
    room_of own = divided(room, sizes[2], sizes[3], sizes[4]);
    long h, n = sizes[4];
    int status = MP_OK;
    mp_hypotheses_of(sizes, places, numbers, &about);
    mp_sensors_of(sizes, triangles, sensors);
    for (h = 0; h < sizes[0] && status == MP_OK; h++) {
        mp_hypothesis one = one_of(sizes, turns, freed, h);
        status = descended(&about, sensors, &one, moves + h * about.entries * n, n, pulled, ends, &own, x + h * about.entries,
                           left + h * 6 * about.columns, spread + h * n);
    }
    return status;
}
