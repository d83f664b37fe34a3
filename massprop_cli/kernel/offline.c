/* What off-line fits need of many cycles at once, for the ground: cycles taken in as in flight (massprop_cli/estimate/triangle.py), the
 * filter on all nuisances beside assumptions (massprop_cli/estimate/nuisance.py), and what rows bring that those before them did not tell
 * (massprop_cli/estimate/innovations.py). */
#include <stddef.h>
#include <string.h>

#include "filter.h"
#include "host.h"
#include "linalg.h"

SHARED int mp_host_taken(const double *table, const double *reference, const double *attitude_error, int begun, long count, long stride,
                         const double *rows, double *mean, double *root, double *triangle, double *white, double *roots);

SHARED int mp_host_expected(long count, long unknowns, const double *rows, mp_real *triangle, mp_real *room, double *left, double *spread);

SHARED int mp_host_filtered(const long *sizes, const double *transition, const double *drive, const double *process,
                            const double *observation, const double *measured, const double *noise, mp_real *room, double *mean,
                            double *root, double *white, double *roots);

/* What of rows (count, 6, n + 1) a triangle on n unknowns, packed with what stands beside them, doesn't expect, (count, 6), and the lower
 * root of its covariance, (count, 6, 6); each cycle's rows are folded in after. room: 6 (n + 1). */
int mp_host_expected(long count, long unknowns, const double *rows, mp_real *triangle, mp_real *room, double *left, double *spread) {
    int n = (int)unknowns, size = n + 1, i, j;
    long k;
    for (k = 0; k < count; k++) {
        const double *own = rows + k * 6 * size;
        mp_real(*columns)[6] = (mp_real(*)[6])room, root[6][6];
        for (i = 0; i < 6; i++)
            for (j = 0; j < n; j++) columns[j][i] = (mp_real)own[i * size + j];
        mp_forward6(triangle, size, n, columns);
        for (i = 0; i < 6; i++) {
            mp_real sum = (mp_real)own[i * size + n];
            for (j = 0; j < n; j++) sum -= columns[j][i] * triangle[AT(size, j) + n - j];
            left[k * 6 + i] = (double)sum;
        }
        mp_root6(columns, n, root);
        for (i = 0; i < 6; i++)
            for (j = 0; j < 6; j++) spread[(k * 6 + i) * 6 + j] = (double)root[i][j];
        (void)mp_copied(room, own, 6 * size);
        mp_fold(triangle, size, room, 6);
    }
    return MP_OK;
}

/* The filter's mean (n, width) and root (n, n), and the packed triangle: of a run, or from there (`given`). */
static void exchanged(const mp_layout *layout, mp_run *run, int given, double *mean, double *root, double *triangle) {
    int n = layout->states, width = layout->width, i, j;
    for (i = 0; i < n; i++) {
        for (j = 0; j < width; j++) {
            if (given) run->filter.mean[i][j] = (mp_real)mean[i * width + j];
            else mean[i * width + j] = (double)run->filter.mean[i][j];
        }
        for (j = 0; j < n; j++) {
            if (given) run->filter.root[i][j] = (mp_real)root[i * n + j];
            else root[i * n + j] = (double)run->filter.root[i][j];
        }
    }
    for (i = 0; i < MP_PACKED(width); i++) {
        if (given) run->triangle[i] = (mp_real)triangle[i];
        else triangle[i] = (double)run->triangle[i];
    }
}

/* Cycles by rows, as mp_host_run has them, into a filter and a triangle, as they are before and after them. In a phase's first cycle the
 * filter begins; where it has `begun` the first row is the cycle before. Of each cycle taken in: white (K, 6, width) and roots (K, 6, 6). */
int mp_host_taken(const double *table, const double *reference, const double *attitude_error, int begun, long count, long stride,
                  const double *rows, double *mean, double *root, double *triangle, double *white, double *roots) {
    mp_vehicle vehicle;
    mp_layout layout;
    mp_reference about;
    mp_cycle cycle;
    mp_motion motion[2];
    mp_time_update update;
    mp_run run;
    mp_real joint[(6 + MP_STATES) * (6 + MP_STATES + MP_PROCESS)], own[6 * MP_WIDTH], ordered[6 * MP_WIDTH], spread[6][6], first[3][5];
    long k;
    int i, status = mp_about_of(table, reference, &vehicle, &layout, &about);
    if (status != MP_OK) return status;
    (void)mp_copied(first[0], attitude_error, 15);
    exchanged(&layout, &run, 1, mean, root, triangle);
    for (k = 0; k < count; k++) {
        mp_motion *here = &motion[k % 2];
        mp_cycle_of(&vehicle, rows + k * stride, &cycle);
        mp_motion_of(&vehicle, &layout, &cycle, &about, here);
        if (k == 0 && begun) continue;
        if (k > 0) mp_time_update_of(&vehicle, &layout, &motion[(k + 1) % 2], here, &about, &update);
        else mp_filter_begin(&layout, (const mp_real(*)[5])first, &run.filter);
        mp_filter_step(&layout, &run.filter, k > 0 ? &update : NULL, here, joint, own, spread);
        for (i = 0; i < 6 * layout.width; i++) *white++ = (double)own[i];
        for (i = 0; i < 36; i++) *roots++ = (double)spread[i / 6][i % 6];
        mp_ordered(&layout, own, ordered);
        mp_fold(run.triangle, layout.width, ordered, 6);
    }
    exchanged(&layout, &run, 0, mean, root, triangle);
    return MP_OK;
}

/* What a filter works with: n states of c columns, of which so many are driven and measured. */
typedef struct {
    int n, noises, columns, given;
    mp_real *mean, *was;    /* (n, columns) */
    mp_real *root, *joint;  /* (n, n + noises); (6 + n, 6 + n + noises) */
    mp_real *left;          /* (6, columns) */
} filter;

