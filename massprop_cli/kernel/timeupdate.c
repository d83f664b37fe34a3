#include "motion.h"

#include <math.h>
#include <string.h>

#include "linalg.h"

#define STEEP R(0.5) /* largest part of a rate's error that the gyroscopic coupling may add to it or take off within half a step */
#define WIDE R(1e3) /* rad/s, rad/s^2, of a rate, and of what a steady torque makes of it, of which nothing is known */

static const int FIRST[6] = {0, 0, 0, 1, 1, 2}, SECOND[6] = {0, 1, 2, 1, 2, 2};

/* Three states with this prior sigma where they are wanted: where they begin, -1 where they are not. */
static int triple_of(mp_layout *layout, int wanted, mp_real sigma, int *end) {
    int i, begin = *end;
    if (!wanted) return -1;
    for (i = 0; i < 3; i++) layout->prior[(*end)++] = sigma;
    return begin;
}

int mp_laid_out(const mp_vehicle *vehicle, mp_layout *layout) {
    int i, end = 3;
    layout->channels = vehicle->bearing == 1 ? 15 : 12;
    layout->coefficients = 3 * layout->channels + 4;
    layout->beginnings = 3 * (1 + vehicle->gyro_bias + vehicle->accel_bias + vehicle->slow_torque + vehicle->tilt);
    if (vehicle->wheels > MP_WHEELS || (vehicle->bearing && !MP_PIVOTED)) return MP_LIMIT;
    layout->scales = 0;
    for (i = -1; i < vehicle->wheels; i++)
        if (vehicle->wheels > 0 && (i < 0 ? vehicle->thrust_sigma : vehicle->spin_sigma[i]) > R(0)) layout->scale[layout->scales++] = i;
    layout->beginnings += layout->scales;
    if (layout->channels > MP_CHANNELS || layout->beginnings > MP_BEGINNINGS) return MP_LIMIT;
    if (vehicle->bins < 2 || vehicle->bins > MP_BINS) return MP_LIMIT;
    for (i = 0; i < 3; i++) layout->prior[i] = WIDE;
    layout->at_bias = triple_of(layout, vehicle->gyro_bias, vehicle->gyro_bias_sigma, &end);
    layout->at_accel = triple_of(layout, vehicle->accel_bias, vehicle->accel_bias_sigma, &end);
    layout->at_torque = triple_of(layout, vehicle->slow_torque, WIDE, &end);
    layout->at_tilt = triple_of(layout, vehicle->tilt, vehicle->gyro_noise, &end);
    layout->at_scale = end;
    for (i = 0; i < layout->scales; i++)
        layout->prior[end++] = layout->scale[i] < 0 ? vehicle->thrust_sigma : vehicle->spin_sigma[layout->scale[i]];
    layout->states = end;
    layout->width = 1 + layout->coefficients + layout->beginnings;
    layout->process = 3 * ((vehicle->torque_noise > R(0)) + vehicle->slow_torque + (vehicle->gyro_bias && vehicle->gyro_bias_walk > R(0)) + 2 * vehicle->pulses);
    return MP_OK;
}

void mp_coupled(const mp_reference *about, int channels, const mp_real rate[3], const mp_real *stored, mp_real out[3][3]) {
    mp_real by[6][3], size = R(0), turned[3][3], inverse[3][3], across[3][3];
    int i, j, k;
    memset(by, 0, sizeof by);
    for (k = 0; k < 6; k++) {
        by[k][FIRST[k]] += rate[SECOND[k]];
        by[k][SECOND[k]] += rate[FIRST[k]];
    }
    memset(turned, 0, sizeof turned);
    if (stored != NULL) {
        mp_tensor(about->theta, inverse);
        mp_cross_matrix(stored, across);
        mp_product((const mp_real(*)[3])inverse, (const mp_real(*)[3])across, turned);
    }
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            mp_real sum = turned[i][j];
            for (k = 0; k < 6; k++) sum += about->phi[i][channels - 6 + k] * by[k][j];
            out[i][j] = sum;
            size += sum * sum;
        }
    size = MP_SQRT(size);
    if (size > STEEP)
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) out[i][j] *= STEEP / size;
}

/* What hangs on a bearing turns meanwhile by an error of the rate, under one half of the window two thirds or one third of the cycle. */
static void meanwhile(const mp_vehicle *vehicle, const mp_reference *about, const mp_motion *here, int half, mp_real out[3][3]) {
    mp_real inverse[3][3], by[3][3], turned[3][3];
    int i, j;
    mp_tensor(about->theta, inverse);
    mp_moment_by_tilt(vehicle, about, here, half, R(0), by);
    mp_product((const mp_real(*)[3])inverse, (const mp_real(*)[3])by, turned);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) out[i][j] += turned[i][j] * (R(2 - half) / R(3) * here->duration_s);
}

