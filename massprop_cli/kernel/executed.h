/* What commands do in a cycle, as the body is moved and as gyro and accelerometer show it (massprop_cli/prepare/align.py and sensor.py). */
#ifndef MASSPROP_EXECUTED_H
#define MASSPROP_EXECUTED_H

#include "preprocess.h"

/* The commands of a cycle that starts `after` the present one, to be executed after the delay. Where a command has MP_PENDING pulses,
 * two of them become one of the same impulse. */
void mp_issued(mp_preprocess *preprocess, const mp_flown *flown, mp_real after);
/* What all commands do in the present cycle, of which the length is in place; then the next cycle is the present one. */
void mp_executed(mp_preprocess *preprocess, mp_cycle *cycle);
/* By how much the bins of a cycle are later than it: samples at records' ends stand for what was half a record before. */
mp_real mp_sampled_later(const mp_commands *table);

#endif
