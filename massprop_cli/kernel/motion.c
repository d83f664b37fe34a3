#include "motion.h"

#include <math.h>
#include <string.h>

#include "intracycle.h"
#include "linalg.h"

#define DEAF R(1e8)  /* by how much louder the noise is of a reading that is not used */

/* An integral over the bins under the rising half of the window, and plain. */
static void windowed(mp_real *rising, mp_real *whole, mp_real value, int b, int count, mp_real bin_s) {
    *rising += (R(b) + R(0.5)) / R(count) * value * bin_s;
    *whole += value * bin_s;
}

/* The torque of a wrench about the centre in place of O, whose force the bearing takes up. */
static void about_centre(const mp_real centre[3], mp_real wrench[6]) {
    mp_real moment[3];
    int i;
    mp_cross(centre, wrench + 3, moment);
    for (i = 0; i < 3; i++) {
        wrench[i] -= moment[i];
        wrench[3 + i] = R(0);
    }
}

/* To what is level of the force by its bins, `forced` under the rising half of the window and over the cycle: what the windows of the sensors
 * hold of the force beyond that, level where the vertical is as in the cycle's mean, `up` times its length. */
static void sensed(const mp_cycle *cycle, const mp_real up[3], mp_real forced[2][3], mp_real rising[3], mp_real falling[3],
                   mp_real whole[3]) {
    mp_real mean[3], beyond[3][3], flat[3];
    int i, j;
    for (i = 0; i < 3; i++) {
        mean[i] = up[i] / cycle->duration_s;
        beyond[0][i] = cycle->rising[3 + i] - forced[0][i];
        beyond[1][i] = cycle->falling[3 + i] - (forced[1][i] - forced[0][i]);
        beyond[2][i] = cycle->whole[3 + i] - forced[1][i];
    }
    for (j = 0; j < 3; j++) {
        mp_real *onto = j == 0 ? rising : j == 1 ? falling : whole;
        mp_level(mean, beyond[j], flat);
        for (i = 0; i < 3; i++) onto[i] += flat[i];
    }
}

/* To the impulses under the halves of the window and over the cycle: torque by wheels and the motion; or -w x h alone of what `one` stores
 * by a unit of its scale. All of them: -1. */
static void stored(const mp_vehicle *vehicle, const mp_cycle *cycle, const mp_bin *bins, int one, mp_real rising[3], mp_real falling[3],
                   mp_real whole[3]) {
    int count = vehicle->bins, b, i;
    mp_real bin_s = cycle->duration_s / R(count), made[2][3] = {{R(0), R(0), R(0)}, {R(0), R(0), R(0)}}, steady[3];
    mp_mean_rate_dot(vehicle, bins, steady);
    for (b = 0; b < count; b++) {
        mp_real mean[3], growing[3], torque[3], late[3];
        if (one < 0) {
            mp_by_wheels(vehicle, cycle, bins + b, b, steady, torque, late);
        } else {
            mp_momentum_of(vehicle, cycle, b, one, mean, growing);
            mp_precession(bins[b].rate, bins[b].rate_dot, mean, growing, bin_s * bin_s / R(12), torque, late);
        }
        for (i = 0; i < 3; i++) {
            windowed(made[0] + i, made[1] + i, torque[i], b, count, bin_s);
            made[0][i] += late[i] / R(count);
        }
    }
    for (i = 0; i < 3; i++) {
        rising[i] += made[0][i];
        falling[i] += made[1][i] - made[0][i];
        whole[i] += made[1][i];
    }
}

/* The momentum of wheels under the halves of the window. */
static void stored_windows(const mp_vehicle *vehicle, const mp_cycle *cycle, mp_real out[2][3]) {
    int count = vehicle->bins, b, i;
    mp_real bin_s = cycle->duration_s / R(count);
    memset(out, 0, 2 * sizeof out[0]);
    for (b = 0; b < count; b++) {
        mp_real mean[3], growing[3];
        mp_momentum_of(vehicle, cycle, b, -1, mean, growing);
        for (i = 0; i < 3; i++) {
            windowed(out[0] + i, out[1] + i, mean[i], b, count, bin_s);
            out[0][i] += growing[i] / R(count);
        }
    }
    for (i = 0; i < 3; i++) out[1][i] -= out[0][i];
}

