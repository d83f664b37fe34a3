#include "intracycle.h"

#include <math.h>
#include <string.h>

#include "linalg.h"
#include "motion.h"

#define STEEP R(0.5) /* largest part of a rate's error that the gyroscopic coupling may add to it or take off within half a step */
#define PASSES 3     /* that rebuild the motion within a cycle */

static const int FIRST[6] = {0, 0, 0, 1, 1, 2}, SECOND[6] = {0, 1, 2, 1, 2, 2};

void mp_products(const mp_real rate[3], mp_real out[6]) {
    int k;
    for (k = 0; k < 6; k++) out[k] = rate[FIRST[k]] * rate[SECOND[k]];
}

/* What phi makes of a wrench and a vertical. */
static void driven(const mp_vehicle *vehicle, const mp_reference *about, const mp_real wrench[6], const mp_real up[3],
                   const mp_real level_of[3], mp_real out[3]) {
    mp_real acts[9];
    int i, j, count = 6;
    if (MP_ON_BEARING(vehicle)) {
        mp_cross(vehicle->centre, wrench + 3, acts);
        for (i = 0; i < 3; i++) acts[i] = wrench[i] - acts[i];
        for (i = 0; i < 3; i++) acts[3 + i] = up[i];
        if (MP_SLIDES(vehicle)) {
            mp_level(level_of, wrench + 3, acts + 6);
            count = 9;
        }
    } else {
        for (i = 0; i < 6; i++) acts[i] = wrench[i];
    }
    for (i = 0; i < 3; i++) {
        mp_real sum = R(0);
        for (j = 0; j < count; j++) sum += about->phi[i][j] * acts[j];
        out[i] = sum;
    }
}

/* The gyroscopic coupling, bounded where it is steep. */
static void coupled(const mp_reference *about, int channels, const mp_real rate[3], mp_real cycle_s, mp_real out[3]) {
    mp_real s[6], most = R(0), change = R(0), share;
    int i, j;
    mp_products(rate, s);
    for (i = 0; i < 3; i++) {
        mp_real sum = R(0);
        for (j = 0; j < 6; j++) sum += about->phi[i][channels - 6 + j] * s[j];
        out[i] = sum;
        most += STEEP * rate[i] * (STEEP * rate[i]);
        change += sum * cycle_s * (sum * cycle_s);
    }
    if (change > most) {
        share = MP_SQRT(most / mp_max(change, MP_TINY));
        for (i = 0; i < 3; i++) out[i] *= share;
    }
}

/* Acceleration of a point beyond that of the centre. */
static void lever_arm(const mp_real rate[3], const mp_real rate_dot[3], const mp_real arm[3], mp_real out[3]) {
    mp_real inner[3], outer[3];
    int i;
    mp_cross(rate_dot, arm, out);
    mp_cross(rate, arm, inner);
    mp_cross(rate, inner, outer);
    for (i = 0; i < 3; i++) out[i] += outer[i];
}

/* On a bearing: what the CG's own swing adds to the angular acceleration. */
void mp_swing(const mp_reference *about, const mp_bin *here, mp_real out[3]) {
    mp_real j[3][3], moved[3], flat[3], swung[3];
    int i;
    lever_arm(here->rate, here->rate_dot, about->theta + 6, moved);
    mp_level(here->up, moved, flat);
    mp_cross(about->theta + 6, flat, swung);
    for (i = 0; i < 3; i++) swung[i] *= about->theta[9];
    mp_tensor(about->theta, j);
    mp_times((const mp_real(*)[3])j, swung, out);
}

/* The vertical after the body has turned by a rotation vector (Rodrigues 1840). */
static void tilted(const mp_real up[3], const mp_real angle[3], mp_real out[3]) {
    mp_real once[3], twice[3];
    double half = 0.5 * sqrt((double)(angle[0] * angle[0] + angle[1] * angle[1] + angle[2] * angle[2]));
    double sinc = half > 0 ? sin(half) / half : 1.0;
    mp_real first = R(sinc * cos(half)), second = R(0.5 * sinc * sinc);
    int i;
    mp_cross(up, angle, once);
    mp_cross(once, angle, twice);
    for (i = 0; i < 3; i++) out[i] = up[i] + first * once[i] + second * twice[i];
}

