#include "preprocess.h"

#include <math.h>
#include <string.h>

#include "executed.h"
#include "linalg.h"

#define FARTHEST R(3)     /* sigmas of the gyro's bias beyond which it is none */
#define MOST_TURN R(3)    /* rad that a vehicle turns in a cycle, at most, */
#define MOST_JUMP R(0.3)  /* and beyond what it turned in the one before, unless MP_BELIEVED cycles in a row say so; */
#define MOST_FORCE R(1e4) /* m/s^2 of specific force */
#define MOST R(1e9)       /* of any command or speed */
#define LATE R(1e-3)      /* part of a period by which an on-time may be longer, and counts as all of it */
#define LONGEST R(5)      /* periods that a cycle lasts, at most, */
#define SHORTEST R(1e-3)  /* and at least: over less, increments and impulses are no rates and torques of numbers that can be held */
#define GAP R(1e6)        /* periods from the last cycle to the next, at most: later ones would all come before a stamp that is wrong */
#define OVERLAP R(0.5)    /* part of a period by which a cycle may begin before the end of the last: stamps scatter */

int mp_preprocess_begin(mp_preprocess *preprocess, const mp_commands *table, const mp_vehicle *vehicle) {
    mp_real ramps = R(0), latest = R(0);
    int i;
    preprocess->ready = 0;
    if (table->commands > MP_COMMANDS || (!table->jets && table->commands != 6)) return MP_LIMIT;
    if (vehicle->bins < 2 || vehicle->bins > MP_BINS || vehicle->wheels > MP_WHEELS || !(table->period_s > R(0))) return MP_LIMIT;
    for (i = 0; i < table->commands; i++) ramps = mp_max(ramps, table->rise_s[i] + table->fall_s[i] + table->own_delay_s[i]);
    for (i = 0; i < MP_SENSORS; i++) latest = mp_max(latest, table->sensor[i].latency_s);
    if (!((table->delay_s + ramps + latest) / table->period_s + R(4) < R(MP_PENDING))) return MP_LIMIT;
    memset(preprocess, 0, sizeof *preprocess);
    preprocess->table = *table;
    preprocess->vehicle = *vehicle;
    for (i = 0; i < 4; i++) preprocess->turned.attitude[i] = table->attitude_wxyz[i];
    preprocess->ready = 1;
    return MP_OK;
}

/* Wheels, whose speeds change evenly from one cycle's end to the next: what they store, and what the vehicle feels of it. */
static void wheels(mp_preprocess *preprocess, const mp_flown *flown, mp_cycle *cycle) {
    const mp_vehicle *vehicle = &preprocess->vehicle;
    mp_real parts = R(vehicle->bins), bin_s = cycle->duration_s / parts;
    int b, w, i;
    for (w = 0; w < vehicle->wheels; w++) {
        mp_real begun = vehicle->spin_inertia[w] * (preprocess->spun ? preprocess->speed[w] : flown->speed[w]);
        mp_real growth = vehicle->spin_inertia[w] * flown->speed[w] - begun;
        for (b = 0; b < vehicle->bins; b++) {
            cycle->momentum[b][w] = begun + growth * ((R(b) + R(0.5)) / parts);
            cycle->growing[b][w] = growth / parts * bin_s / R(12);
            for (i = 0; i < 3; i++) cycle->impulse[b][i] -= vehicle->axis[w][i] * (growth / parts);
        }
        cycle->grown[0][w] = cycle->grown[1][w] = growth / R(2);
        cycle->grown[2][w] = growth;
        for (i = 0; i < 3; i++) {
            cycle->rising[i] -= vehicle->axis[w][i] * cycle->grown[0][w];
            cycle->falling[i] -= vehicle->axis[w][i] * cycle->grown[1][w];
            cycle->whole[i] -= vehicle->axis[w][i] * cycle->grown[2][w];
        }
        preprocess->speed[w] = flown->speed[w];
    }
    preprocess->spun = 1;
}

/* World from body. */
static void matrix(const mp_real q[4], mp_real out[3][3]) {
    mp_real w = q[0], x = q[1], y = q[2], z = q[3];
    out[0][0] = R(1) - R(2) * (y * y + z * z);
    out[0][1] = R(2) * (x * y - w * z);
    out[0][2] = R(2) * (x * z + w * y);
    out[1][0] = R(2) * (x * y + w * z);
    out[1][1] = R(1) - R(2) * (x * x + z * z);
    out[1][2] = R(2) * (y * z - w * x);
    out[2][0] = R(2) * (x * z - w * y);
    out[2][1] = R(2) * (y * z + w * x);
    out[2][2] = R(1) - R(2) * (x * x + y * y);
}