/* What phi multiplies, under the rising half of the window, and over the whole cycle. */
static void integrals(const mp_vehicle *vehicle, const mp_layout *layout, const mp_cycle *cycle, const mp_reference *about,
                      const mp_bin *bins, mp_real rates[2][3], mp_real ups[2][3], mp_motion *out, mp_real whole[MP_CHANNELS]) {
    int count = vehicle->bins, channels = layout->channels, b, i;
    mp_real bin_s = cycle->duration_s / R(count), squared = bin_s * bin_s / R(12), late_s = bin_s / R(12) - vehicle->curvature / bin_s;
    mp_real *rising = out->rising, *falling = out->falling, ends[2][6], forced[2][3];
    memset(forced, 0, sizeof forced);
    memset(rising, 0, sizeof out->rising);
    memset(whole, 0, MP_CHANNELS * sizeof whole[0]);
    memset(out->known, 0, sizeof out->known);
    memset(out->turning, 0, sizeof out->turning);
    memset(out->up, 0, sizeof out->up);
    for (i = 0; i < 6; i++) {
        rising[i] = cycle->rising[i];
        falling[i] = cycle->falling[i];
        whole[i] = cycle->whole[i];
    }
    if (MP_ON_BEARING(vehicle)) {
        about_centre(vehicle->centre, rising);
        about_centre(vehicle->centre, falling);
        about_centre(vehicle->centre, whole);
    }
    if (vehicle->wheels > 0) {
        stored(vehicle, cycle, bins, -1, rising, falling, whole);
        stored_windows(vehicle, cycle, out->stored);
    }
    for (b = 0; b < count; b++) {
        const mp_bin *here = bins + b;
        mp_real s[6], by[6];
        mp_products(here->rate, s);
        mp_products(here->rate_dot, by);
        for (i = 0; i < 6; i++) windowed(rising + channels - 6 + i, whole + channels - 6 + i, s[i] + by[i] * squared, b, count, bin_s);
        for (i = 0; i < 3; i++) windowed(out->turning[0] + i, out->turning[1] + i, here->rate[i], b, count, bin_s);
        if (MP_ON_BEARING(vehicle))
            for (i = 0; i < 3; i++) {
                windowed(rising + 3 + i, whole + 3 + i, here->up[i], b, count, bin_s);
                windowed(out->up[0] + i, out->up[1] + i, here->up[i], b, count, bin_s);
            }
        if (MP_SLIDES(vehicle)) {
            mp_real flat[3], late[3], swung[3];
            mp_level(here->up, here->wrench + 3, flat);
            mp_level(here->up, cycle->skew[b] + 3, late);
            mp_swing(about, here, swung);
            for (i = 0; i < 3; i++) {
                windowed(forced[0] + i, forced[1] + i, here->wrench[3 + i], b, count, bin_s);
                forced[0][i] += cycle->skew[b][3 + i] / R(count);
                windowed(rising + 6 + i, whole + 6 + i, flat[i], b, count, bin_s);
                windowed(out->known[0] + i, out->known[1] + i, swung[i], b, count, bin_s);
                rising[6 + i] += late[i] / R(count);
            }
        }
    }
    mp_products(rates[0], ends[0]);
    mp_products(rates[1], ends[1]);
    for (i = 0; i < 6; i++) rising[channels - 6 + i] += (ends[1][i] - ends[0][i]) * late_s / R(count);
    for (i = 0; i < 3; i++) {
        out->turning[0][i] += (rates[1][i] - rates[0][i]) * bin_s / R(12) / R(count);
        if (MP_ON_BEARING(vehicle)) rising[3 + i] += (ups[1][i] - ups[0][i]) * late_s / R(count);
    }
    for (i = MP_ON_BEARING(vehicle) ? 3 : 6; i < channels; i++) falling[i] = whole[i] - rising[i];
    for (i = 0; i < 6; i++) whole[channels - 6 + i] += (ends[1][i] - ends[0][i]) * vehicle->later;
    if (MP_SLIDES(vehicle)) sensed(cycle, out->up[1], forced, rising + 6, falling + 6, whole + 6);
    for (i = 0; i < channels; i++) {
        whole[i] /= cycle->duration_s;
        out->mean[i] = whole[i];
    }
    for (i = 0; i < 3; i++) {
        out->known[1][i] -= out->known[0][i];
        out->turning[1][i] -= out->turning[0][i];
        out->up[1][i] -= out->up[0][i];
    }
}