/* Momentum of wheels, mean and first moment of a bin: of one, or of all (-1). */
void mp_momentum_of(const mp_vehicle *vehicle, const mp_cycle *cycle, int b, int one, mp_real mean[3], mp_real growing[3]) {
    int w, i;
    for (i = 0; i < 3; i++) mean[i] = growing[i] = R(0);
    for (w = one < 0 ? 0 : one; w < (one < 0 ? vehicle->wheels : one + 1); w++)
        for (i = 0; i < 3; i++) {
            mean[i] += vehicle->axis[w][i] * cycle->momentum[b][w];
            growing[i] += vehicle->axis[w][i] * cycle->growing[b][w];
        }
}

/* Torque -w x h of momentum on the vehicle in a bin, mean, and its first moment about the bin's middle over its length. */
void mp_precession(const mp_real rate[3], const mp_real rate_dot[3], const mp_real mean[3], const mp_real growing[3], mp_real squared,
                   mp_real torque[3], mp_real late[3]) {
    mp_real a[3], b[3], c[3], d[3];
    int i;
    mp_cross(rate, mean, a);
    mp_cross(rate_dot, growing, b);
    mp_cross(rate, growing, c);
    mp_cross(rate_dot, mean, d);
    for (i = 0; i < 3; i++) {
        torque[i] = -(a[i] + b[i]);
        late[i] = -(c[i] + d[i] * squared);
    }
}

void mp_mean_rate_dot(const mp_vehicle *vehicle, const mp_bin *bins, mp_real out[3]) {
    int b, i;
    for (i = 0; i < 3; i++) out[i] = R(0);
    for (b = 0; b < vehicle->bins; b++)
        for (i = 0; i < 3; i++) out[i] += bins[b].rate_dot[i] / R(vehicle->bins);
}

void mp_by_wheels(const mp_vehicle *vehicle, const mp_cycle *cycle, const mp_bin *here, int b, const mp_real steady[3], mp_real torque[3],
                  mp_real late[3]) {
    mp_real mean[3], growing[3], beyond[3], bin_s = cycle->duration_s / R(vehicle->bins);
    int w, i;
    mp_momentum_of(vehicle, cycle, b, -1, mean, growing);
    mp_precession(here->rate, here->rate_dot, mean, growing, bin_s * bin_s / R(12), torque, late);
    for (i = 0; i < 3; i++) beyond[i] = here->rate_dot[i] - steady[i];
    for (w = 0; w < vehicle->wheels; w++) {
        mp_real along = vehicle->free_inertia[w] * mp_dot(vehicle->axis[w], beyond);
        mp_real behind = vehicle->free_inertia[w] * mp_dot(vehicle->axis[w], here->late);
        for (i = 0; i < 3; i++) {
            torque[i] += vehicle->axis[w][i] * along;
            late[i] += vehicle->axis[w][i] * behind;
        }
    }
}

/* Mean reading less mean rate, as far as commands make it: their response behind the sensor's kernel, less the motion by bins. */
static void mean_offset(const mp_vehicle *vehicle, const mp_cycle *cycle, const mp_reference *about, mp_real out[3]) {
    const mp_real zero[3] = {R(0), R(0), R(0)};
    mp_real beyond[6];
    int b, i, count = vehicle->bins;
    for (i = 0; i < 6; i++) {
        beyond[i] = -cycle->rising[i];
        for (b = 0; b < count; b++) beyond[i] += ((R(b) + R(0.5)) * cycle->impulse[b][i] + cycle->skew[b][i]) / R(count);
    }
    driven(vehicle, about, beyond, zero, cycle->up[0], out);
}

/* Rate, angular acceleration and vertical in each bin, the rate and the vertical at both ends, and the rotation vector less the mean reading
 * times the duration. */