void mp_time_update_of(const mp_vehicle *vehicle, const mp_layout *layout, const mp_motion *from, const mp_motion *into,
                const mp_reference *about, mp_time_update *out) {
    mp_real leaving[3][3], entering[3][3], inverse[3][3], part[3][3], gone[3], come[3], known[3], mean_s;
    int i, j, q = 0;
    memset(out->transition, 0, sizeof out->transition);
    memset(out->process, 0, sizeof out->process);
    memset(out->drive, 0, sizeof out->drive);
    mp_coupled(about, layout->channels, from->turning[0], vehicle->wheels > 0 ? from->stored[0] : NULL, leaving);
    mp_coupled(about, layout->channels, into->turning[1], vehicle->wheels > 0 ? into->stored[1] : NULL, entering);
    if (MP_ON_BEARING(vehicle)) {
        meanwhile(vehicle, about, from, 0, leaving);
        meanwhile(vehicle, about, into, 1, entering);
    }
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) part[i][j] = (i == j ? R(1) : R(0)) - entering[i][j];
    mp_inverse((const mp_real(*)[3])part, out->solve);
    mp_tensor(about->theta, inverse);
    mp_product((const mp_real(*)[3])out->solve, (const mp_real(*)[3])inverse, out->to_rate);
    mp_times((const mp_real(*)[3])leaving, from->rate, gone);
    mp_times((const mp_real(*)[3])entering, into->rate, come);
    for (i = 0; i < 3; i++) {
        known[i] = from->known[0][i] + into->known[1][i] - gone[i] - come[i];
        leaving[i][i] += R(1);
    }
    mp_times((const mp_real(*)[3])out->solve, known, out->drive);
    mp_product((const mp_real(*)[3])out->solve, (const mp_real(*)[3])leaving, part);
    for (i = 0; i < layout->channels; i++) out->step[i] = from->rising[i] + into->falling[i];
    for (i = 0; i < layout->states; i++) out->transition[i][i] = R(1);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) out->transition[i][j] = part[i][j];
    mean_s = (from->duration_s + into->duration_s) / R(2);
    if (layout->at_torque >= 0)
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) out->transition[i][layout->at_torque + j] = out->solve[i][j] * mean_s;
    if (layout->at_tilt >= 0) {
        mp_real by[3][3], leaving_tilt[3][3], entering_tilt[3][3], kept[3][3], by_error[3][3], turn[3], lost[3], added[3];
        int t = layout->at_tilt;
        for (i = 0; i < 3; i++) turn[i] = -from->rate[i] * from->duration_s;
        mp_rotations(turn, kept, by_error);
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) by_error[i][j] *= from->duration_s;
        mp_times((const mp_real(*)[3])by_error, from->carried, lost);
        mp_moment_by_tilt(vehicle, about, from, 0, R(2) / R(3), by);
        mp_product((const mp_real(*)[3])out->to_rate, (const mp_real(*)[3])by, leaving_tilt);
        mp_moment_by_tilt(vehicle, about, into, 1, R(1) / R(3), by);
        mp_product((const mp_real(*)[3])out->to_rate, (const mp_real(*)[3])by, entering_tilt);
        mp_times((const mp_real(*)[3])entering_tilt, lost, added);
        mp_product((const mp_real(*)[3])entering_tilt, (const mp_real(*)[3])kept, part);
        mp_product((const mp_real(*)[3])entering_tilt, (const mp_real(*)[3])by_error, by);
        for (i = 0; i < 3; i++) {
            for (j = 0; j < 3; j++) {
                out->transition[i][t + j] = leaving_tilt[i][j] + part[i][j];
                out->transition[i][j] += by[i][j];
                out->transition[t + i][t + j] = kept[i][j];
                out->transition[t + i][j] = by_error[i][j];
            }
            out->drive[i] -= added[i];
            out->drive[t + i] = -lost[i];
        }
    }
    for (i = 0; i < layout->scales; i++) {
        mp_real moment[3], growth[3];
        for (j = 0; j < 3; j++) moment[j] = from->scaled[i][0][j] + into->scaled[i][1][j];
        mp_times((const mp_real(*)[3])out->to_rate, moment, growth);
        for (j = 0; j < 3; j++) out->transition[j][layout->at_scale + i] = growth[j];
    }
    if (vehicle->gyro_bias && vehicle->gyro_bias_walk > R(0)) {
        for (i = 0; i < 3; i++) out->process[layout->at_bias + i][q + i] = vehicle->gyro_bias_walk * MP_SQRT(into->duration_s);
        q += 3;
    }
    if (vehicle->torque_noise > R(0)) {
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) out->process[i][q + j] = out->to_rate[i][j] * (vehicle->torque_noise * into->duration_s);
        q += 3;
    }
    if (vehicle->slow_torque) {
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) out->process[layout->at_torque + i][q + j] = inverse[i][j] * vehicle->torque_walk;
        q += 3;
    }
    if (vehicle->pulses) {
        const mp_motion *both[2] = {from, into};
        mp_real half = MP_SQRT(R(0.5)); /* a cycle's pulses turn the rate in the step into it and in the one out of it */
        int k;
        for (k = 0; k < 2; k++, q += 3) {
            mp_product((const mp_real(*)[3])out->to_rate, (const mp_real(*)[3])both[k]->pulse_root, part);
            for (i = 0; i < 3; i++)
                for (j = 0; j < 3; j++) out->process[i][q + j] = half * part[i][j];
        }
    }
}
