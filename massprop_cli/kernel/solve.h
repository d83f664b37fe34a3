/* The mass properties that a triangle gives (massprop_cli/estimate/regression.py, triangle.py). */
#ifndef MASSPROP_SOLVE_H
#define MASSPROP_SOLVE_H

#include "massprop.h"

#define STALE R(0.1)  /* largest second-order error of what is linear about the reference, in sigmas, before it is renewed, */
#define ASTRAY R(0.4) /* and of a value given on the way, before a block is ended for it */

/* All that the run has taken in, about the estimate, with the data's own prior, in pass->posed. */
void mp_pose(mp_pass *pass);
/* What one more cycle's ordered rows (6, width) say, added. Innovations are judged by what stood before. */
void mp_judge(const mp_layout *layout, const mp_posed *posed, const mp_real *ordered, mp_real *rows, mp_real normalised[6], mp_real unexplained[6],
              mp_real spread[6][6]);
/* A row's mass properties, and 1 where theta is too far from the reference for the second order not to show. */
int mp_estimate(mp_pass *pass, mp_row *row);
/* The estimate that the run gives, in pass->estimate; what the data don't tell stays near the centre. */
void mp_improve(mp_pass *pass, mp_run *run);
/* Whether theta is so far from the reference, where it is known, that the second order shows; of a run's own estimate, posed. */
int mp_stale(const mp_pass *pass, const mp_real theta[10], const mp_real sigma[10], mp_real most);
int mp_stands(const mp_pass *pass);

#endif