void mp_within(const mp_vehicle *vehicle, int channels, const mp_cycle *cycle, const mp_reference *about, const mp_real mean[3],
               mp_bin *bins, mp_real rates[2][3], mp_real ups[2][3], mp_real beyond[3]) {
    const mp_real zero[3] = {R(0), R(0), R(0)};
    int count = vehicle->bins, again, b, i;
    mp_real bin_s = cycle->duration_s / R(count), shown[3] = {R(0), R(0), R(0)};
    if (vehicle->filtered) mean_offset(vehicle, cycle, about, shown);
    for (b = 0; b < count; b++) {
        for (i = 0; i < 6; i++) bins[b].wrench[i] = cycle->impulse[b][i] / bin_s;
        for (i = 0; i < 3; i++) {
            bins[b].rate[i] = mean[i];
            bins[b].rate_dot[i] = R(0);
            bins[b].late[i] = R(0);
            bins[b].up[i] = cycle->up[0][i];
        }
    }
    for (i = 0; i < 3; i++) ups[0][i] = ups[1][i] = cycle->up[0][i];
    for (i = 0; i < 3; i++) beyond[i] = R(0);
    for (again = 0; again < PASSES; again++) {
        mp_real change[3] = {R(0), R(0), R(0)}, behind[3] = {R(0), R(0), R(0)}, turned[3] = {R(0), R(0), R(0)}, coned[3] = {R(0), R(0), R(0)};
        mp_real once[3] = {R(0), R(0), R(0)};
        mp_real grown[2][3] = {{R(0), R(0), R(0)}, {R(0), R(0), R(0)}}, steady[3];
        mp_mean_rate_dot(vehicle, bins, steady);
        if (vehicle->curvature != R(0) && again > 0)
            for (i = 0; i < 2; i++) coupled(about, channels, rates[i], bin_s * R(count), grown[i]);
        for (b = 0; b < count; b++) {
            mp_bin *here = bins + b;
            mp_real coupling[3], dot[3];
            coupled(about, channels, here->rate, bin_s * R(count), coupling);
            if (MP_ON_BEARING(vehicle) || vehicle->wheels > 0 || again == 0) {
                mp_real acts[2][6], torque[2][3];
                memcpy(acts[0], here->wrench, sizeof acts[0]);
                memcpy(acts[1], cycle->skew[b], sizeof acts[1]);
                if (vehicle->wheels > 0) {
                    mp_by_wheels(vehicle, cycle, here, b, steady, torque[0], torque[1]);
                    for (i = 0; i < 3; i++) {
                        acts[0][i] += torque[0][i];
                        acts[1][i] += torque[1][i];
                    }
                }
                driven(vehicle, about, acts[0], here->up, here->up, here->driven);
                driven(vehicle, about, acts[1], zero, here->up, here->late);
            }
            for (i = 0; i < 3; i++) dot[i] = here->driven[i] + coupling[i];
            if (MP_SLIDES(vehicle)) {
                mp_real swung[3];
                mp_swing(about, here, swung);
                for (i = 0; i < 3; i++) dot[i] += swung[i];
            }
            for (i = 0; i < 3; i++) {
                mp_real own = dot[i] * bin_s;
                change[i] += own;
                here->rate_dot[i] = dot[i];
                here->rate[i] = change[i] - own / R(2) - here->late[i];
                behind[i] += here->rate[i];
            }
        }
        for (i = 0; i < 3; i++) {
            rates[0][i] = mean[i] - shown[i] - vehicle->curvature * (grown[1][i] - grown[0][i]) / cycle->duration_s - behind[i] / R(count);
            rates[1][i] = rates[0][i] + change[i];
        }
        for (b = 0; b < count; b++) {
            mp_bin *here = bins + b;
            mp_real angle[3], own[3], cone[3], bent[3], middle[3], before[3], third[3];
            for (i = 0; i < 3; i++) here->rate[i] += rates[0][i];
            if (!MP_ON_BEARING(vehicle)) continue;
            for (i = 0; i < 3; i++) {
                own[i] = here->rate[i] * bin_s;
                turned[i] += own[i];
            }
            mp_cross(turned, own, cone);
            mp_cross(here->rate, here->rate_dot, bent);
            for (i = 0; i < 3; i++) {
                cone[i] = cone[i] / R(2) + bent[i] * (bin_s * bin_s * bin_s) / R(12);
                before[i] = once[i] + cone[i] / R(2);
                once[i] += cone[i];
                middle[i] = turned[i] - own[i] / R(2);
            }
            mp_cross(before, own, bent);
            mp_cross(middle, own, before);
            mp_cross(middle, before, third);
            for (i = 0; i < 3; i++) {
                cone[i] += bent[i] / R(2) + third[i] / R(12);
                coned[i] += cone[i];
                angle[i] = turned[i] - own[i] / R(2) - here->rate_dot[i] * (bin_s * bin_s) / R(12) + coned[i] - cone[i] / R(2);
            }
            tilted(cycle->up[0], angle, here->up);
        }
        if (!MP_ON_BEARING(vehicle)) continue;
        for (i = 0; i < 3; i++) {
            turned[i] += coned[i];
            beyond[i] = turned[i] - mean[i] * cycle->duration_s;
        }
        tilted(cycle->up[0], turned, ups[1]);
    }
}
