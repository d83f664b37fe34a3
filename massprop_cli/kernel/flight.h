/* All that is flown, in one call per control cycle: alignment, the estimate, its quantities and verdicts. */
#ifndef MASSPROP_FLIGHT_H
#define MASSPROP_FLIGHT_H

#include "preprocess.h"
#include "massprop.h"
#include "verdict.h"

/* The caller owns the memory; sizeof(mp_flight) is all the RAM that is held from cycle to cycle. */
typedef struct {
    mp_preprocess preprocess;
    mp_pass pass;
    mp_rule rule;
    mp_steady steady;
    int far[2]; /* cycles in a row whose innovation of the gyro, of the accelerometer was beyond the gate */
    mp_cycle cycle;
    mp_row row;
} mp_flight;

/* Before the first cycle. MP_LIMIT where the tables are beyond a limit: until a begin succeeds, every call then returns MP_ORDER. */
int mp_flight_begin(mp_flight *flight, const mp_commands *commands, const mp_vehicle *vehicle, const mp_rule *rule);

/* One control cycle on, at its end. `made` is 1 where `out` says something new: see mp_preprocess_step for when it comes one call later.
 * A reading that no vehicle moves by is not used, nor up to MP_BELIEVED in a row whose innovation is beyond the rule's gate; such an
 * innovation counts for the verdict all the same. On any status but MP_OK nothing has changed and `made` is 0. */
int mp_flight_step(mp_flight *flight, const mp_flown *flown, mp_values *out, int *made);

/* After the last cycle. */
int mp_flight_last(mp_flight *flight, mp_values *out, int *made);

#endif
