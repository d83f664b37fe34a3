#include "initial.h"

#include <math.h>
#include <string.h>

#include "responsemap.h"
#include "motion.h"
#include "linalg.h"

#define SIGNIFICANT R(6) /* an axis' response must exceed its own sigma this many times before anything is said */
#define SPREAD R(30)     /* largest ratio of a reference's principal moments to the common scale */
#define COUPLE R(1e-3)   /* part of a couple's force below which a force is what it has left, and tells no mass */
#define COLUMNS 16       /* load 3, products 6, duration 1; torque 3; growth 3 */
#define TORQUE 10
#define GROWTH 13

/* Measured specific force carried from the IMU to the bearing, or to O. */
static void carried(const mp_vehicle *vehicle, const mp_cycle *cycle, mp_real out[3]) {
    mp_real arm[3], dot[3], euler[3], inner[3], outer[3];
    int i;
    for (i = 0; i < 3; i++) {
        arm[i] = vehicle->imu[i] - (MP_ON_BEARING(vehicle) ? vehicle->centre[i] : R(0));
        dot[i] = cycle->rate_step[i] / cycle->duration_s;
    }
    mp_cross(dot, arm, euler);
    mp_cross(cycle->rate, arm, inner);
    mp_cross(cycle->rate, inner, outer);
    for (i = 0; i < 3; i++) out[i] = cycle->force[i] - (euler[i] + outer[i]);
}

/* Impulse of the torque -w x h of what wheels store, of mean rate and mean momentum. */
static void precession(const mp_vehicle *vehicle, const mp_cycle *cycle, mp_real out[3]) {
    mp_real momentum[3] = {R(0), R(0), R(0)}, bin_s = cycle->duration_s / R(vehicle->bins);
    int b, w, i;
    for (b = 0; b < vehicle->bins; b++)
        for (w = 0; w < vehicle->wheels; w++)
            for (i = 0; i < 3; i++) momentum[i] += vehicle->axis[w][i] * cycle->momentum[b][w] * bin_s;
    mp_cross(momentum, cycle->rate, out);
}

void mp_start_add(const mp_vehicle *vehicle, mp_start *start, const mp_cycle *cycle) {
    mp_real row[COLUMNS], load[3], area[6], felt[3], push[3], stored[3];
    int i;
    carried(vehicle, cycle, felt);
    mp_products(cycle->rate, area);
    for (i = 0; i < 6; i++) area[i] *= cycle->duration_s;
    precession(vehicle, cycle, stored);
    for (i = 0; i < 3; i++) {
        mp_real force = cycle->deaf[1] ? vehicle->gravity * (cycle->up[0][i] + cycle->up[1][i]) / R(2) : felt[i];
        load[i] = force * cycle->duration_s;
    }
    if (start->cycles > 0) {
        for (i = 0; i < 3; i++) {
            row[i] = MP_ON_BEARING(vehicle) ? (start->load[i] + load[i]) / R(2) : start->rising[3 + i] + cycle->falling[3 + i];
            row[TORQUE + i] = start->rising[i] + cycle->falling[i] + (start->stored[i] + stored[i]) / R(2);
            row[GROWTH + i] = cycle->rate[i] - start->rate[i];
            start->growth = mp_max(start->growth, mp_abs(row[GROWTH + i]));
        }
        if (MP_ON_BEARING(vehicle)) {
            mp_real impulse[3], moment[3];
            for (i = 0; i < 3; i++) impulse[i] = start->rising[3 + i] + cycle->falling[3 + i];
            mp_cross(vehicle->centre, impulse, moment);
            for (i = 0; i < 3; i++) row[TORQUE + i] -= moment[i];
        }
        for (i = 0; i < 6; i++) row[3 + i] = (start->area[i] + area[i]) / R(2);
        row[9] = cycle->duration_s;
        mp_fold(start->triangle, COLUMNS, row, 1);
    }
    for (i = 0; i < 3; i++) {
        push[i] = cycle->whole[3 + i] / cycle->duration_s;
        felt[i] -= MP_ON_BEARING(vehicle) ? vehicle->gravity * (cycle->up[0][i] + cycle->up[1][i]) / R(2) : R(0);
    }
    if (MP_ON_BEARING(vehicle)) {
        mp_level(cycle->up[0], push, push);
        mp_level(cycle->up[0], felt, felt);
    }
    for (i = 0; i < 3; i++) {
        mp_real pair[2];
        pair[0] = push[i];
        pair[1] = felt[i];
        mp_fold(start->push[i], 2, pair, 1);
        start->rate[i] = cycle->rate[i];
        start->load[i] = load[i];
        start->stored[i] = stored[i];
    }
    memcpy(start->area, area, sizeof area);
    memcpy(start->rising, cycle->rising, sizeof start->rising);
    start->duration_s += cycle->duration_s;
    start->cycles += 1;
}

