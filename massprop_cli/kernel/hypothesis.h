/* What could be wrong with log or vehicle file, as what it makes of the free coefficients of a log, for the ground. */
#ifndef MASSPROP_HYPOTHESIS_H
#define MASSPROP_HYPOTHESIS_H

#define HYPOTHESIS_MU 9 /* where 1/m stands in x */
/* Blocks of columns that stand in every triangle. */
#define HYPOTHESIS_CHANNELS 0
#define HYPOTHESIS_PRODUCTS 1
#define HYPOTHESIS_UP 13 /* on a bearing */
#define HYPOTHESIS_PRECESSION 25 /* of what stores momentum: for each axis of it the rates times the momentum, and the momentum */
#define HYPOTHESIS_PER_AXIS 4

/* What all hypotheses about a log share. */
typedef struct {
    long channels, columns, entries, thrusting; /* those of channels come first; the others store momentum */
    const long *places;
    const double *imu, *mounting, *bearing, *level, *world, *room_torque, *steady, *lags, *turns, *position, *force, *couple;
    double gravity, ramp;
    int pivoted, translates;
} mp_hypotheses;

/* One hypothesis. */
typedef struct {
    const double *gyro, *accelerometer; /* (3, 3) */
    const double *freed[2];             /* (rows) of each sensor, NULL: no channel is free */
} mp_hypothesis;

/* A sensor's triangle by its columns (columns, rows), what was measured (3, rows), and the root of the noise of each axis of both (6). */
typedef struct {
    long rows;
    const double *triangle, *measured, *root;
} mp_sensor;

/* What is handed from the ground. sizes: hypotheses, channels, columns, entries of x, unknowns, rows of the gyro's triangle and of the
 * accelerometer's; triangles: that of the gyro, what it measured, the accelerometer's, what it measured, and the roots of the noise. */
void mp_hypotheses_of(const long *sizes, const long *places, const double *numbers, mp_hypotheses *out);
void mp_sensors_of(const long *sizes, const double *const *triangles, mp_sensor out[2]);

/* (columns, 6) of x: growth of the rate, specific force. */
void mp_hypothesis_coefficients(const mp_hypotheses *about, const double *x, const mp_hypothesis *one, double *out);
/* Force of a channel, and torque about a centre, with its thrust, place and direction in x. */
/* (3, 3) torque of a channel's precession by the rate about each axis, of its torque by a unit. */
void mp_hypothesis_precession(const double *torque, double out[3][3]);
void mp_hypothesis_wrench(const mp_hypotheses *about, const double *x, long channel, const double *centre, double force[3], double torque[3]);
/* (3, 3) gain of a sensor (0: gyro, 1: accelerometer) by its scale along its own axes in x. */
void mp_hypothesis_gain(const mp_hypotheses *about, const double *x, int sensor, double out[3][3]);
/* (3, 3) of the six elements of a symmetric matrix. */
void mp_hypothesis_tensor(const double *six, double out[3][3]);
/* (3, wide) left times right. */
void mp_hypothesis_product(double left[3][3], const double *right, int wide, double *out);
void mp_hypothesis_inverse(double given[3][3], double out[3][3]);

#endif