/* The specific force in terms of phi, mu, and c or mu kappa. */
static void felt(const mp_vehicle *vehicle, const mp_layout *layout, const mp_cycle *cycle, const mp_reference *about, const mp_bin *bins,
                 mp_motion *out) {
    mp_real dot[3], centripetal[3][3], rotation[3][3], arm[3], part[3], trace;
    int i, j, b, channels = layout->channels;
    for (i = 0; i < 3; i++) {
        mp_real sum = R(0);
        for (j = 0; j < channels; j++) sum += about->phi[i][j] * out->mean[j];
        dot[i] = sum + about->acceleration[i];
    }
    mp_tensor(out->mean + channels - 6, centripetal);
    trace = centripetal[0][0] + centripetal[1][1] + centripetal[2][2];
    for (i = 0; i < 3; i++) centripetal[i][i] -= trace;
    mp_cross_matrix(dot, rotation);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) rotation[i][j] += centripetal[i][j];
    if (MP_ON_PEDESTAL(vehicle)) {
        for (i = 0; i < 3; i++) arm[i] = vehicle->imu[i] - vehicle->centre[i];
        mp_cross_matrix(arm, out->euler);
        mp_times((const mp_real(*)[3])centripetal, arm, part);
        memset(out->own, 0, sizeof out->own);
        for (i = 0; i < 3; i++) {
            for (j = 0; j < 3; j++) out->euler[i][j] = -out->euler[i][j];
            out->measured[i] = cycle->force[i] - (vehicle->gravity * out->mean[3 + i] + part[i]);
        }
    } else if (MP_SLIDES(vehicle)) {
        mp_real kappa[3], along[3][3], flat[3][3], swung[3][3], seen[3][3], other[3];
        for (i = 0; i < 3; i++) {
            arm[i] = vehicle->imu[i] - vehicle->centre[i];
            kappa[i] = about->theta[9] * about->theta[6 + i];
        }
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) {
                mp_real sum = R(0);
                for (b = 0; b < vehicle->bins; b++) sum += bins[b].up[i] * bins[b].up[j];
                flat[i][j] = (i == j ? R(1) : R(0)) - sum / R(vehicle->bins);
            }
        mp_cross_matrix(kappa, along);
        mp_product((const mp_real(*)[3])flat, (const mp_real(*)[3])along, swung);
        mp_product((const mp_real(*)[3])flat, (const mp_real(*)[3])rotation, seen);
        mp_cross_matrix(arm, out->euler);
        mp_times((const mp_real(*)[3])centripetal, arm, part);
        mp_times((const mp_real(*)[3])swung, dot, other);
        for (i = 0; i < 3; i++) {
            out->own[i][0] = out->mean[6 + i];
            for (j = 0; j < 3; j++) {
                out->euler[i][j] = swung[i][j] - out->euler[i][j];
                out->own[i][1 + j] = -seen[i][j];
            }
            out->measured[i] = cycle->force[i] - (vehicle->gravity * out->mean[3 + i] + part[i] - other[i]);
        }
    } else {
        mp_real other[3];
        for (i = 0; i < 3; i++) arm[i] = about->cg[i] - vehicle->imu[i];
        mp_cross_matrix(arm, out->euler);
        mp_times((const mp_real(*)[3])centripetal, vehicle->imu, part);
        mp_cross(dot, about->cg, other);
        for (i = 0; i < 3; i++) {
            out->own[i][0] = out->mean[3 + i];
            for (j = 0; j < 3; j++) out->own[i][1 + j] = -rotation[i][j];
            out->measured[i] = cycle->force[i] - (part[i] + other[i]);
        }
    }
}

/* Derivative of the specific force at the bearing, g u + mu (F - (F . u) u), by an error of attitude at the start of a cycle. `up` and
 * `force` are means or integrals under a window, whose middle is a `part` of the cycle's turn later. */
static void force_by_tilt(const mp_vehicle *vehicle, const mp_reference *about, const mp_real up[3], const mp_real force[3],
                          const mp_real turn[3], mp_real part, mp_real out[3][3]) {
    mp_real size = MP_SQRT(mp_dot(up, up)), unit[3], across[3], along, by[3][3], later[3][3];
    int i, j;
    for (i = 0; i < 3; i++) unit[i] = up[i] / mp_max(size, R(1e-30));
    mp_cross(force, unit, across);
    along = mp_dot(force, unit);
    mp_cross_matrix(up, by);
    mp_cross_matrix(unit, later);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            by[i][j] *= vehicle->gravity;
            if (MP_SLIDES(vehicle)) by[i][j] -= about->mu * (unit[i] * across[j] + along * later[i][j]);
        }
    mp_cross_matrix(turn, later);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) later[i][j] = (i == j ? R(1) : R(0)) - part * later[i][j];
    mp_product((const mp_real(*)[3])by, (const mp_real(*)[3])later, out);
}

