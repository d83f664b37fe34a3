#include <math.h>
#include <stddef.h>
#include <string.h>

#include "filter.h"
#include "initial.h"
#include "responsemap.h"
#include "massprop.h"
#include "motion.h"
#include "linalg.h"
#include "solve.h"

#define AGAIN 8       /* how often, on the average, a cycle may be taken in anew */
#define ATTEMPT 16    /* least number of cycles between attempts to find a first reference */
#define PASSES 4      /* how often in a row cycles are taken in anew */
#define CHECKPOINT 64 /* cycles from which on they may be, next time */

int mp_begin(mp_pass *pass, const mp_vehicle *vehicle) {
    mp_layout layout;
    int status = mp_laid_out(vehicle, &layout);
    pass->ready = 0;
    if (status != MP_OK) return status;
    memset(pass, 0, offsetof(mp_pass, ring));
    pass->vehicle = *vehicle;
    pass->layout = layout;
    pass->due = ATTEMPT;
    pass->spare = MP_LEARNING;
    pass->block_end = MP_BLOCK;
    mp_fallback(vehicle, &pass->reference);
    pass->estimate = pass->centre = pass->reference;
    mp_run_begin(&layout, 0, &pass->run);
    pass->ring[0] = pass->run;
    pass->runs = 1;
    pass->ready = 1;
    return MP_OK;
}

static mp_run *in_ring(mp_pass *pass, int k) { return &pass->ring[(pass->first + k) % MP_CHECKPOINTS]; }

/* The present run as the ring's last. */
static void pushed(mp_pass *pass) {
    if (pass->runs == MP_CHECKPOINTS) {
        pass->first = (pass->first + 1) % MP_CHECKPOINTS;
        pass->runs -= 1;
    }
    *in_ring(pass, pass->runs) = pass->run;
    pass->runs += 1;
}

/* One cycle into the run's filter: its whitened innovations, ordered (6, width), and their root. */
static void filtered(mp_pass *pass, const mp_cycle *cycle, mp_real *ordered, mp_real root[6][6]) {
    mp_motion *here = &pass->room.motion;
    mp_run *run = &pass->run;
    mp_motion_of(&pass->vehicle, &pass->layout, cycle, &pass->reference, here);
    if (run->begun) mp_time_update_of(&pass->vehicle, &pass->layout, &pass->last, here, &pass->reference, &pass->room.update);
    else mp_filter_begin(&pass->layout, (const mp_real(*)[5])pass->attitude_error, &run->filter);
    mp_filter_step(&pass->layout, &run->filter, run->begun ? &pass->room.update : NULL, here, pass->room.joint, pass->room.white, root);
    mp_ordered(&pass->layout, pass->room.white, ordered);
}

/* What was filtered is the latest cycle, and these are its rows. */
static void folded(mp_pass *pass, mp_real *ordered) {
    mp_run *run = &pass->run;
    run->begun = 1;
    run->at += 1;
    pass->last = pass->room.motion;
    mp_fold(run->triangle, pass->layout.width, ordered, 6);
}

/* The cycles of the ring anew, about a reference that they give themselves from the estimate on. */
static void again(mp_pass *pass) {
    long end = pass->run.at, k;
    int round;
    mp_real root[6][6];
    mp_run *run = &pass->run;
    for (round = 0; round < PASSES; round++) {
        long checkpoint;
        pass->reference = pass->estimate;
        pass->moved = end;
        *run = *in_ring(pass, 0);
        pass->runs = 1;
        checkpoint = run->at + CHECKPOINT;
        if (run->begun)
            mp_motion_of(&pass->vehicle, &pass->layout, &pass->held[(run->at - 1) % MP_HELD], &pass->reference, &pass->last);
        for (k = run->at; k < end; k++) {
            filtered(pass, &pass->held[k % MP_HELD], pass->room.rows, root);
            folded(pass, pass->room.rows);
            if (run->at < end && run->at < checkpoint) continue;
            mp_renew(&pass->vehicle, &pass->layout, run);
            if (run->at < end) pushed(pass);
            checkpoint = run->at + CHECKPOINT;
        }
        mp_improve(pass, run);
        pushed(pass);
        mp_pose(pass);
        if (mp_stands(pass)) return;
    }
}

/* Checkpoints that are too old, or too near one another, go. */
static void dropped(mp_pass *pass) {
    long oldest = pass->run.at - (pass->run.bound && !MP_ON_PEDESTAL(&pass->vehicle) ? MP_RING : MP_LEARNING);
    while (pass->runs > 0 && in_ring(pass, 0)->at < oldest) {
        pass->first = (pass->first + 1) % MP_CHECKPOINTS;
        pass->runs -= 1;
    }
    if (pass->runs > 1 && in_ring(pass, pass->runs - 1)->at - in_ring(pass, pass->runs - 2)->at < MP_BLOCK) pass->runs -= 1;
}

/* A block has ended: the estimate anew, and the latest cycles where it has moved. */
static void looked(mp_pass *pass, long length) {
    mp_run *run = &pass->run;
    int moved = 0;
    mp_renew(&pass->vehicle, &pass->layout, run);
    dropped(pass);
    if (pass->started) {
        mp_improve(pass, run);
        mp_pose(pass);
        moved = pass->spare >= 0 && !mp_stands(pass);
    } else if (run->at >= pass->due) {
        long next = run->at / 200;
        pass->due = run->at + (next > ATTEMPT ? next : ATTEMPT);
        moved = mp_start_found(&pass->vehicle, &pass->start, &pass->estimate);
        if (moved) {
            pass->centre = pass->estimate;
            if (MP_ON_BEARING(&pass->vehicle) && pass->vehicle.known_mass > R(0)) pass->centre.theta[9] = R(1) / pass->vehicle.known_mass;
            mp_sizes(&pass->vehicle, pass->centre.theta, pass->centre_sizes);
        }
    }
    pushed(pass);
    pass->spare += AGAIN * length;
    if (moved) {
        pass->spare -= run->at - in_ring(pass, 0)->at;
        again(pass);
        pass->started = 1;
    }
    length = (run->at - pass->moved) / 2;
    length = length < MP_BLOCK || !pass->started ? MP_BLOCK : length > MP_LONGEST ? MP_LONGEST : length;
    pass->block_begin = run->at;
    pass->block_end = run->at + length;
}

