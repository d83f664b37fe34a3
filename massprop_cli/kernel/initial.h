/* A first reference from the cycles seen so far, with no starting values (massprop_cli/estimate/initial.py), kept as triangles. */
#ifndef MASSPROP_INITIAL_H
#define MASSPROP_INITIAL_H

#include "massprop.h"

void mp_start_add(const mp_vehicle *vehicle, mp_start *start, const mp_cycle *cycle);
/* 0 while neither the rates answer to torques nor the accelerations to forces. */
int mp_start_found(const mp_vehicle *vehicle, const mp_start *start, mp_reference *out);
/* What stands in while the log has said nothing. */
void mp_fallback(const mp_vehicle *vehicle, mp_reference *out);

#endif