/* Slope of motions on their causes, three axes, where it is significant; 0 where it isn't. */
static mp_real response(mp_real cause[3][6], mp_real motion[3][6], long freedom) {
    mp_real power[3], most = R(0), above = R(0), below = R(0);
    int i, k;
    for (i = 0; i < 3; i++) {
        power[i] = R(0);
        for (k = 0; k < 6; k++) power[i] += cause[i][k] * cause[i][k];
        most = mp_max(most, power[i]);
    }
    if (freedom < 3 || !(most > R(0))) return R(0);
    for (i = 0; i < 3; i++) {
        mp_real slope = R(0), left = R(0);
        if (!(power[i] > R(1e-12) * most)) continue;
        for (k = 0; k < 6; k++) slope += motion[i][k] * cause[i][k];
        slope /= power[i];
        for (k = 0; k < 6; k++) {
            mp_real apart = motion[i][k] - slope * cause[i][k];
            left += apart * apart;
        }
        if (!(slope > SIGNIFICANT * MP_SQRT(left / R(freedom) / power[i]))) continue;
        above += slope * power[i];
        below += power[i];
    }
    return below > R(0) ? above / below : R(0);
}

static mp_real at(const mp_real *triangle, int row, int column) {
    return column < row ? R(0) : triangle[AT(COLUMNS, row) + column - row];
}

/* Response of the rates' growth to torques, what else explains them taken out; 0: none. */
static mp_real turning(const mp_start *start) {
    mp_real cause[3][6], motion[3][6];
    long freedom = start->cycles - 2;
    int i, k, c;
    for (c = 0; c < TORQUE; c++) {
        int driven = 0;
        for (k = 0; k <= c; k++) driven |= at(start->triangle, k, c) != R(0);
        freedom -= driven;
    }
    for (i = 0; i < 3; i++)
        for (k = 0; k < 6; k++) {
            cause[i][k] = at(start->triangle, TORQUE + k, TORQUE + i);
            motion[i][k] = at(start->triangle, TORQUE + k, GROWTH + i);
        }
    return response(cause, motion, freedom);
}

/* Response of accelerations to forces, 1/m; 0: none. */
static mp_real pushing(const mp_vehicle *vehicle, const mp_start *start) {
    mp_real cause[3][6], motion[3][6], push = R(0), couple = R(0), arm = start->duration_s / R(start->cycles) * vehicle->reach;
    int i, k;
    for (i = 0; i < 3; i++) {
        push += start->push[i][0] * start->push[i][0];
        for (k = 0; k <= TORQUE + i; k++) couple += at(start->triangle, k, TORQUE + i) * at(start->triangle, k, TORQUE + i);
    }
    if (!(push * arm * arm > COUPLE * COUPLE * couple)) return R(0);
    memset(cause, 0, sizeof cause);
    memset(motion, 0, sizeof motion);
    for (i = 0; i < 3; i++) {
        cause[i][0] = start->push[i][0];
        motion[i][0] = start->push[i][1];
        motion[i][1] = start->push[i][2];
    }
    return response(cause, motion, start->cycles - 1);
}

/* Least squares with a prior: fit (13, 3), the columns in the triangle's order. */
static void ridge(const mp_real *triangle, long rows, const mp_real prior[GROWTH], mp_real scale, mp_real fit[GROWTH][3]) {
    mp_real target[GROWTH][3], joint[MP_PACKED(COLUMNS)], known[GROWTH * COLUMNS], column[GROWTH];
    int again, i, k, g;
    memset(target, 0, sizeof target);
    for (i = 0; i < 3; i++) target[TORQUE + i][i] = scale;
    memcpy(fit, target, sizeof target);
    for (again = 0; again < 2; again++) {
        mp_real square = R(0), noise;
        for (k = 0; k < COLUMNS; k++)
            for (g = 0; g < 3; g++) {
                mp_real left = at(triangle, k, GROWTH + g);
                for (i = 0; i < GROWTH; i++) left -= at(triangle, k, i) * fit[i][g];
                square += left * left;
            }
        noise = MP_SQRT(square / R(3 * rows));
        memset(known, 0, sizeof known);
        for (i = 0; i < GROWTH; i++) {
            mp_real weight = noise / prior[i];
            known[i * COLUMNS + i] = weight;
            for (g = 0; g < 3; g++) known[i * COLUMNS + GROWTH + g] = weight * target[i][g];
        }
        memcpy(joint, triangle, sizeof joint);
        mp_fold(joint, COLUMNS, known, GROWTH);
        for (g = 0; g < 3; g++) {
            for (i = 0; i < GROWTH; i++) column[i] = at(joint, i, GROWTH + g);
            mp_back(joint, COLUMNS, 0, GROWTH, column);
            for (i = 0; i < GROWTH; i++) fit[i][g] = column[i];
        }
    }
}

