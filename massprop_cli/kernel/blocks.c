/* The response of many cycles at once, for fits on the ground (massprop_cli/model/regressors.py): the same equations, cycle by cycle. */
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "host.h"
#include "motion.h"
#include "linalg.h"

/* What is made of a stretch of cycles: n states, c combinations of coefficients. */
typedef struct {
    double *transition;  /* (K - 1, n, n) */
    double *observation; /* (K, 6, n) */
    double *to_rate;     /* (K - 1, 3, 3) */
    double *steps;       /* (K - 1, 3) */
    double *drive;       /* (K - 1, n, 1 + c) */
    double *measured;    /* (K, 6, 1 + c) */
} regressors;

SHARED int mp_host_regressors(const double *table, const double *reference, long count, long stride, const double *rows, const double *onto,
                          int combined, const regressors *out);

SHARED int mp_host_beyond(const double *table, const double *reference, const double *phi, long count, long stride, const double *rows,
                          const double *rate, double *next, double *seen);

SHARED int mp_host_white(long filters, long count, long columns, long states, const double *step, const double *added,
                         const double *scattered, const unsigned char *used, const double *driven, const double *measured, double *now,
                         double *rows, double *spread);

SHARED int mp_host_integrals(const double *table, const double *reference, long count, long stride, const double *rows, double *step,
                             double *mean, double *known);


static void reference_of(const double *from, const mp_layout *layout, mp_reference *out) {
    int i;
    memset(out, 0, sizeof *out);
    from = mp_copied(out->theta, from, 10);
    from = mp_copied(out->inertia[0], from, 9);
    from = mp_copied(out->cg, from, 3);
    from = mp_copied(&out->mu, from, 1);
    from = mp_copied(out->bias, from, 3);
    from = mp_copied(out->acceleration, from, 3);
    for (i = 0; i < 3; i++) from = mp_copied(out->phi[i], from, layout->channels);
    (void)mp_copied(out->scale, from, 1 + MP_WHEELS);
}

int mp_about_of(const double *table, const double *reference, mp_vehicle *vehicle, mp_layout *layout, mp_reference *about) {
    int status;
    *vehicle = mp_vehicle_of(table);
    status = mp_laid_out(vehicle, layout);
    if (status == MP_OK) reference_of(reference, layout, about);
    return status;
}

/* (3, combined) what phi makes of channels, in combinations (3 x channels + 4, combined) of its coefficients; NULL: each by itself. */
static void combine(const mp_real *channels, int count, const double *onto, int combined, double *made) {
    int a, c, m;
    if (onto != NULL && combined == 1) { /* what a whole reference does, of which there are many */
        for (a = 0; a < 3; a++) {
            made[a] = 0.0;
            for (c = 0; c < count; c++) made[a] += (double)channels[c] * onto[a * count + c];
        }
        return;
    }
    memset(made, 0, (size_t)(3 * combined) * sizeof made[0]);
    for (a = 0; a < 3; a++)
        for (c = 0; c < count; c++) {
            if (onto == NULL) {
                made[a * combined + a * count + c] = (double)channels[c];
                continue;
            }
            for (m = 0; m < combined; m++) made[a * combined + m] += (double)channels[c] * onto[(a * count + c) * combined + m];
        }
}

static void step_written(const mp_layout *layout, const mp_reference *about, const mp_motion *from, const mp_motion *into,
                         const mp_time_update *update, const double *onto, int combined, long k, const regressors *out) {
    int n = layout->states, wide = 1 + combined, i, j, a, m;
    mp_real inverse[3][3], moment[3], scaled[1 + MP_WHEELS][3];
    double made[3 * (3 * MP_CHANNELS + 4)], *drive = out->drive + k * n * wide;
    for (i = 0; i < n; i++) {
        for (j = 0; j < n; j++) out->transition[(k * n + i) * n + j] = (double)update->transition[i][j];
        memset(drive + i * wide, 0, (size_t)wide * sizeof drive[0]);
        drive[i * wide] = (double)update->drive[i];
    }
    combine(update->step, layout->channels, onto, combined, made);
    mp_tensor(about->theta, inverse);
    for (j = 0; j < layout->scales; j++) {
        for (i = 0; i < 3; i++) moment[i] = from->scaled[j][0][i] + into->scaled[j][1][i];
        mp_times((const mp_real(*)[3])inverse, moment, scaled[j]);
    }
    for (i = 0; i < 3; i++) {
        mp_real growth = from->known[0][i] + into->known[1][i];
        for (j = 0; j < 3; j++) out->to_rate[(k * 3 + i) * 3 + j] = (double)update->to_rate[i][j];
        for (j = 0; j < layout->channels; j++) growth += about->phi[i][j] * update->step[j];
        for (j = 0; j < layout->scales; j++) growth += scaled[j][i] * about->scale[j];
        out->steps[k * 3 + i] = (double)growth;
        for (a = 0; a < 3; a++)
            for (m = 0; m < combined; m++) drive[i * wide + 1 + m] += (double)update->solve[i][a] * made[a * combined + m];
    }
}

