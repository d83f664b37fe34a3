/* The causal estimator of mass properties, for flight: C99, fixed-size arrays, no allocation, recursion, globals or input and output.
 *
 * Body axes, SI. Inertia is about the CG, its products are the tensor's own elements; the CG is counted from the body origin O.
 * Ten parameters, in this order: ixx ixy ixz iyy iyz izz [kg m^2], cg_x cg_y cg_z [m], mu = 1/mass [1/kg].
 *
 * The same equations stand in NumPy in massprop_cli/model and massprop_cli/estimate; names agree, and the reasons stand there.
 * Arithmetic is + - * / and square roots alone, so that with -ffp-contract=off every machine gives the same bytes.
 */
#ifndef MASSPROP_H
#define MASSPROP_H

#ifdef MP_SINGLE
typedef float mp_real;
#define MP_SQRT sqrtf
#define MP_EPSILON ((mp_real)1.2e-7)
#define MP_TINY ((mp_real)1.2e-38)
#else
typedef double mp_real;
#define MP_SQRT sqrt
#define MP_EPSILON ((mp_real)2.3e-16)
#define MP_TINY ((mp_real)2.3e-308)
#endif

/* Limits. A smaller one may be given to the compiler; a vehicle beyond one is refused. */
#ifndef MP_BINS
#define MP_BINS 64 /* parts of a cycle in which its motion is resolved */
#endif
#ifndef MP_CHANNELS
#define MP_CHANNELS 15 /* columns of the response: 15 on a bearing whose base slides, else 12 */
#endif
#ifndef MP_PIVOTED
#define MP_PIVOTED 1 /* whether the vehicle may stand on a bearing or a pedestal */
#endif
#ifndef MP_WHEELS
#define MP_WHEELS 4 /* reaction wheels whose speed is measured */
#endif
#define MP_SPUN (MP_WHEELS > 0 ? MP_WHEELS : 1)
#define MP_SPUN_BINS (MP_WHEELS > 0 ? MP_BINS : 1)
#ifndef MP_BEGINNINGS
#define MP_BEGINNINGS (16 + MP_WHEELS) /* states, whose beginning is unknown: rate, gyro bias, accelerometer bias, slow torque, attitude, scales */
#endif

#define MP_STATES MP_BEGINNINGS
#define MP_COEFFICIENTS (3 * MP_CHANNELS + 4)
#define MP_WIDTH (1 + MP_COEFFICIENTS + MP_BEGINNINGS)
#define MP_UNKNOWNS (MP_BEGINNINGS + 28)
#define MP_PROCESS 15
#define MP_PACKED(n) ((n) * ((n) + 1) / 2)

#define MP_UNTOLD_MASS ((mp_real)0.3) /* a relative sigma of 1/m above this says nothing about m; */
#define MP_FAINT_MASS ((mp_real)0.03) /* above this, on a bearing, a known mass tells it */
#define MP_BLOCK 16 /* cycles between looks at the estimate where it has just moved, */
#ifndef MP_LONGEST
#define MP_LONGEST 128 /* and at most */
#endif
#ifndef MP_RING
#define MP_RING 256 /* cycles that are taken in anew when the estimate has moved: once each axis is known, */
#endif
#ifndef MP_LEARNING
#define MP_LEARNING 1024 /* and before; a multiple of MP_BLOCK */
#endif
#define MP_HELD (MP_LEARNING + MP_LONGEST + 2)
#define MP_CHECKPOINTS (MP_LEARNING / MP_BLOCK + 4)

enum mp_status {
    MP_OK = 0,
    MP_NOT_FINITE = 1, /* a number that isn't finite, or a command that none can be; the state is unchanged */
    MP_TIME = 2,       /* a cycle far too short or too long, or not after the last, or a million periods after it; the state is unchanged */
    MP_LIMIT = 3,      /* a vehicle beyond a limit */
    MP_ORDER = 4       /* a call before the one that must go first */
};

