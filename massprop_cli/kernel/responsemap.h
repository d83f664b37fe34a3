/* From theta = (J, c or first moment, mu) to the coefficients phi, and to the mass properties (massprop_cli/model/responsemap.py). */
#ifndef MASSPROP_RESPONSEMAP_H
#define MASSPROP_RESPONSEMAP_H

#include "massprop.h"

/* The body of a theta; `phi` (3, channels) NULL: what theta makes it. */
void mp_body(const mp_vehicle *vehicle, const mp_real theta[10], const mp_real bias[3], const mp_real acceleration[3],
             const mp_real *phi, mp_reference *out);
/* The body of mass properties about the CG. */
void mp_body_of(const mp_vehicle *vehicle, const mp_real inertia[3][3], const mp_real cg[3], mp_real mu, mp_reference *out);
/* phi, and its derivative by theta unless NULL. */
void mp_coefficients(const mp_vehicle *vehicle, const mp_real theta[10], mp_real phi[MP_COEFFICIENTS],
                     mp_real slopes[MP_COEFFICIENTS][10]);
void mp_parameters(const mp_vehicle *vehicle, const mp_real theta[10], mp_real out[10]);
void mp_slopes(const mp_vehicle *vehicle, const mp_real theta[10], mp_real out[10][10]);
/* The size that each of theta has by nature, and what a departure is small or large beside. */
void mp_sizes(const mp_vehicle *vehicle, const mp_real theta[10], mp_real out[10]);
void mp_scales(const mp_vehicle *vehicle, const mp_real theta[10], mp_real out[10]);
/* theta moved by a step, halved until it leads to a body; in place. */
void mp_stepped(const mp_vehicle *vehicle, mp_real theta[10], const mp_real step[10]);
/* theta moved by a step as far as that leads to a response of a body; not at all by one that is not finite. */
void mp_nearest(const mp_real theta[10], const mp_real step[10], mp_real out[10]);

#endif
