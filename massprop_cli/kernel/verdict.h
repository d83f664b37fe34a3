/* The ten quantities that are reported, and whether each stands still (massprop_cli/estimate/quantities.py, conclude/verdict.py). */
#ifndef MASSPROP_VERDICT_H
#define MASSPROP_VERDICT_H

#include "massprop.h"

/* What is known from elsewhere, and the rule. */
typedef struct {
    mp_real thrust_sigma;  /* common relative uncertainty of all thrust */
    int known;             /* how many quantities are known */
    int known_index[10];
    mp_real known_value[10];
    mp_real known_sigma[10];
    mp_real gate;          /* sigmas of a sensor's innovation in one cycle beyond which the reading is not used; 0: all are used */
    int count;             /* consecutive updates within tolerance */
    int relative;          /* whether tolerances are parts of natural sizes */
    mp_real tolerance[3];  /* inertia, CG, mass */
    mp_real beyond[6];     /* kg m^2, what the inertia in the equations has of wheels beyond the one that is reported */
} mp_rule;

enum mp_verdict {
    MP_UNTOLD = 0,        /* nothing can be said */
    MP_NOT_EXCITED = 1,   /* the motion has hardly informed it */
    MP_NOT_CONVERGED = 2, /* informed, but it has moved more than the tolerance */
    MP_CONVERGED = 3,
    MP_CONTRADICTED = 4   /* what is flown isn't what the tables say: not to be used */
};

/* ixx ixy ixz iyy iyz izz [kg m^2], cg_x cg_y cg_z [m], mass [kg]; on a pedestal inertia and first moment [kg m] about the pivot, no mass. */
typedef struct {
    int told[10];
    mp_real value[10];
    mp_real sigma[10];
    mp_real covariance[10][10]; /* of what is told */
    int verdict[10];
} mp_values;

/* How long each has stood still, and how much larger than stated what the model leaves is. */
typedef struct {
    int told[10];
    mp_real value[10];
    int steady[10];
    int counted[2];
    mp_real misfit[2]; /* running mean square of the normalised innovations, gyro's and accelerometer's: 1, where all is as stated */
} mp_steady;

/* The quantities of a row. Verdicts rest on the sizes known by then; on the ground they rest on those known at the end. */
void mp_report(const mp_rule *rule, const mp_pass *pass, const mp_row *row, mp_steady *steady, mp_values *out);

#endif