/* x becomes F x + u, and the root of its covariance [F S, G]. */
static void predicted(filter *own, const double *transition, const double *drive, const double *process) {
    int n = own->n, wide = n + own->noises, i, j, c;
    mp_real *kept = own->joint; /* (n, n), not yet needed for else */
    memcpy(own->was, own->mean, (size_t)(n * own->columns) * sizeof own->was[0]);
    for (i = 0; i < n; i++)
        for (j = 0; j < n; j++) kept[i * n + j] = own->root[i * wide + j];
    for (i = 0; i < n; i++) {
        mp_real *row = own->mean + i * own->columns;
        for (c = 0; c < own->columns; c++) row[c] = c < own->given ? (mp_real)drive[i * own->given + c] : R(0);
        for (c = 0; c < n; c++) own->root[i * wide + c] = R(0);
        for (j = 0; j < n; j++) {
            const mp_real by = (mp_real)transition[i * n + j], *from = own->was + j * own->columns;
            if (by == R(0)) continue;
            for (c = 0; c < own->columns; c++) row[c] += by * from[c];
            for (c = 0; c < n; c++) own->root[i * wide + c] += by * kept[j * n + c];
        }
        for (c = 0; c < own->noises; c++) own->root[i * wide + n + c] = (mp_real)process[i * own->noises + c];
    }
}

/* Conditioned on z = H x + V noise, by [[V, H S], [0, S]] made lower triangular; the innovation, whitened, and its root. */
static void updated(filter *own, const double *measured, const double *observation, const double *noise, double *white, double *root) {
    int n = own->n, wide = n + own->noises, all = 6 + wide, i, j, c;
    memset(own->joint, 0, (size_t)((6 + n) * all) * sizeof own->joint[0]);
    for (i = 0; i < 6; i++) {
        mp_real *row = own->joint + i * all, *left = own->left + i * own->columns;
        for (j = 0; j < 6; j++) row[j] = (mp_real)noise[i * 6 + j];
        for (c = 0; c < own->columns; c++) left[c] = c < own->given ? (mp_real)measured[i * own->given + c] : R(0);
        for (j = 0; j < n; j++) {
            const mp_real by = (mp_real)observation[i * n + j], *from = own->mean + j * own->columns;
            if (by == R(0)) continue;
            for (c = 0; c < own->columns; c++) left[c] -= by * from[c];
            for (c = 0; c < wide; c++) row[6 + c] += by * own->root[j * wide + c];
        }
    }
    for (i = 0; i < n; i++) memcpy(own->joint + (6 + i) * all + 6, own->root + i * wide, (size_t)wide * sizeof own->joint[0]);
    mp_lower(own->joint, 6 + n, all);
    for (i = 0; i < 6; i++) {
        const mp_real *lower = own->joint + i * all;
        mp_real *left = own->left + i * own->columns;
        for (j = 0; j < 6; j++) root[i * 6 + j] = j <= i ? (double)lower[j] : 0.0;
        for (j = 0; j < i; j++)
            for (c = 0; c < own->columns; c++) left[c] -= lower[j] * own->left[j * own->columns + c];
        for (c = 0; c < own->columns; c++) {
            left[c] /= lower[i];
            white[i * own->columns + c] = (double)left[c];
        }
    }
    for (i = 0; i < n; i++) {
        const mp_real *lower = own->joint + (6 + i) * all;
        mp_real *row = own->mean + i * own->columns;
        for (j = 0; j < 6; j++)
            for (c = 0; c < own->columns; c++) row[c] += lower[j] * own->left[j * own->columns + c];
        for (j = 0; j < n; j++) own->root[i * wide + j] = lower[6 + j];
        for (j = n; j < wide; j++) own->root[i * wide + j] = R(0);
    }
}

/* sizes: cycles, the first that is measured, states n, columns that are driven and measured, others, process noises q. Of cycles: white
 * (K, 6, columns) and roots (K, 6, 6) of those that are measured; mean (n, columns) and root (n, n) as they begin and as they end.
 * room: (2 n + 6) columns + (6 + 2 n) (6 + n + q). */
int mp_host_filtered(const long *sizes, const double *transition, const double *drive, const double *process, const double *observation,
                     const double *measured, const double *noise, mp_real *room, double *mean, double *root, double *white,
                     double *roots) {
    long count = sizes[0], first = sizes[1], n = sizes[2], given = sizes[3], columns = given + sizes[4], q = sizes[5], k, i, j;
    filter own;
    own.n = (int)n;
    own.noises = (int)q;
    own.columns = (int)columns;
    own.given = (int)given;
    own.mean = room;
    own.was = own.mean + n * columns;
    own.left = own.was + n * columns;
    own.root = own.left + 6 * columns;
    own.joint = own.root + n * (n + q);
    for (i = 0; i < n * columns; i++) own.mean[i] = (mp_real)mean[i];
    for (i = 0; i < n; i++)
        for (j = 0; j < n + q; j++) own.root[i * (n + q) + j] = j < n ? (mp_real)root[i * n + j] : R(0);
    for (k = first; k < count; k++) {
        if (k > 0) predicted(&own, transition + (k - 1) * n * n, drive + (k - 1) * n * given, process + (k - 1) * n * q);
        updated(&own, measured + k * 6 * given, observation + k * 6 * n, noise + k * 36, white + (k - first) * 6 * columns,
                roots + (k - first) * 36);
    }
    for (i = 0; i < n * columns; i++) mean[i] = (double)own.mean[i];
    for (i = 0; i < n; i++)
        for (j = 0; j < n; j++) root[i * n + j] = (double)own.root[i * (n + q) + j];
    return MP_OK;
}