static void cycle_written(const mp_layout *layout, const mp_motion *here, const double *onto, int combined, long k, const regressors *out) {
    int n = layout->states, wide = 1 + combined, last = 3 * layout->channels, i, j, a, m;
    double made[3 * (3 * MP_CHANNELS + 4)], *measured = out->measured + k * 6 * wide, *observation = out->observation + k * 6 * n;
    memset(measured, 0, (size_t)(6 * wide) * sizeof measured[0]);
    memset(observation, 0, (size_t)(6 * n) * sizeof observation[0]);
    combine(here->mean, layout->channels, onto, combined, made);
    for (i = 0; i < 3; i++) {
        double *felt = measured + (3 + i) * wide;
        measured[i * wide] = (double)here->raw_rate[i];
        felt[0] = (double)here->measured[i];
        for (a = 0; a < 3; a++)
            for (m = 0; m < combined; m++) felt[1 + m] -= (double)here->euler[i][a] * made[a * combined + m];
        for (j = 0; j < 4; j++) {
            if (onto == NULL) felt[1 + last + j] -= (double)here->own[i][j];
            else
                for (m = 0; m < combined; m++) felt[1 + m] -= (double)here->own[i][j] * onto[(last + j) * combined + m];
        }
        observation[i * n + i] = 1.0;
        if (layout->at_bias >= 0) observation[i * n + layout->at_bias + i] = 1.0;
        if (layout->at_accel >= 0) observation[(3 + i) * n + layout->at_accel + i] = 1.0;
        for (j = 0; j < 3; j++) {
            observation[(3 + i) * n + j] = (double)here->by_rate[i][j];
            if (layout->at_torque >= 0) observation[(3 + i) * n + layout->at_torque + j] = (double)here->euler[i][j];
            if (layout->at_tilt >= 0) observation[(3 + i) * n + layout->at_tilt + j] = (double)here->by_tilt[i][j];
        }
        for (j = 0; j < layout->scales; j++) observation[(3 + i) * n + layout->at_scale + j] = (double)here->felt[j][i];
    }
}

/* Of `count` cycles by rows, as mp_host_run has them; `onto` NULL: a column for each coefficient. */
int mp_host_regressors(const double *table, const double *reference, long count, long stride, const double *rows, const double *onto,
                   int combined, const regressors *out) {
    mp_vehicle vehicle;
    mp_layout layout;
    mp_reference about;
    mp_motion motion[2];
    mp_time_update update;
    mp_cycle cycle;
    long k;
    int status = mp_about_of(table, reference, &vehicle, &layout, &about);
    if (status != MP_OK) return status;
    for (k = 0; k < count; k++) {
        mp_cycle_of(&vehicle, rows + k * stride, &cycle);
        mp_motion_of(&vehicle, &layout, &cycle, &about, &motion[k % 2]);
        if (k > 0) {
            const mp_motion *from = &motion[(k + 1) % 2], *into = &motion[k % 2];
            mp_time_update_of(&vehicle, &layout, from, into, &about, &update);
            step_written(&layout, &about, from, into, &update, onto, combined, k - 1, out);
        }
        cycle_written(&layout, &motion[k % 2], onto, combined, k, out);
    }
    return MP_OK;
}

/* Of coefficients phi and rates (K, 3), all other states zero: (K - 1, n) the state one step on, and (K, 6) what is measured beyond what
 * the rates give. */
int mp_host_beyond(const double *table, const double *reference, const double *phi, long count, long stride, const double *rows,
                   const double *rate, double *next, double *seen) {
    mp_vehicle vehicle;
    mp_layout layout;
    mp_reference about;
    mp_motion motion[2];
    mp_time_update update;
    mp_cycle cycle;
    double made[3];
    const double *last;
    long k;
    int i, j, status = mp_about_of(table, reference, &vehicle, &layout, &about);
    if (status != MP_OK) return status;
    last = phi + 3 * layout.channels;
    for (k = 0; k < count; k++) {
        const mp_motion *here = &motion[k % 2];
        const double *now = rate + 3 * k, *before = now - 3;
        double *turning = seen + 6 * k, *pushing = turning + 3;
        mp_cycle_of(&vehicle, rows + k * stride, &cycle);
        mp_motion_of(&vehicle, &layout, &cycle, &about, &motion[k % 2]);
        combine(here->mean, layout.channels, phi, 1, made);
        for (i = 0; i < 3; i++) {
            turning[i] = (double)here->raw_rate[i] - now[i];
            pushing[i] = (double)here->measured[i];
            for (j = 0; j < 3; j++) pushing[i] -= (double)here->euler[i][j] * made[j] + (double)here->by_rate[i][j] * now[j];
            for (j = 0; j < 4; j++) pushing[i] -= (double)here->own[i][j] * last[j];
        }
        if (k == 0) continue;
        mp_time_update_of(&vehicle, &layout, &motion[(k + 1) % 2], here, &about, &update);
        combine(update.step, layout.channels, phi, 1, made);
        for (i = 0; i < layout.states; i++) {
            next[i] = (double)update.drive[i];
            for (j = 0; j < 3; j++) next[i] += (double)update.transition[i][j] * before[j] + (i < 3 ? (double)update.solve[i][j] * made[j] : 0.0);
        }
        next += layout.states;
    }
    return MP_OK;
}

