/* A small square-root Kalman filter on the rate, biases, slow torques and tilt (massprop_cli/estimate/nuisance.py). */
#ifndef MASSPROP_FILTER_H
#define MASSPROP_FILTER_H

#include "motion.h"

/* In a phase's first cycle: all that is unknown has a column of its own. */
void mp_filter_begin(const mp_layout *layout, const mp_real attitude_error[3][5], mp_filter *filter);
/* One cycle on (`update` NULL: in the first), and measured; white (6, width) innovations and their lower root (6, 6). */
void mp_filter_step(const mp_layout *layout, mp_filter *filter, const mp_time_update *update, const mp_motion *here, mp_real *joint,
                    mp_real *white, mp_real root[6][6]);
/* White innovations as rows (6, beginnings + coefficients + 1) of unknowns and what is measured. */
void mp_ordered(const mp_layout *layout, const mp_real *white, mp_real *rows);
/* The rate unknown again where an error of its beginning has grown much: a free body's motion forgets. */
void mp_renew(const mp_vehicle *vehicle, const mp_layout *layout, mp_run *run);
/* A run before its first cycle. */
void mp_run_begin(const mp_layout *layout, long at, mp_run *run);

#endif