/* What a specific force at the bearing (3, 3) does to the body, which hangs on it. */
static void hung(const mp_vehicle *vehicle, const mp_reference *about, const mp_real force[3][3], mp_real out[3][3]) {
    mp_real offset[3], mass, across[3][3];
    int i, j;
    mass = mp_max(R(1) / about->mu - vehicle->bearing_mass, R(0.01) / about->mu);
    for (i = 0; i < 3; i++) offset[i] = about->cg[i] - vehicle->centre[i];
    mp_cross_matrix(offset, across);
    mp_product((const mp_real(*)[3])across, force, out);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) out[i][j] *= -mass;
}

void mp_moment_by_tilt(const mp_vehicle *vehicle, const mp_reference *about, const mp_motion *here, int half, mp_real part,
                       mp_real out[3][3]) {
    mp_real by[3][3], turn[3];
    int i;
    for (i = 0; i < 3; i++) turn[i] = here->rate[i] * here->duration_s;
    force_by_tilt(vehicle, about, here->up[half], here->push[half], turn, part, by);
    hung(vehicle, about, (const mp_real(*)[3])by, out);
}

/* What an error of attitude does to the mean specific force, `part` of a cycle before its middle. */
static void by_attitude(const mp_vehicle *vehicle, const mp_reference *about, const mp_motion *here, mp_real part, mp_real out[3][3]) {
    mp_real inverse[3][3], tilting[3][3], by[3][3], own[3][3], mean[3], push[3], turn[3];
    int i, j;
    for (i = 0; i < 3; i++) {
        mean[i] = (here->up[0][i] + here->up[1][i]) / here->duration_s;
        push[i] = (here->push[0][i] + here->push[1][i]) / here->duration_s;
        turn[i] = here->rate[i] * here->duration_s;
    }
    force_by_tilt(vehicle, about, mean, push, turn, part, by);
    hung(vehicle, about, (const mp_real(*)[3])by, tilting);
    mp_tensor(about->theta, inverse);
    mp_product((const mp_real(*)[3])here->euler, (const mp_real(*)[3])inverse, own);
    mp_product((const mp_real(*)[3])own, (const mp_real(*)[3])tilting, out);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) out[i][j] += by[i][j];
}

/* What an error of the rate does to the specific force, by the motion's own acceleration along the lever arm. */
static void by_rate(const mp_vehicle *vehicle, const mp_layout *layout, const mp_reference *about, mp_motion *out) {
    mp_real turn[3][3], coupled[3][3], half[3], across[3][3], along[3][3], known[3], half_s = out->duration_s / R(2);
    int i, j;
    for (i = 0; i < 3; i++) half[i] = out->rate[i] * half_s;
    mp_cross_matrix(out->rate, turn);
    mp_coupled(about, layout->channels, half, NULL, coupled);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) coupled[i][j] = coupled[i][j] / half_s - turn[i][j];
    mp_product((const mp_real(*)[3])turn, (const mp_real(*)[3])out->euler, across);
    mp_product((const mp_real(*)[3])out->euler, (const mp_real(*)[3])coupled, along);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) out->by_rate[i][j] = R(2) * across[i][j] + along[i][j];
    if (MP_ON_BEARING(vehicle)) { /* what hangs on it turns under its weight meanwhile, by half a cycle's turn in the mean */
        by_attitude(vehicle, about, out, R(0), across);
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) out->by_rate[i][j] += across[i][j] * half_s;
    }
    mp_times((const mp_real(*)[3])out->by_rate, out->rate, known);
    for (i = 0; i < 3; i++) out->measured[i] += known[i];
}