static void product(const mp_real a[4], const mp_real b[4], mp_real out[4]) {
    mp_real cross[3];
    int i;
    mp_cross(a + 1, b + 1, cross);
    out[0] = a[0] * b[0] - mp_dot(a + 1, b + 1);
    for (i = 0; i < 3; i++) out[1 + i] = a[0] * b[1 + i] + b[0] * a[1 + i] + cross[i];
}

/* The rotation by a vector. */
static void quaternion(const mp_real vector[3], mp_real out[4]) {
    mp_real half = mp_dot(vector, vector) / R(4), cosine = R(1), sine = R(1), term = R(1);
    int i, k;
    for (k = 1; k <= TERMS; k++) {
        term *= -half / R((2 * k - 1) * (2 * k));
        cosine += term;
        sine += term / R(2 * k + 1);
    }
    out[0] = cosine;
    for (i = 0; i < 3; i++) out[1 + i] = vector[i] * (sine / R(2));
}

/* q <- q times the rotation by a vector, of length one. */
static void rotated(mp_real q[4], const mp_real vector[3]) {
    mp_real by[4], out[4], size;
    int i;
    quaternion(vector, by);
    product(q, by, out);
    size = MP_SQRT(out[0] * out[0] + out[1] * out[1] + out[2] * out[2] + out[3] * out[3]);
    for (i = 0; i < 4; i++) q[i] = out[i] / size;
}

/* World's vertical in body axes, less what the attitude is off by. */
static void vertical(const mp_real q[4], const mp_real back[4], mp_real out[3]) {
    mp_real freed[4], rotation[3][3];
    int i;
    product(back, q, freed);
    matrix(freed, rotation);
    for (i = 0; i < 3; i++) out[i] = rotation[2][i];
}

/* By how much the attitude is off at a cycle's end, by the gyro's bias as the estimate has it. */
static void carried_off(mp_preprocess *preprocess, const mp_cycle *cycle, const mp_real mean[3][3]) {
    mp_real bias[3], size = MP_SQRT(mp_dot(preprocess->bias, preprocess->bias)), sigma = preprocess->vehicle.gyro_bias_sigma;
    int i, j;
    for (i = 0; i < 3; i++) bias[i] = preprocess->bias[i] * mp_min(R(1), FARTHEST * sigma / mp_max(size, sigma));
    for (i = 0; i < 3; i++) {
        for (j = 0; j < 3; j++) preprocess->turned.window[i][j] += mean[i][j] * cycle->duration_s;
        preprocess->turned.off[i] = mp_dot(preprocess->turned.window[i], bias);
    }
}

/* Where the attitude may be at the start of a cycle. */
static void attitude_error(mp_preprocess *preprocess, const mp_real from_body[3][3], int biased) {
    int i, j, k;
    for (i = 0; i < 3; i++) {
        preprocess->attitude_error[i][0] = R(0);
        preprocess->attitude_error[i][4] = MP_SQRT(preprocess->turned.squares_s2);
        for (j = 0; j < 3; j++) preprocess->attitude_error[i][1 + j] = R(0);
        if (!biased) continue;
        for (k = 0; k < 3; k++) preprocess->attitude_error[i][0] += from_body[k][i] * preprocess->turned.off[k];
        for (j = 0; j < 3; j++) {
            for (k = 0; k < 3; k++) preprocess->attitude_error[i][1 + j] -= from_body[k][i] * preprocess->turned.window[k][j];
        }
    }
}

/* q of the rotation back by what the attitude is off. */
static void backed(const mp_preprocess *preprocess, mp_real out[4]) {
    mp_real back[3];
    int i;
    for (i = 0; i < 3; i++) back[i] = -preprocess->turned.off[i];
    quaternion(back, out);
}