/* What is constant: of the vehicle, its noise levels resolved. */
typedef struct {
    int bearing;         /* 0: free flight; 1: its base slides; 2: on a pedestal, where it stands still */
    int gyro_bias;       /* whether each of these is a state */
    int accel_bias;
    int slow_torque;
    int tilt;
    int bins;            /* 2 ... MP_BINS */
    int pulses;          /* whether pulses err */
    mp_real imu[3];      /* position of the IMU from O, m */
    mp_real gyro_noise;  /* rad/s, one sigma of a cycle's mean rate */
    mp_real accel_noise[3];
    mp_real gyro_bias_sigma;
    mp_real accel_bias_sigma;
    mp_real torque_noise;      /* N m, white, of a cycle */
    mp_real torque_walk;       /* N m per cycle */
    mp_real gyro_bias_walk;    /* rad/s per root of a second */
    mp_real prior_scale;       /* prior sigma over natural sizes */
    mp_real reach;             /* m, of the farthest jet */
    mp_real known_mass;        /* kg, 0: not known */
    mp_real centre[3];         /* bearing's position from O, m */
    mp_real bearing_mass;      /* kg */
    mp_real gravity;           /* m/s^2 */
    int filtered;              /* whether the sensors are sampled or low-pass filtered, so that mean readings are not the mean motion */
    mp_real curvature;         /* s^2, mean reading less mean rate, over the growth of the angular acceleration that commands do not make */
    mp_real later;             /* s, by which the motion that the accelerometer shows is later than the gyro's */
    mp_real smearing;          /* s^2, by so many times its second derivative the accelerometer shows the weight otherwise */
    mp_real thrust_sigma;      /* relative, of all thrust, beside wheels, where the estimate follows it */
    int wheels;                /* up to MP_WHEELS */
    mp_real axis[MP_SPUN][3]; /* of positive speed */
    mp_real spin_sigma[MP_SPUN]; /* of its spin inertia, relative */
    mp_real spin_inertia[MP_SPUN]; /* kg m^2 about it */
    mp_real free_inertia[MP_SPUN]; /* of it, by which what it stores follows the body's rate within a cycle */
} mp_vehicle;

/* Whether it is on a bearing or a pedestal. Compiled without, what only these want is left out. */
#define MP_ON_BEARING(vehicle) (MP_PIVOTED && (vehicle)->bearing)
/* Whether its base slides. */
#define MP_SLIDES(vehicle) (MP_CHANNELS > 12 && MP_PIVOTED && (vehicle)->bearing == 1)
/* Whether it is on a pedestal: then inertia is about the pivot, the CG is there plus mu times the first moment, and mu is what was assumed. */
#define MP_ON_PEDESTAL(vehicle) (MP_PIVOTED && (vehicle)->bearing == 2)

/* One cycle: what the IMU told, and what the commands did. Body axes. */
typedef struct {
    mp_real end_s;
    mp_real duration_s;
    mp_real rate[3];      /* mean, rad/s */
    mp_real rate_step[3]; /* from the cycle before */
    mp_real carried[3];   /* mean rate by which the attitude was carried from up[0] to up[1] */
    mp_real force[3];     /* mean specific force, m/s^2 */
    mp_real up[2][3];     /* vertical at the start and at the end; zeros in free flight */
    mp_real impulse[MP_BINS][6]; /* torque about O [N m s] and force [N s] in equal parts of the cycle */
    mp_real skew[MP_BINS][6];    /* first moment about the middle of its part, over the part's length */
    mp_real rising[6];    /* impulse weighted with the rising half of the triangular window */
    mp_real falling[6];   /* with the falling half */
    mp_real whole[6];     /* over the cycle, as the accelerometer averages it */
    mp_real pulse_covariance[6][6];
    mp_real momentum[MP_SPUN_BINS][MP_SPUN]; /* of each wheel in parts of the cycle, N m s: mean, */
    mp_real growing[MP_SPUN_BINS][MP_SPUN];  /* first moment about the middle of its part, over the part's length */
    mp_real grown[3][MP_SPUN];          /* torque on it as `rising`, `falling` and `whole` have wrenches, in which its reaction is, too */
    int deaf[2];          /* whose gyro, whose accelerometer is not used */
} mp_cycle;