/* (3, 6) moment about the centre, and specific force at the IMU, of a wrench; `direct`: that moment less what it moves the base by. */
static void pushed(const mp_vehicle *vehicle, const mp_real up[3], const mp_reference *about, mp_real moment[3][6], mp_real direct[3][6],
                   mp_real felt[3][6]) {
    mp_real turn[3][3], inverse[3][3], flat[3][3], along[3][3], arm[3][3], swung[3][3], reach[3];
    int i, j, k;
    mp_cross_matrix(MP_ON_BEARING(vehicle) ? vehicle->centre : about->cg, turn);
    mp_tensor(about->theta, inverse);
    for (i = 0; i < 3; i++) reach[i] = vehicle->imu[i] - (MP_ON_BEARING(vehicle) ? vehicle->centre[i] : about->cg[i]);
    mp_cross_matrix(reach, arm);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            moment[i][j] = i == j ? R(1) : R(0);
            flat[i][j] = MP_ON_PEDESTAL(vehicle) ? R(0) : moment[i][j];
            moment[i][3 + j] = -turn[i][j];
            swung[i][j] = R(0);
        }
    memcpy(direct, moment, 3 * sizeof direct[0]);
    if (MP_SLIDES(vehicle)) {
        mp_real kappa[3];
        for (i = 0; i < 3; i++) kappa[i] = about->theta[9] * about->theta[6 + i];
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) flat[i][j] -= up[i] * up[j];
        mp_cross_matrix(kappa, along);
        mp_product((const mp_real(*)[3])along, (const mp_real(*)[3])flat, turn);
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) direct[i][3 + j] -= turn[i][j];
        mp_product((const mp_real(*)[3])flat, (const mp_real(*)[3])along, swung);
    }
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) swung[i][j] -= arm[i][j];
    mp_product((const mp_real(*)[3])swung, (const mp_real(*)[3])inverse, turn);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 6; j++) {
            felt[i][j] = j < 3 ? R(0) : about->mu * flat[i][j - 3];
            for (k = 0; k < 3; k++) felt[i][j] += turn[i][k] * direct[k][j];
        }
}

/* (3, 3) of what a matrix (3, 6) makes of a covariance (6, 6). */
static void spread(const mp_real by[3][6], const mp_real covariance[6][6], mp_real out[3][3]) {
    int i, j, k, l;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            mp_real sum = R(0);
            for (k = 0; k < 6; k++)
                for (l = 0; l < 6; l++) sum += by[i][k] * covariance[k][l] * by[j][l];
            out[i][j] = sum;
        }
}

/* Roots of the noise of measurements, and of the moment that pulses err by. */
static void noise_of(const mp_vehicle *vehicle, const mp_cycle *cycle, const mp_reference *about, mp_motion *out) {
    int i, j, k;
    memset(out->noise, 0, sizeof out->noise);
    for (i = 0; i < 3; i++) {
        out->noise[i][i] = vehicle->gyro_noise;
        out->noise[3 + i][3 + i] = vehicle->accel_noise[i];
    }
    if (vehicle->pulses || vehicle->torque_noise > R(0)) {
        mp_real moment[3][6], direct[3][6], felt[3][6], covariance[3][3], values[3], axes[3][3], force[9], up[3];
        mp_real torque = vehicle->torque_noise * vehicle->torque_noise, square = cycle->duration_s * cycle->duration_s;
        for (i = 0; i < 3; i++) up[i] = (cycle->up[0][i] + cycle->up[1][i]) / R(2);
        pushed(vehicle, up, about, moment, direct, felt);
        memset(covariance, 0, sizeof covariance);
        if (vehicle->pulses) spread((const mp_real(*)[6])felt, cycle->pulse_covariance, covariance);
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) {
                force[3 * i + j] = covariance[i][j] / square;
                for (k = 0; k < 3; k++) force[3 * i + j] += torque * felt[i][k] * felt[j][k];
                if (i == j) force[3 * i + j] += vehicle->accel_noise[i] * vehicle->accel_noise[i];
            }
        if (mp_cholesky(force, 3))
            for (i = 0; i < 3; i++)
                for (j = 0; j < 3; j++) out->noise[3 + i][3 + j] = force[3 * i + j];
        if (vehicle->pulses) {
            spread((const mp_real(*)[6])moment, cycle->pulse_covariance, covariance);
            mp_eigen((const mp_real(*)[3])covariance, values, axes);
            for (i = 0; i < 3; i++)
                for (j = 0; j < 3; j++) out->pulse_root[i][j] = axes[i][j] * MP_SQRT(mp_max(values[j], R(0)));
        }
    }
    for (k = 0; k < 2; k++)
        if (cycle->deaf[k])
            for (i = 0; i < 3; i++)
                for (j = 0; j < 3; j++) out->noise[3 * k + i][3 * k + j] *= DEAF;
}