/* What phi multiplies, about a reference: (K - 1, C) under the triangular window, (K, C) mean over each cycle; (K - 1, 3) known growth of
 * the rate. */
int mp_host_integrals(const double *table, const double *reference, long count, long stride, const double *rows, double *step,
                      double *mean, double *known) {
    mp_vehicle vehicle;
    mp_layout layout;
    mp_reference about;
    mp_motion motion[2];
    mp_cycle cycle;
    long k;
    int i, status = mp_about_of(table, reference, &vehicle, &layout, &about);
    if (status != MP_OK) return status;
    for (k = 0; k < count; k++) {
        const mp_motion *from = &motion[(k + 1) % 2], *into = &motion[k % 2];
        mp_cycle_of(&vehicle, rows + k * stride, &cycle);
        mp_motion_of(&vehicle, &layout, &cycle, &about, &motion[k % 2]);
        for (i = 0; i < layout.channels; i++) {
            mean[k * layout.channels + i] = (double)into->mean[i];
            if (k > 0) step[(k - 1) * layout.channels + i] = (double)(from->rising[i] + into->falling[i]);
        }
        for (i = 0; k > 0 && i < 3; i++) known[(k - 1) * 3 + i] = (double)(from->known[0][i] + into->known[1][i]);
    }
    return MP_OK;
}

/* (3, 3) covariance one cycle on: step kept stepT + added, (states, states) each. */
static void spread_on(double kept[3][3], long states, const double *step, const double *added) {
    double made[3][3] = {{0}};
    long i, j, m;
    for (i = 0; i < states; i++)
        for (j = 0; j < states; j++)
            for (m = 0; m < states; m++) made[i][j] += step[i * states + m] * kept[m][j];
    for (i = 0; i < states; i++)
        for (j = 0; j < states; j++) {
            kept[i][j] = added[i * states + j];
            for (m = 0; m < states; m++) kept[i][j] += made[i][m] * step[j * states + m];
        }
}

/* White innovations (filters, count, columns) and their variances (filters, count) of filters on rate and torque, for all columns at once
 * (massprop_cli/estimate/whitening.py). now: (filters, 3, columns) as they begin; of three states the last forgets from cycle to cycle. */
int mp_host_white(long filters, long count, long columns, long states, const double *step, const double *added,
                  const double *scattered, const unsigned char *used, const double *driven, const double *measured, double *now,
                  double *rows, double *spread) {
    long f, k, c, i, j;
    double half = states > 2 ? step[2] : 0.0;
    for (f = 0; f < filters; f++) {
        double kept[3][3] = {{0}}, was[3], gain[3] = {0.0, 0.0, 0.0};
        double *rate = now + f * 3 * columns, *torque = rate + columns, *held = torque + columns;
        for (k = 0; k < count; k++) {
            double *row = rows + (f * count + k) * columns, *variance = spread + f * count + k, root;
            const double *drive = driven + k * columns, *seen = measured + k * columns;
            for (c = 0; k > 0 && c < columns; c++) {
                rate[c] += drive[c] + torque[c] + half * held[c];
                held[c] = 0.0;
            }
            if (k > 0) {
                spread_on(kept, states, step, added + f * states * states);
                kept[0][0] += scattered[k];
            }
            *variance = 1.0;
            if (!used[k]) {
                memset(row, 0, (size_t)columns * sizeof row[0]);
                continue;
            }
            *variance += kept[0][0];
            root = sqrt(*variance);
            for (i = 0; i < states; i++) gain[i] = kept[i][0] / *variance;
            for (c = 0; c < columns; c++) {
                double innovation = seen[c] - rate[c];
                rate[c] += gain[0] * innovation;
                torque[c] += gain[1] * innovation;
                held[c] += gain[2] * innovation;
                row[c] = innovation / root;
            }
            for (j = 0; j < states; j++) was[j] = kept[0][j];
            for (i = 0; i < states; i++)
                for (j = 0; j < states; j++) kept[i][j] -= gain[i] * was[j];
        }
    }
    return MP_OK;
}
