/* What could be wrong with log or vehicle file, as what it makes of the free coefficients of a log, for the ground. */
#ifndef MASSPROP_SUPPOSE_H
#define MASSPROP_SUPPOSE_H

#define SUPPOSED_MU 9 /* where 1/m stands in x */

/* What all suppositions about a log share. */
typedef struct {
    long channels, columns, entries;
    const long *places;
    const double *imu, *mounting, *bearing, *level, *up, *flat, *lags, *position, *force, *couple;
    double gravity, ramp;
    int pivoted;
} mp_suspect;

/* One supposition. */
typedef struct {
    const double *gyro, *accelerometer; /* (3, 3) */
    const double *freed[2];             /* (rows) of each sensor, NULL: no channel is free */
} mp_supposed;

/* (columns, 6) of x: growth of the rate, specific force. */
void mp_supposed_coefficients(const mp_suspect *about, const double *x, const mp_supposed *one, double *out);
/* (3, 3) of the six elements of a symmetric matrix. */
void mp_supposed_tensor(const double *six, double out[3][3]);

#endif
