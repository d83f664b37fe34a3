/* The motion within a cycle, and what the equations are over it. */
#ifndef MASSPROP_MOTION_H
#define MASSPROP_MOTION_H

#include "massprop.h"

/* Which states there are. MP_LIMIT where they don't fit. */
int mp_laid_out(const mp_vehicle *vehicle, mp_layout *layout);
/* (3, 3) derivative of the moment under the rising (0) or the falling (1) half of the window by an error of attitude, of the vertical under
 * it; `part` of the cycle's turn before. */
void mp_moment_by_tilt(const mp_vehicle *vehicle, const mp_reference *about, const mp_motion *here, int half, mp_real part,
                       mp_real out[3][3]);
/* (6) the products of rates. */
void mp_products(const mp_real rate[3], mp_real out[6]);
/* A cycle about a reference: massprop_cli/model/intracycle.py, and of regressors.py what depends on one cycle. */
void mp_motion_of(const mp_vehicle *vehicle, const mp_layout *layout, const mp_cycle *cycle, const mp_reference *about, mp_motion *out);
/* Derivative of the gyroscopic term by the rate, under one half of the window, made smaller where it is steep. `stored`: momentum of wheels
 * under it; NULL where there are none. */
void mp_coupled(const mp_reference *about, int channels, const mp_real rate[3], const mp_real *stored, mp_real out[3][3]);
/* From one cycle into the next. */
void mp_time_update_of(const mp_vehicle *vehicle, const mp_layout *layout, const mp_motion *from, const mp_motion *into,
                const mp_reference *about, mp_time_update *out);

#endif