static mp_real fallback_mu(const mp_vehicle *vehicle, mp_real scale) {
    return vehicle->known_mass > R(0) ? R(1) / vehicle->known_mass : vehicle->reach * vehicle->reach * scale / R(3);
}

/* A body that has felt forces but no torques yet: its radius of gyration is its jets' reach. */
static void unturned(const mp_vehicle *vehicle, mp_real mu, mp_reference *out) {
    const mp_real origin[3] = {R(0), R(0), R(0)};
    mp_real inertia[3][3], own = vehicle->reach * vehicle->reach / (R(3) * mu);
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) inertia[i][j] = i == j ? own : R(0);
    mp_body_of(vehicle, (const mp_real(*)[3])inertia, MP_ON_BEARING(vehicle) ? vehicle->centre : origin, mu, out);
}

void mp_fallback(const mp_vehicle *vehicle, mp_reference *out) {
    unturned(vehicle, fallback_mu(vehicle, R(3) / (vehicle->reach * vehicle->reach)), out);
}

int mp_start_found(const mp_vehicle *vehicle, const mp_start *start, mp_reference *out) {
    mp_real scale = turning(start), mu = MP_ON_PEDESTAL(vehicle) ? R(0) : pushing(vehicle, start), triangle[MP_PACKED(COLUMNS)], prior[GROWTH], fit[GROWTH][3];
    mp_real mean[3][3], values[3], axes[3][3], inertia[3][3], couple[3][3], cg[3], reach;
    int i, j, k;
    if (!(scale > R(0))) {
        if (mu > R(0)) unturned(vehicle, mu, out);
        return mu > R(0);
    }
    if (!(mu > R(0))) mu = fallback_mu(vehicle, scale);
    reach = MP_SQRT(R(3) * mu / scale);
    memcpy(triangle, start->triangle, sizeof triangle);
    if (MP_ON_BEARING(vehicle)) {
        mp_real mass = mp_max(R(1) / mu - vehicle->bearing_mass, R(0.01) / mu);
        for (i = 0; i < 3; i++)
            for (j = i; j < 3; j++) triangle[AT(COLUMNS, i) + j - i] *= mass;
        reach *= R(0.01);
    }
    for (i = 0; i < 3; i++) {
        prior[i] = scale * reach;
        prior[TORQUE + i] = scale;
    }
    for (i = 0; i < 6; i++) prior[3 + i] = R(1);
    prior[9] = start->growth / (start->duration_s / R(start->cycles));
    ridge(triangle, start->cycles - 1, prior, scale, fit);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) mean[i][j] = (fit[TORQUE + i][j] + fit[TORQUE + j][i]) / R(2);
    mp_eigen((const mp_real(*)[3])mean, values, axes);
    for (i = 0; i < 3; i++) values[i] = mp_min(mp_max(values[i], scale / SPREAD), scale * SPREAD);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            inertia[i][j] = R(0);
            for (k = 0; k < 3; k++) inertia[i][j] += axes[i][k] / values[k] * axes[j][k];
        }
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) couple[i][j] = mp_dot(inertia[i], fit[j]);
    cg[0] = R(-0.5) * (couple[2][1] - couple[1][2]);
    cg[1] = R(-0.5) * (couple[0][2] - couple[2][0]);
    cg[2] = R(-0.5) * (couple[1][0] - couple[0][1]);
    if (MP_ON_BEARING(vehicle))
        for (i = 0; i < 3; i++) cg[i] += vehicle->centre[i];
    mp_body_of(vehicle, (const mp_real(*)[3])inertia, cg, mu, out);
    return 1;
}