/* The vertical at both ends of a cycle, how the attitude is carried from one to the other, and what that makes of the weight as felt. */
static void attitudes(mp_preprocess *preprocess, mp_cycle *cycle) {
    mp_real turn[3], coning[3], first[3][3], mean[3][3], back[4], then[4], step[4], mean_up[3], swung[3], bent[3];
    int biased = MP_ON_BEARING(&preprocess->vehicle) && preprocess->vehicle.gyro_bias, i, j;
    for (i = 0; i < 3; i++) {
        cycle->carried[i] = cycle->rate[i];
        cycle->force[i] = preprocess->felt[i];
    }
    if (!MP_ON_BEARING(&preprocess->vehicle)) {
        memset(cycle->up, 0, sizeof cycle->up);
        return;
    }
    for (i = 0; i < 3; i++) turn[i] = cycle->rate[i] * cycle->duration_s;
    if (preprocess->cycles == 0) { /* where the motion begins that the gyro shows later than it is labelled */
        mp_real before[3], late = mp_sampled_later(&preprocess->table) - preprocess->table.sensor[MP_MOVES].latency_s;
        for (i = 0; i < 3; i++) before[i] = cycle->rate[i] * late;
        rotated(preprocess->turned.attitude, before);
    }
    backed(preprocess, back);
    vertical(preprocess->turned.attitude, back, cycle->up[0]);
    matrix(preprocess->turned.attitude, first);
    attitude_error(preprocess, (const mp_real(*)[3])first, biased);
    mp_cross(preprocess->turned.turn, turn, coning);
    for (i = 0; i < 3; i++) coning[i] = turn[i] + coning[i] / R(12);
    rotated(preprocess->turned.attitude, coning);
    if (biased) {
        matrix(preprocess->turned.attitude, mean);
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) mean[i][j] = (mean[i][j] + first[i][j]) / R(2);
        carried_off(preprocess, cycle, (const mp_real(*)[3])mean);
        for (i = 0; i < 3; i++) back[1 + i] = -back[1 + i];
        backed(preprocess, then);
        product(back, then, step);
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) cycle->carried[i] += mean[j][i] * (R(2) * step[1 + j]) / cycle->duration_s;
    }
    backed(preprocess, then);
    vertical(preprocess->turned.attitude, then, cycle->up[1]);
    for (i = 0; i < 3; i++) {
        preprocess->turned.turn[i] = turn[i];
        mean_up[i] = (cycle->up[0][i] + cycle->up[1][i]) / R(2);
    }
    mp_cross(mean_up, cycle->rate, swung); /* the weight as it was when the gyro's motion was, and not smeared */
    mp_cross(swung, cycle->rate, bent);
    for (i = 0; i < 3; i++)
        cycle->force[i] -= preprocess->vehicle.gravity * (preprocess->vehicle.later * swung[i] + preprocess->vehicle.smearing * bent[i]);
    preprocess->turned.squares_s2 += cycle->duration_s * cycle->duration_s;
}

static int beyond(const mp_real v[3], mp_real most) { return !(mp_dot(v, v) < most * most); }

/* Whether the gyro shows more than a vehicle turns in a cycle: a spike, which the estimate would not forget. */
static int spiked(mp_preprocess *preprocess, const mp_real rate[3], mp_real duration_s) {
    mp_real jump[3];
    int i;
    for (i = 0; i < 3; i++) jump[i] = rate[i] - preprocess->turned.rate[i];
    if (beyond(rate, MOST_TURN / duration_s)) return 1;
    preprocess->jumped = preprocess->cycles > 0 && beyond(jump, MOST_JUMP / duration_s) ? preprocess->jumped + 1 : 0;
    if (preprocess->jumped > MP_BELIEVED) preprocess->jumped = 0;
    return preprocess->jumped > 0;
}

/* The body's turn in a cycle by a mean rate. */
static void turned(mp_preprocess *preprocess, const mp_real rate[3], mp_cycle *cycle) {
    int i;
    for (i = 0; i < 3; i++) {
        cycle->rate[i] = rate[i];
        cycle->rate_step[i] = preprocess->cycles > 0 ? rate[i] - preprocess->before.rate[i] : R(0);
        preprocess->turned.rate[i] = rate[i];
    }
    attitudes(preprocess, cycle);
}

