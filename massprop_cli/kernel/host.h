/* The kernel over arrays, for the ground: numbers in double precision by rows, whatever the kernel's own precision. None of it flies. */
#ifndef MASSPROP_HOST_H
#define MASSPROP_HOST_H

#include "massprop.h"

#if defined(_WIN32)
#define SHARED __declspec(dllexport)
#else
#define SHARED __attribute__((visibility("default")))
#endif

/* So many numbers copied; where the next ones are. */
const double *mp_copied(mp_real *to, const double *from, int count);
mp_vehicle mp_vehicle_of(const double *table);
void mp_cycle_of(const mp_vehicle *vehicle, const double *row, mp_cycle *out);
/* A vehicle, its states, and the body that its equations are linear about; MP_LIMIT as mp_laid_out. */
int mp_about_of(const double *table, const double *reference, mp_vehicle *vehicle, mp_layout *layout, mp_reference *about);

#endif
