/* From commands and IMU increments to what the estimator takes: when pulses act, body axes, the vertical
 * (massprop_cli/prepare/actuators.py, align.py and compensate.py). */
#ifndef MASSPROP_PREPROCESS_H
#define MASSPROP_PREPROCESS_H

#include "massprop.h"

#ifndef MP_COMMANDS
#define MP_COMMANDS 64 /* jets, or the six components of a wrench */
#endif
#ifndef MP_PENDING
#define MP_PENDING 24 /* pulses of one jet that are to come or still act, each by itself */
#endif
#ifndef MP_LAGS
#define MP_LAGS 2 /* of a sensor, first-order lags in parallel: a pair of complex ones counts once */
#endif

#define MP_BELIEVED 2 /* readings in a row that are left out because they are far off; the next one is motion */

/* What is shown of commands: H(s) = sum of weight / (1 + lag s), real and imaginary part each, all of it late, and of that means or
 * samples (massprop_cli/prepare/sensor.py). */
typedef struct {
    int instant;
    int lags;
    mp_real latency_s;
    mp_real weight[MP_LAGS][2], lag_s[MP_LAGS][2];
} mp_sensor;

enum { MP_MOVES, MP_GYRO, MP_ACCELEROMETER, MP_SENSORS }; /* by what the body is moved, and what shows it */

/* What is constant of the commands and of the IMU's mounting. */
typedef struct {
    int jets;        /* 0: commands are a wrench about O, held from one to the next */
    int commands;    /* jets, or 6 */
    int records;     /* of the IMU in a cycle, at even distances, the last at its end */
    int waits;       /* whether the next cycle's command may still act in a cycle */
    mp_real period_s;
    mp_real delay_s; /* from the start of the cycle that issued a command to its execution */
    mp_real memory_s; /* until nothing of it is shown any more */
    mp_real late;    /* part of what a pulse leaves of its cycle that is over when it begins */
    mp_real pulse_sigma;
    mp_sensor sensor[MP_SENSORS];
    mp_real body_from_imu[3][3];
    mp_real attitude_wxyz[4]; /* world from body, at the start of the first cycle */
    mp_real wrench[MP_COMMANDS][6]; /* torque about O and force of each jet at full thrust */
    mp_real rise_s[MP_COMMANDS];
    mp_real fall_s[MP_COMMANDS];
    mp_real own_delay_s[MP_COMMANDS]; /* beyond delay_s */
} mp_commands;

/* One control cycle as it is flown. */
typedef struct {
    mp_real end_s;
    mp_real duration_s;
    mp_real delta_theta[3];   /* rad, sum of the cycle's increments, IMU axes */
    mp_real delta_v[3];       /* m/s */
    int deaf[2];              /* whose gyro, whose accelerometer is not to be used */
    int unused;               /* whether it is of no phase: aligned, but not estimated from */
    mp_real command[MP_COMMANDS]; /* issued in this cycle: on-times [s], or torque [N m] and force [N] */
    mp_real speed[MP_SPUN]; /* of each wheel relative to the body, at its end, rad/s */
} mp_flown;

typedef struct {
    mp_real begin, end, level; /* s from the start of the present cycle */
    int combined; /* whether it has the impulse of several, for which there was no room; while it acts no sensor is used */
} mp_pulse;

/* What lags have come to: the signal behind them, and what its first and second integral lack of those before them. */
typedef struct {
    mp_real value, first, second;
} mp_lagged;

/* How the body has turned by the end of a cycle, by the gyro. */
typedef struct {
    mp_real rate[3];
    mp_real turn[3];
    mp_real attitude[4];  /* as integrated */
    mp_real window[3][3]; /* integral of world from body, and by what it and the gyro's bias have carried the attitude off: */
    mp_real off[3];
    mp_real squares_s2;   /* of the cycles: noise of the gyro has carried the attitude off by its root */
} mp_turned;

typedef struct {
    mp_commands table;
    mp_vehicle vehicle;
    int ready;
    int holding; /* whether `waiting` holds a cycle whose executed commands are not all known yet */
    int told; /* whether there was a cycle, */
    mp_real end_s; /* and when it ended */
    long cycles;
    int jumped; /* cycles in a row whose gyro showed another motion than the one before */
    mp_real since_s; /* from the first cycle's start to the present one's */
    int spun; /* whether wheels' speeds at the present cycle's start are known */
    mp_real speed[MP_SPUN];
    mp_real felt[3];           /* mean specific force of the latest completed cycle, body axes */
    mp_turned turned, before;  /* by the latest completed cycle, and by the one before it */
    mp_real bias[3];           /* of the gyro, rad/s, as the estimate has it by now */
    mp_real attitude_error[3][5];      /* at the start of the cycle that was completed last, for the first of a phase (mp_pass) */
    mp_real unread_s; /* from the present cycle's start, for which no sensor is used: a combined pulse acted */
    int pulses[MP_COMMANDS];
    mp_pulse pulse[MP_COMMANDS][MP_PENDING];
    mp_real lagging[MP_COMMANDS][MP_SENSORS][MP_LAGS][2]; /* each lag, times its weight, by pulses that are over */
    mp_flown waiting;
    mp_real integral[MP_BINS][MP_COMMANDS];
    mp_real moment[MP_BINS][MP_COMMANDS];
    mp_real rising[MP_COMMANDS], falling[MP_COMMANDS], whole[MP_COMMANDS];
} mp_preprocess;

/* Begin with a log's or a flight's first cycle. MP_LIMIT: more than MP_COMMANDS, MP_BINS or MP_WHEELS, a delay too long for MP_PENDING. */
int mp_preprocess_begin(mp_preprocess *preprocess, const mp_commands *table, const mp_vehicle *vehicle);

/* The next cycle. `made` tells how many cycles were completed by it, 0 or 1: where the table's `waits` says that a command of the next
 * cycle may go on with a pulse of this one, a cycle comes one call later. `usable` is 0 where it is of no phase, and where what was
 * executed had been commanded before the first cycle. */
int mp_preprocess_step(mp_preprocess *preprocess, const mp_flown *flown, mp_cycle *cycle, int *made, int *usable);

/* The cycle that was completed last, without its reading of the gyro, in whose place a rate stands (if a vehicle can turn so fast, or else
 * the rate of the cycle before), or without its reading of the accelerometer. */
void mp_preprocess_without_gyro(mp_preprocess *preprocess, const mp_real rate[3], mp_cycle *cycle);
void mp_preprocess_without_accelerometer(mp_cycle *cycle);

/* The cycle that waits for the next one's command, where nothing more comes. */
int mp_preprocess_last(mp_preprocess *preprocess, mp_cycle *cycle, int *made, int *usable);

#endif