/* A cycle whose executed commands are known. */
static void completed(mp_preprocess *preprocess, const mp_flown *flown, mp_cycle *cycle, int *usable) {
    const mp_vehicle *vehicle = &preprocess->vehicle;
    mp_real theta[3], rate[3], v[3], rounding;
    int i, spike[2];
    cycle->end_s = flown->end_s;
    cycle->duration_s = flown->duration_s;
    spike[1] = beyond(flown->delta_v, MOST_FORCE * flown->duration_s);
    for (i = 0; i < 3; i++) {
        theta[i] = flown->delta_theta[i] / flown->duration_s;
        v[i] = spike[1] ? R(0) : flown->delta_v[i] / flown->duration_s;
    }
    mp_times((const mp_real(*)[3])preprocess->table.body_from_imu, theta, rate);
    mp_times((const mp_real(*)[3])preprocess->table.body_from_imu, v, preprocess->felt);
    spike[0] = spiked(preprocess, rate, flown->duration_s);
    for (i = 0; i < 2; i++) cycle->deaf[i] = flown->deaf[i] || spike[i];
    preprocess->before = preprocess->turned;
    turned(preprocess, spike[0] ? preprocess->before.rate : rate, cycle);
    mp_executed(preprocess, cycle);
    *usable = !flown->unused && (preprocess->spun || vehicle->wheels == 0);
    wheels(preprocess, flown, cycle);
    /* on the ground `unused` says so too, more strictly (massprop_cli/prepare/align.py): rounding must not make two answers of it */
    rounding = R(2e-6) * preprocess->table.period_s + R(2e-15) * mp_abs(flown->end_s);
    *usable = *usable && preprocess->since_s >= preprocess->table.memory_s - rounding;
    preprocess->since_s += flown->duration_s;
    preprocess->cycles += 1;
}

void mp_preprocess_without_gyro(mp_preprocess *preprocess, const mp_real rate[3], mp_cycle *cycle) {
    preprocess->turned = preprocess->before;
    cycle->deaf[0] = 1;
    turned(preprocess, beyond(rate, MOST_TURN / cycle->duration_s) ? preprocess->before.rate : rate, cycle);
}

void mp_preprocess_without_accelerometer(mp_cycle *cycle) {
    cycle->deaf[1] = 1;
    memset(cycle->force, 0, sizeof cycle->force);
}

/* Whether it is finite, and its commands are such as can be executed: on-times of 0 ... one period. */
static int is_finite(const mp_preprocess *preprocess, const mp_flown *flown) {
    const mp_commands *table = &preprocess->table;
    mp_real least = table->jets ? R(0) : -MOST, most = table->jets ? table->period_s * (R(1) + LATE) : MOST;
    int fine = mp_finite(&flown->end_s, 1) && mp_finite(&flown->duration_s, 1), i;
    for (i = 0; i < table->commands; i++) fine = fine && flown->command[i] >= least && flown->command[i] <= most;
    for (i = 0; i < preprocess->vehicle.wheels; i++) fine = fine && mp_abs(flown->speed[i]) < MOST;
    return fine && mp_finite(flown->delta_theta, 3) && mp_finite(flown->delta_v, 3);
}

/* Whether a cycle has a length that can be, and does not begin before the end of the last one, nor an age after it. */
static int follows(const mp_preprocess *preprocess, const mp_flown *flown) {
    mp_real period_s = preprocess->table.period_s, beginning = flown->end_s - flown->duration_s;
    mp_real rounding = R(4) * MP_EPSILON * mp_abs(flown->end_s);
    if (!(flown->duration_s >= SHORTEST * period_s && flown->duration_s <= LONGEST * period_s)) return 0;
    if (!preprocess->told) return 1;
    if (!(beginning <= preprocess->end_s + GAP * period_s)) return 0;
    return flown->end_s > preprocess->end_s && beginning >= preprocess->end_s - OVERLAP * period_s - rounding;
}

int mp_preprocess_step(mp_preprocess *preprocess, const mp_flown *flown, mp_cycle *cycle, int *made, int *usable) {
    *made = 0;
    if (!preprocess->ready) return MP_ORDER;
    if (!is_finite(preprocess, flown)) return MP_NOT_FINITE;
    if (!follows(preprocess, flown)) return MP_TIME;
    mp_issued(preprocess, flown, preprocess->holding ? preprocess->waiting.duration_s : R(0));
    preprocess->end_s = flown->end_s;
    preprocess->told = 1;
    if (!preprocess->table.waits) {
        completed(preprocess, flown, cycle, usable);
        *made = 1;
        return MP_OK;
    }
    if (preprocess->holding) {
        completed(preprocess, &preprocess->waiting, cycle, usable);
        *made = 1;
    }
    preprocess->waiting = *flown;
    preprocess->holding = 1;
    return MP_OK;
}

int mp_preprocess_last(mp_preprocess *preprocess, mp_cycle *cycle, int *made, int *usable) {
    *made = 0;
    if (!preprocess->ready) return MP_ORDER;
    *made = preprocess->holding;
    if (preprocess->holding) completed(preprocess, &preprocess->waiting, cycle, usable);
    preprocess->holding = 0;
    return MP_OK;
}