/* The body about which the equations are linear. */
typedef struct {
    mp_real theta[10];     /* J = inverse inertia (about the CG, or the bearing), CG or first moment, mu */
    mp_real inertia[3][3]; /* about the CG */
    mp_real cg[3];
    mp_real mu;
    mp_real bias[3];       /* of the gyro, rad/s */
    mp_real acceleration[3]; /* by a slow torque, rad/s^2 */
    mp_real scale[1 + MP_WHEELS]; /* error of each scale that is a state */
    mp_real phi[3][MP_CHANNELS];
} mp_reference;

/* What one cycle is to the equations, about a reference. */
typedef struct {
    mp_real duration_s;
    mp_real raw_rate[3];
    mp_real carried[3];         /* mean rate by which the attitude was carried on, less what it turned beyond */
    mp_real rate[3];            /* less the gyro's bias */
    mp_real rising[MP_CHANNELS]; /* what phi multiplies, under the halves of the window */
    mp_real falling[MP_CHANNELS];
    mp_real known[2][3];        /* known growth of the rate under them */
    mp_real turning[2][3];      /* rate under them */
    mp_real up[2][3];           /* vertical under them */
    mp_real push[2][3];         /* force under them */
    mp_real measured[3];        /* specific force less what is known */
    mp_real euler[3][3];        /* specific force by angular acceleration */
    mp_real mean[MP_CHANNELS];  /* what phi multiplies, mean over the cycle */
    mp_real own[3][4];          /* specific force by mu, and by c or mu kappa */
    mp_real by_rate[3][3];      /* specific force by an error of the rate */
    mp_real by_tilt[3][3];      /* specific force by an error of attitude */
    mp_real pulse_root[3][3];   /* root of the moment that pulses err by, N m s */
    mp_real noise[6][6];        /* lower root of the measurements' noise */
    mp_real stored[2][3];       /* momentum of all wheels under the halves of the window, N m s^2 */
    mp_real scaled[1 + MP_WHEELS][2][3]; /* impulse of the moment under them by a unit of each scale that is a state, */
    mp_real felt[1 + MP_WHEELS][3]; /* and the specific force */
} mp_motion;

/* The filter on all that is not of interest: a column for the log, for each coefficient and for each unknown beginning. */
typedef struct {
    mp_real mean[MP_STATES][MP_WIDTH];
    mp_real root[MP_STATES][MP_STATES];
} mp_filter;

/* What is kept of the cycles before `at`. */
typedef struct {
    long at;
    int begun;
    int bound; /* whether each axis is known without the gyroscopic coupling */
    int stuck; /* whether the search ended where no further step leads to a body, though the data want one */
    mp_filter filter;
    mp_real triangle[MP_PACKED(MP_WIDTH)];
} mp_run;

/* A triangle on nuisances and on the departure of theta, about one theta. */
typedef struct {
    int bound;
    int count; /* unknowns, the last ten are theta's */
    mp_real theta[10];
    mp_real scale[10];
    mp_real phi[MP_COEFFICIENTS];
    mp_real slopes[MP_COEFFICIENTS][10]; /* by departures over scale */
    mp_real triangle[MP_PACKED(MP_UNKNOWNS + 1)];
} mp_posed;

/* What is said after a cycle. */
typedef struct {
    int told;      /* whether anything is said of the parameters */
    int expected[2]; /* whether rates, whether forces were expected */
    int beyond[2];   /* whose innovation is beyond the gate, so that the cycle was not taken in */
    mp_real mean[10];
    mp_real covariance[10][10]; /* linear in theta */
    mp_real relative[3];   /* sigmas of J_xx, J_yy, J_zz over these: by so much I = J^-1 is curved */
    mp_real rate[3];       /* predicted reading of the gyro, body axes, rad/s */
    mp_real innovation[6]; /* torque [N m] and force [N] */
    mp_real sigma[6];
    mp_real normalised[6];
} mp_row;

