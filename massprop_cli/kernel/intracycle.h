/* The motion within a cycle, rebuilt in bins (massprop_cli/model/intracycle.py), and what wheels store meanwhile. */
#ifndef MASSPROP_INTRACYCLE_H
#define MASSPROP_INTRACYCLE_H

#include "massprop.h"

/* Wrench, rate, angular acceleration and vertical of one bin. */
typedef struct {
    mp_real wrench[6], late[3], driven[3], rate[3], rate_dot[3], up[3];
} mp_bin;

/* Of all bins, the rate and the vertical at both ends, and the rotation vector less the mean reading times the duration. */
void mp_within(const mp_vehicle *vehicle, int channels, const mp_cycle *cycle, const mp_reference *about, const mp_real mean[3],
               mp_bin *bins, mp_real rates[2][3], mp_real ups[2][3], mp_real beyond[3]);
/* On a bearing whose base slides: what the CG's own swing adds to the angular acceleration. */
void mp_swing(const mp_reference *about, const mp_bin *here, mp_real out[3]);
/* Momentum of wheels, mean and first moment of a bin: of one, or of all (-1). */
void mp_momentum_of(const mp_vehicle *vehicle, const mp_cycle *cycle, int b, int one, mp_real mean[3], mp_real growing[3]);
/* Torque -w x h of momentum on the vehicle in a bin, mean, and its first moment about the bin's middle over its length. */
void mp_precession(const mp_real rate[3], const mp_real rate_dot[3], const mp_real mean[3], const mp_real growing[3], mp_real squared,
                   mp_real torque[3], mp_real late[3]);
/* Angular acceleration, mean over the bins. */
void mp_mean_rate_dot(const mp_vehicle *vehicle, const mp_bin *bins, mp_real out[3]);
/* All that wheels do by the motion: that of what they store; and what those whose speed relative to the body is read at a cycle's end take
 * less of the angular acceleration than in its mean, `steady`. */
void mp_by_wheels(const mp_vehicle *vehicle, const mp_cycle *cycle, const mp_bin *here, int b, const mp_real steady[3], mp_real torque[3],
                  mp_real late[3]);

#endif