static int is_finite(const mp_vehicle *vehicle, const mp_cycle *cycle) {
    int fine = mp_finite(&cycle->end_s, 1) && mp_finite(&cycle->duration_s, 1), b;
    fine = fine && mp_finite(cycle->rate, 3) && mp_finite(cycle->rate_step, 3) && mp_finite(cycle->force, 3);
    fine = fine && mp_finite(cycle->up[0], 3) && mp_finite(cycle->up[1], 3) && mp_finite(cycle->carried, 3);
    fine = fine && mp_finite(cycle->rising, 6) && mp_finite(cycle->falling, 6) && mp_finite(cycle->whole, 6);
    fine = fine && mp_finite(cycle->impulse[0], 6 * vehicle->bins) && mp_finite(cycle->skew[0], 6 * vehicle->bins);
    for (b = 0; b < vehicle->bins && vehicle->wheels > 0; b++)
        fine = fine && mp_finite(cycle->momentum[b], vehicle->wheels) && mp_finite(cycle->growing[b], vehicle->wheels);
    for (b = 0; b < 3; b++) fine = fine && mp_finite(cycle->grown[b], vehicle->wheels);
    return fine && (!vehicle->pulses || mp_finite(cycle->pulse_covariance[0], 36));
}

/* Innovations as torque and force. */
static void innovated(const mp_pass *pass, const mp_cycle *cycle, mp_real root[6][6], mp_real unexplained[6], mp_real spread[6][6],
                      mp_row *row) {
    mp_real own[6][6];
    int i, j, k;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 6; j++) {
            own[i][j] = R(0);
            for (k = 0; k < 3; k++) own[i][j] += pass->estimate.inertia[i][k] / cycle->duration_s * root[k][j];
            own[3 + i][j] = root[3 + i][j] / pass->estimate.mu;
        }
    for (i = 0; i < 6; i++) {
        mp_real square = R(0);
        row->innovation[i] = R(0);
        for (j = 0; j < 6; j++) {
            mp_real sum = R(0);
            for (k = j; k < 6; k++) sum += own[i][k] * spread[k][j];
            square += sum * sum;
            row->innovation[i] += own[i][j] * unexplained[j];
        }
        row->sigma[i] = MP_SQRT(square);
    }
    for (i = 0; i < 3; i++) {
        row->rate[i] = cycle->rate[i];
        for (j = 0; j <= i; j++) row->rate[i] -= root[i][j] * unexplained[j];
    }
    for (i = 0; i < 2; i++) row->expected[i] = !cycle->deaf[i];
}

int mp_beyond(const mp_row *row, int sensor, mp_real gate) {
    const mp_real *own = row->normalised + 3 * sensor;
    return gate > R(0) && row->expected[sensor] && mp_dot(own, own) > gate * gate;
}

/* Whether an innovation is beyond the gate: then the filter is as it was before the cycle. */
static int refused(mp_pass *pass, const mp_real *gate, mp_row *row) {
    int i;
    for (i = 0; i < 2 && !row->beyond[0]; i++) row->beyond[i] = mp_beyond(row, i, gate[i]);
    if (!row->beyond[0] && !row->beyond[1]) return 0;
    pass->run.filter = pass->room.filter;
    return 1;
}

int mp_step(mp_pass *pass, const mp_cycle *cycle, const mp_real *gate, mp_row *row) {
    mp_real root[6][6], unexplained[6], spread[6][6];
    mp_run *run = &pass->run;
    int astray = 0, gated = gate != NULL && pass->started && !run->stuck;
    long length;
    if (!pass->ready) return MP_ORDER;
    if (!is_finite(&pass->vehicle, cycle)) return MP_NOT_FINITE;
    if (!(cycle->duration_s > R(0)) || (run->begun && !(cycle->end_s > pass->end_s))) return MP_TIME;
    memset(row, 0, sizeof *row);
    if (gated) pass->room.filter = run->filter;
    filtered(pass, cycle, pass->room.ordered, root);
    if (pass->started) {
        mp_judge(&pass->layout, &pass->posed, pass->room.ordered, pass->room.rows, row->normalised, unexplained, spread);
        innovated(pass, cycle, root, unexplained, spread, row);
    }
    if (gated && refused(pass, gate, row)) return MP_OK;
    if (!run->begun) pass->begun_s = cycle->end_s - cycle->duration_s;
    pass->end_s = cycle->end_s;
    pass->held[run->at % MP_HELD] = *cycle;
    if (pass->started) {
        mp_fold(pass->posed.triangle, pass->posed.count + 1, pass->room.rows, 6);
        astray = mp_estimate(pass, row) && pass->spare >= 0;
        row->told = !run->stuck;
    } else {
        mp_start_add(&pass->vehicle, &pass->start, cycle);
    }
    folded(pass, pass->room.ordered);
    if (astray) {
        pass->spare -= pass->block_end - run->at;
        pass->block_end = run->at;
    }
    if (run->at < pass->block_end) return MP_OK;
    length = run->at - pass->block_begin;
    looked(pass, length);
    if (!pass->started) return MP_OK;
    (void)mp_estimate(pass, row);
    row->told = !run->stuck;
    return MP_OK;
}