/* Sums from which a first reference is found. */
typedef struct {
    long cycles;
    mp_real triangle[MP_PACKED(16)]; /* load, products, duration; torque; growth */
    mp_real push[3][3];              /* of each axis: triangle of force and acceleration */
    mp_real duration_s;
    mp_real growth;                  /* largest */
    mp_real rate[3];
    mp_real load[3];
    mp_real stored[3];
    mp_real area[6];
    mp_real falling[6];
    mp_real rising[6];
} mp_start;

typedef struct {
    int channels, coefficients, states, beginnings, width, process;
    int at_bias, at_accel, at_torque, at_tilt; /* states, or -1 */
    int at_scale, scales;                      /* scales, one state each, */
    int scale[1 + MP_WHEELS];                  /* of a wheel, or -1: of all thrust */
    mp_real prior[16 + MP_WHEELS]; /* one sigma of each unknown beginning */
} mp_layout;

/* From one cycle into the next. */
typedef struct {
    mp_real transition[MP_STATES][MP_STATES];
    mp_real process[MP_STATES][MP_PROCESS]; /* root of the process noise */
    mp_real solve[3][3];
    mp_real to_rate[3][3];     /* impulse of a moment to its growth of the mean rate */
    mp_real step[MP_CHANNELS]; /* what phi multiplies, and solve what that makes */
    mp_real drive[MP_STATES];  /* the states' own */
} mp_time_update;

/* Room for what is not kept from one cycle to the next. */
typedef struct {
    mp_motion motion;
    mp_time_update update;
    mp_real joint[(6 + MP_STATES) * (6 + MP_STATES + MP_PROCESS)];
    mp_real white[6 * MP_WIDTH];
    mp_real ordered[6 * MP_WIDTH];
    mp_real rows[MP_WIDTH * (MP_UNKNOWNS + 1)];
    mp_posed posed;
    mp_filter filter; /* before the present cycle */
} mp_room;

/* All of it. The caller owns the memory. */
typedef struct {
    mp_vehicle vehicle;
    mp_layout layout;
    int ready;
    int started;
    long due;     /* cycle of the next attempt to find a first reference */
    long spare;   /* cycles that may still be taken in anew */
    long moved;   /* cycle at which the reference was last moved */
    long block_begin, block_end;
    mp_real begun_s;
    mp_real end_s;
    mp_real attitude_error[3][5]; /* from the attitude to the true one at the first cycle's start: known, by the gyro's bias; s, by its noise */
    mp_reference reference, estimate, centre;
    mp_real centre_sizes[10];
    mp_start start;
    mp_posed posed; /* about the estimate at the block's beginning, */
    mp_real pull[10]; /* and by what sigmas the centre draws what the data don't tell there */
    mp_run run;
    int first, runs; /* of the ring */
    mp_motion last;  /* the latest cycle about the reference */
    mp_run ring[MP_CHECKPOINTS]; /* from here on nothing is read before it is written */
    mp_cycle held[MP_HELD];
    mp_room room;
} mp_pass;

/* Begin. MP_LIMIT: more bins than MP_BINS, a bearing without MP_CHANNELS, more states than MP_BEGINNINGS; mp_step then returns MP_ORDER. */
int mp_begin(mp_pass *pass, const mp_vehicle *vehicle);

/* Take one cycle in, and say what is known after it. MP_ORDER before mp_begin. `gate` (NULL: none): sigmas of the innovation of gyro and
 * of accelerometer, 0 for no limit. Where there is an estimate and an innovation is beyond its gate, row->beyond says which (the gyro's, or
 * else the accelerometer's), and nothing else has changed: call again with another cycle or gate. */
int mp_step(mp_pass *pass, const mp_cycle *cycle, const mp_real *gate, mp_row *row);
/* Whether the norm of a sensor's normalised innovation in a row is beyond a gate; never where the gate is 0. */
int mp_beyond(const mp_row *row, int sensor, mp_real gate);

#endif