/* The thrust's own wrench under the halves of the window and over the cycle, without the wheels' reaction. */
static void thrust_of(const mp_vehicle *vehicle, const mp_cycle *cycle, mp_real out[3][6]) {
    int k, w, i;
    memcpy(out[0], cycle->rising, sizeof out[0]);
    memcpy(out[1], cycle->falling, sizeof out[1]);
    memcpy(out[2], cycle->whole, sizeof out[2]);
    for (k = 0; k < 3; k++)
        for (w = 0; w < vehicle->wheels; w++)
            for (i = 0; i < 3; i++) out[k][i] += vehicle->axis[w][i] * cycle->grown[k][w];
}

/* What a unit of each scale does: of all thrust, or of what a wheel stores. */
static void scaled(const mp_vehicle *vehicle, const mp_layout *layout, const mp_cycle *cycle, const mp_reference *about, const mp_bin *bins,
                   mp_motion *out) {
    mp_real inverse[3][3], by_moment[3][3], impulse[3][3];
    int s, i, j, k, force = MP_SLIDES(vehicle) ? 6 : 3;
    mp_tensor(about->theta, inverse);
    mp_product((const mp_real(*)[3])out->euler, (const mp_real(*)[3])inverse, by_moment);
    for (s = 0; s < layout->scales; s++) {
        int w = layout->scale[s];
        if (w < 0) {
            mp_real moment[3][6], direct[3][6], felt[3][6], own[3][6], up[3];
            for (i = 0; i < 3; i++) up[i] = (out->up[0][i] + out->up[1][i]) / out->duration_s;
            pushed(vehicle, up, about, moment, direct, felt);
            thrust_of(vehicle, cycle, own);
            for (k = 0; k < 3; k++)
                for (i = 0; i < 3; i++) {
                    impulse[k][i] = R(0);
                    for (j = 0; j < 6; j++) impulse[k][i] += direct[i][j] * own[k][j];
                }
        } else {
            for (k = 0; k < 3; k++)
                for (i = 0; i < 3; i++) impulse[k][i] = -vehicle->axis[w][i] * cycle->grown[k][w];
            stored(vehicle, cycle, bins, w, impulse[0], impulse[1], impulse[2]);
        }
        memcpy(out->scaled[s], impulse, sizeof out->scaled[s]);
        mp_times((const mp_real(*)[3])by_moment, impulse[2], out->felt[s]);
        for (i = 0; i < 3; i++) {
            out->felt[s][i] /= out->duration_s;
            if (w < 0 && !MP_ON_PEDESTAL(vehicle)) out->felt[s][i] += about->mu * out->mean[force + i];
        }
    }
}

void mp_motion_of(const mp_vehicle *vehicle, const mp_layout *layout, const mp_cycle *cycle, const mp_reference *about, mp_motion *out) {
    mp_bin bins[MP_BINS];
    mp_real rates[2][3], ups[2][3], beyond[3], before[3], taken[3], whole[MP_CHANNELS];
    int i;
    out->duration_s = cycle->duration_s;
    for (i = 0; i < 3; i++) {
        out->raw_rate[i] = cycle->rate[i];
        before[i] = cycle->rate[i] - cycle->rate_step[i];
        out->push[0][i] = cycle->rising[3 + i];
        out->push[1][i] = cycle->falling[3 + i];
        out->rate[i] = cycle->rate[i] - about->bias[i];
    }
    mp_within(vehicle, layout->channels, cycle, about, out->rate, bins, rates, ups, beyond);
    mp_cross(before, cycle->rate, taken); /* what the attitude was carried by took for coning */
    for (i = 0; i < 3; i++) {
        taken[i] *= cycle->duration_s / R(12);
        out->carried[i] = cycle->carried[i] + taken[i] - beyond[i] / cycle->duration_s;
    }
    integrals(vehicle, layout, cycle, about, bins, rates, ups, out, whole);
    felt(vehicle, layout, cycle, about, bins, out);
    by_rate(vehicle, layout, about, out);
    if (layout->at_tilt >= 0) by_attitude(vehicle, about, out, R(0.5), out->by_tilt);
    if (layout->scales > 0) scaled(vehicle, layout, cycle, about, bins, out);
    noise_of(vehicle, cycle, about, out);
}
