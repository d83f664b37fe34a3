/* The response of many cycles at once, for fits on the ground (massprop_cli/model/lifted.py): the same equations, cycle by cycle. */
#include <stddef.h>
#include <string.h>

#include "host.h"
#include "motion.h"
#include "small.h"

/* What is made of a stretch of cycles: n states, c combinations of coefficients. */
typedef struct {
    double *transition;  /* (K - 1, n, n) */
    double *observation; /* (K, 6, n) */
    double *to_rate;     /* (K - 1, 3, 3) */
    double *steps;       /* (K - 1, 3) */
    double *drive;       /* (K - 1, n, 1 + c) */
    double *measured;    /* (K, 6, 1 + c) */
} lifted;

static void reference_of(const double *from, int channels, mp_reference *out) {
    int i;
    memset(out, 0, sizeof *out);
    from = mp_copied(out->theta, from, 10);
    from = mp_copied(out->inertia[0], from, 9);
    from = mp_copied(out->cg, from, 3);
    from = mp_copied(&out->mu, from, 1);
    from = mp_copied(out->bias, from, 3);
    from = mp_copied(out->acceleration, from, 3);
    for (i = 0; i < 3; i++) from = mp_copied(out->phi[i], from, channels);
}

int mp_about_of(const double *table, const double *reference, mp_vehicle *vehicle, mp_layout *layout, mp_reference *about) {
    int status;
    *vehicle = mp_vehicle_of(table);
    status = mp_laid_out(vehicle, layout);
    if (status == MP_OK) reference_of(reference, layout->channels, about);
    return status;
}

/* (3, combined) what phi makes of channels, in combinations (3 x channels + 4, combined) of its coefficients; NULL: each by itself. */
static void combine(const mp_real *channels, int count, const double *onto, int combined, double *made) {
    int a, c, m;
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
                         const mp_leap *leap, const double *onto, int combined, long k, const lifted *out) {
    int n = layout->states, wide = 1 + combined, i, j, a, m;
    double made[3 * (3 * MP_CHANNELS + 4)], *drive = out->drive + k * n * wide;
    for (i = 0; i < n; i++) {
        for (j = 0; j < n; j++) out->transition[(k * n + i) * n + j] = (double)leap->transition[i][j];
        memset(drive + i * wide, 0, (size_t)wide * sizeof drive[0]);
        drive[i * wide] = (double)leap->drive[i];
    }
    combine(leap->step, layout->channels, onto, combined, made);
    for (i = 0; i < 3; i++) {
        mp_real growth = from->known[0][i] + into->known[1][i];
        for (j = 0; j < 3; j++) out->to_rate[(k * 3 + i) * 3 + j] = (double)leap->to_rate[i][j];
        for (j = 0; j < layout->channels; j++) growth += about->phi[i][j] * leap->step[j];
        out->steps[k * 3 + i] = (double)growth;
        for (a = 0; a < 3; a++)
            for (m = 0; m < combined; m++) drive[i * wide + 1 + m] += (double)leap->solve[i][a] * made[a * combined + m];
    }
}

static void cycle_written(const mp_layout *layout, const mp_motion *here, const double *onto, int combined, long k, const lifted *out) {
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
    }
}

/* Of `count` cycles by rows, as mp_host_run has them; `onto` NULL: a column for each coefficient. */
SHARED int mp_host_lifted(const double *table, const double *reference, long count, long stride, const double *rows, const double *onto,
                          int combined, const lifted *out) {
    mp_vehicle vehicle;
    mp_layout layout;
    mp_reference about;
    mp_motion motion[2];
    mp_leap leap;
    mp_cycle cycle;
    long k;
    int status = mp_about_of(table, reference, &vehicle, &layout, &about);
    if (status != MP_OK) return status;
    for (k = 0; k < count; k++) {
        mp_cycle_of(&vehicle, rows + k * stride, &cycle);
        mp_motion_of(&vehicle, &layout, &cycle, &about, &motion[k % 2]);
        if (k > 0) {
            const mp_motion *from = &motion[(k + 1) % 2], *into = &motion[k % 2];
            mp_leap_of(&vehicle, &layout, from, into, &about, &leap);
            step_written(&layout, &about, from, into, &leap, onto, combined, k - 1, out);
        }
        cycle_written(&layout, &motion[k % 2], onto, combined, k, out);
    }
    return MP_OK;
}
