/* Suppositions held against the triangles of one log, each fitted with a body, for the ground. The equations stand in
 * massprop_cli/diagnosis/suppositions.py (what coefficients an x makes) and contest.py (how it is fitted), in NumPy as well. */
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "host.h"
#include "small.h"

/* Where entries stand in x. */
enum {
    MOMENT = 6,
    MU = 9,
    GYRO_TURN = 10,
    ACCEL_TURN = 13,
    GYRO_SCALE = 16,
    ACCEL_SCALE = 19,
    IMU = 22,
    BEARING = 25,
    GYRO_BIAS = 28,
    ACCEL_BIAS = 31,
    TORQUE = 34,
    DRAG = 37,
    DELAY = 40,
    RISE,
    LAG,
    GYRO_LAG,
    ACCEL_LAG,
    DRIFT,
    MASS_RATE,
    INERTIA_RATE,
    TILT,
    SLOPE = 50,
    THRUST = 52
};
/* Blocks of columns; a block begins at a place, or is not there. */
enum {
    CHANNELS,
    PRODUCTS,
    CONSTANT,
    RATES,
    LATER,
    LAGGING,
    SMEARED,
    DRIFTING,
    RISING,
    AGING,
    UP,
    LEVEL,
    EAST,
    NORTH,
    BY_SCALE,
    BY_BIAS = 17,
    SLOPES = 20
};

#define HALF_STEP 1e-6
#define LIGHTEST 10.0 /* times as heavy that a body may become by one step */
#define SLENDER 1e-4  /* least principal response over the largest */
#define ROUNDING 1e-9 /* part of the cost up to which a step that doesn't help ends a fit */

typedef double matrix[3][3];

/* What all suppositions about a log share. */
typedef struct {
    long channels, columns, entries;
    const long *places;
    const double *imu, *mounting, *bearing, *level, *up, *flat, *lags, *position, *force, *couple;
    double gravity, ramp;
    int pivoted;
} model;

/* A sensor's triangle by its columns (columns, rows), and what was measured (3, rows). */
typedef struct {
    long rows;
    const double *triangle, *measured, *root;
} told;

/* One supposition. */
typedef struct {
    const double *gyro, *accelerometer; /* (3, 3) */
    const double *freed[2];             /* (rows) of each sensor, NULL: no channel is free */
} supposed;

SHARED int mp_host_left(const long *sizes, const long *places, const double *numbers, const double *const *triangles, const double *x,
                        const double *turns, const double *freed, double *room, double *left);
SHARED int mp_host_fitted(const long *sizes, const long *places, const double *numbers, const double *const *triangles,
                          const double *turns, const double *freed, const double *moves, const double *pulled, const double *ends,
                          double *room, double *x, double *left, double *spread);

static const int FIRST[6] = {0, 0, 0, 1, 1, 2}, SECOND[6] = {0, 1, 2, 1, 2, 2};

static void cross(const double *a, const double *b, double *out) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static void cross_matrix(const double *v, matrix out) {
    out[0][0] = out[1][1] = out[2][2] = 0.0;
    out[0][1] = -v[2];
    out[0][2] = v[1];
    out[1][0] = v[2];
    out[1][2] = -v[0];
    out[2][0] = -v[1];
    out[2][1] = v[0];
}

/* (3, wide) out = a b, of b (3, wide). */
static void product(matrix a, const double *b, int wide, double *out) {
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < wide; j++) out[i * wide + j] = a[i][0] * b[j] + a[i][1] * b[wide + j] + a[i][2] * b[2 * wide + j];
}

static void inverse(matrix a, matrix out) {
    matrix cofactors;
    double determinant;
    int i, j;
    cross(a[1], a[2], cofactors[0]);
    cross(a[2], a[0], cofactors[1]);
    cross(a[0], a[1], cofactors[2]);
    determinant = a[0][0] * cofactors[0][0] + a[0][1] * cofactors[0][1] + a[0][2] * cofactors[0][2];
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) out[i][j] = cofactors[j][i] / determinant;
}

static void tensor(const double *six, matrix out) {
    int k;
    for (k = 0; k < 6; k++) out[FIRST[k]][SECOND[k]] = out[SECOND[k]][FIRST[k]] = six[k];
}

/* Rodrigues. */
static void rotation(const double *vector, matrix out) {
    double angle = sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
    double own = angle > 0.0 ? sin(angle) / angle : 1.0, half = angle > 0.0 ? sin(angle / 2) / (angle / 2) : 1.0;
    matrix turn, twice;
    int i, j;
    cross_matrix(vector, turn);
    product(turn, turn[0], 3, twice[0]);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) out[i][j] = (i == j ? 1.0 : 0.0) + own * turn[i][j] + half * half / 2 * twice[i][j];
}

/* Matrix (3, 6) of omega x (omega x arm) in the products of rates. */
static void by_products(const double *arm, double out[3][6]) {
    int k, i;
    memset(out, 0, 18 * sizeof(double));
    for (k = 0; k < 6; k++) {
        out[FIRST[k]][k] += arm[SECOND[k]];
        if (FIRST[k] != SECOND[k]) out[SECOND[k]][k] += arm[FIRST[k]];
        else
            for (i = 0; i < 3; i++) out[i][k] -= arm[i];
    }
}

/* A block's growth of the rate and specific force (3, wide) each, among the coefficients (columns, 6). */
static void put(const model *about, int block, const double *spin, const double *push, int wide, double *out) {
    long at = about->places[block];
    int i, j;
    if (at < 0) return;
    for (j = 0; j < wide; j++)
        for (i = 0; i < 3; i++) {
            out[(at + j) * 6 + i] = spin[i * wide + j];
            out[(at + j) * 6 + 3 + i] = push[i * wide + j];
        }
}

static void put_times(const model *about, int block, double by_spin, const double *spin, double by_push, const double *push, int wide,
                      double *out) {
    double parts[2][18];
    int i;
    for (i = 0; i < 3 * wide; i++) {
        parts[0][i] = by_spin * spin[i];
        parts[1][i] = by_push * push[i];
    }
    put(about, block, parts[0], parts[1], wide, out);
}

/* What the stated wrench does later, smeared, with a drifting clock, a longer rise or a body that changes. */
static void put_late(const model *about, const double *x, const double *response, const double *through, const double *thrust,
                     double *out) {
    double later[2], lagging[2], smeared[2], aging[18], aged[18];
    int i;
    for (i = 0; i < 2; i++) {
        double more = x[i ? ACCEL_LAG : GYRO_LAG], begins = about->lags[1 + i] == 0.0 ? more : 0.0;
        later[i] = x[DELAY] + x[LAG] + begins;
        lagging[i] = more - begins;
        smeared[i] = (later[i] * later[i] + x[LAG] * x[LAG] + begins * begins) / 2 + x[LAG] * about->lags[0];
        smeared[i] += about->ramp * x[RISE] * x[RISE];
    }
    put_times(about, LATER, later[0], response, later[1], thrust, 6, out);
    put_times(about, LAGGING, lagging[0], response, lagging[1], thrust, 6, out);
    put_times(about, SMEARED, smeared[0], response, smeared[1], thrust, 6, out);
    put_times(about, DRIFTING, x[DRIFT], response, x[DRIFT], thrust, 6, out);
    put_times(about, RISING, x[RISE], response, x[RISE], thrust, 6, out);
    for (i = 0; i < 18; i++) {
        aging[i] = -x[INERTIA_RATE] * response[i];
        aged[i] = -x[INERTIA_RATE] * through[i] - x[MASS_RATE] * (thrust[i] - through[i]);
    }
    put(about, AGING, aging, aged, 6, out);
}

/* What the vertical does, and a wrong one. */
static void put_vertical(const model *about, const double *x, matrix inverted, matrix seen, matrix turning, double *out) {
    matrix across, up[2], level[2], turn, own;
    double turned[3];
    int i, j, k;
    cross_matrix(x + MOMENT, across);
    product(inverted, across[0], 3, up[0][0]);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            up[0][i][j] *= -about->gravity;
            level[0][i][j] = -turning[i][j];
        }
    product(seen, up[0][0], 3, up[1][0]);
    product(seen, level[0][0], 3, level[1][0]);
    for (i = 0; i < 3; i++) {
        up[1][i][i] += about->gravity;
        level[1][i][i] += x[MU];
    }
    put(about, LEVEL, level[0][0], level[1][0], 3, out);
    cross(x + GYRO_TURN, about->up, turned);
    for (i = 0; i < 2; i++) {
        const double *flat = about->flat + 3 * i;
        double tilt = x[TILT + i] + flat[0] * turned[0] + flat[1] * turned[1] + flat[2] * turned[2];
        put_times(about, EAST + i, tilt, up[0][0], tilt, up[1][0], 3, out);
    }
    for (i = 0; i < 3; i++) {
        put_times(about, BY_SCALE + i, x[GYRO_SCALE + i], up[0][0], x[GYRO_SCALE + i], up[1][0], 3, out);
        put_times(about, BY_BIAS + i, x[GYRO_BIAS + i], up[0][0], x[GYRO_BIAS + i], up[1][0], 3, out);
    }
    if (about->places[EAST] >= 0) {
        cross_matrix(x + GYRO_TURN, turn);
        for (k = 0; k < 2; k++) {
            product(up[k], turn[0], 3, own[0]);
            for (i = 0; i < 3; i++)
                for (j = 0; j < 3; j++) up[k][i][j] -= own[i][j];
        }
    }
    put(about, UP, up[0][0], up[1][0], 3, out);
}

/* (6, 6) matrix of the products of turn omega in those of omega. */
static void of_products(matrix turn, double out[6][6]) {
    int k, m;
    for (k = 0; k < 6; k++)
        for (m = 0; m < 6; m++) {
            out[k][m] = turn[FIRST[k]][FIRST[m]] * turn[SECOND[k]][SECOND[m]];
            if (FIRST[m] != SECOND[m]) out[k][m] += turn[FIRST[k]][SECOND[m]] * turn[SECOND[k]][FIRST[m]];
        }
}

/* Rows (count, 6) of a block as those of rates that were turned: transposed by (count, count) times them. */
static void mixed(const double *by, int count, double *rows) {
    double was[6][6];
    int i, j, k;
    memcpy(was, rows, (size_t)(6 * count) * sizeof rows[0]);
    for (i = 0; i < count; i++)
        for (j = 0; j < 6; j++) {
            double sum = 0.0;
            for (k = 0; k < count; k++) sum += by[k * count + i] * was[k][j];
            rows[i * 6 + j] = sum;
        }
}

/* The coefficients as IMUs measure them that are turned or scaled. */
static void put_turned(const model *about, const double *x, const supposed *one, double *out) {
    matrix turns[2], mounting, along, rotated, part, back;
    double squares[6][6];
    int s, i, j, k;
    long c;
    memcpy(mounting, about->mounting, sizeof mounting);
    for (s = 0; s < 2; s++) {
        const double *scale = x + (s ? ACCEL_SCALE : GYRO_SCALE);
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) {
                along[i][j] = 0.0;
                for (k = 0; k < 3; k++) along[i][j] += mounting[i][k] * exp(scale[k]) * mounting[j][k];
            }
        rotation(x + (s ? ACCEL_TURN : GYRO_TURN), rotated);
        product(along, rotated[0], 3, part[0]);
        product(part, s ? one->accelerometer : one->gyro, 3, turns[s][0]);
    }
    for (c = 0; c < about->columns; c++)
        for (s = 0; s < 2; s++) {
            double *own = out + c * 6 + 3 * s, was[3] = {own[0], own[1], own[2]};
            for (i = 0; i < 3; i++) own[i] = turns[s][i][0] * was[0] + turns[s][i][1] * was[1] + turns[s][i][2] * was[2];
        }
    inverse(turns[0], back);
    of_products(back, squares);
    mixed(squares[0], 6, out + about->places[PRODUCTS] * 6);
    if (about->places[RATES] >= 0) mixed(back[0], 3, out + about->places[RATES] * 6);
}

static int straight(const double *x, const supposed *one) {
    int i, own = 1;
    for (i = GYRO_TURN; i < IMU; i++) own &= x[i] == 0.0;
    for (i = 0; i < 9; i++) own &= one->gyro[i] == (i % 4 == 0) && one->accelerometer[i] == (i % 4 == 0);
    return own;
}

/* (columns, 6) of x: growth of the rate, specific force. */
static void coefficients(const model *about, const double *x, const supposed *one, double *out) {
    matrix inverted, inertia, seen, across, turning, shifted;
    double centre[3], arm[3], leaning[3], pushed[3][6], leant[3][6], parts[2][3][6], constant[2][3], rates[2][3][3];
    double response[3][6], through[3][6], thrust[3][6];
    int i, j, k;
    long c;
    memset(out, 0, (size_t)(6 * about->columns) * sizeof out[0]);
    tensor(x, inverted);
    inverse(inverted, inertia);
    for (i = 0; i < 3; i++) {
        centre[i] = about->pivoted ? about->bearing[i] + x[BEARING + i] : x[MOMENT + i];
        arm[i] = about->imu[i] + x[IMU + i] - centre[i];
        leaning[i] = x[MOMENT + i] * x[MU];
    }
    /* specific force by angular acceleration */
    cross_matrix(arm, across);
    cross_matrix(leaning, shifted);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            seen[i][j] = -across[i][j];
            for (k = 0; about->pivoted && k < 3; k++) seen[i][j] += about->level[3 * i + k] * shifted[k][j];
        }
    /* products of rates: -J Gamma(I), of omega x I omega */
    for (k = 0; k < 6; k++) {
        double own[3], other[3] = {0.0, 0.0, 0.0}, unit[2][3] = {{0}};
        unit[0][FIRST[k]] = unit[1][SECOND[k]] = 1.0;
        cross(unit[0], inertia[SECOND[k]], own);
        if (FIRST[k] != SECOND[k]) cross(unit[1], inertia[FIRST[k]], other);
        for (i = 0; i < 3; i++) {
            parts[0][i][k] = 0.0;
            for (j = 0; j < 3; j++) parts[0][i][k] -= inverted[i][j] * (own[j] + other[j]);
        }
    }
    product(seen, parts[0][0], 6, parts[1][0]);
    by_products(arm, pushed);
    if (about->pivoted) {
        matrix level;
        memcpy(level, about->level, sizeof level);
        by_products(leaning, leant);
        product(level, leant[0], 6, response[0]);
        for (i = 0; i < 3; i++)
            for (k = 0; k < 6; k++) pushed[i][k] -= response[i][k];
    }
    for (i = 0; i < 3; i++)
        for (k = 0; k < 6; k++) parts[1][i][k] += pushed[i][k];
    product(inverted, x + TORQUE, 1, constant[0]);
    product(seen, constant[0], 1, constant[1]);
    for (i = 0; i < 3; i++) constant[1][i] += x[ACCEL_BIAS + i];
    if (about->places[RATES] >= 0) {
        const double *bias = x + GYRO_BIAS;
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) rates[0][i][j] = inverted[i][j] * x[DRAG + j];
        product(seen, rates[0][0], 3, rates[1][0]);
        for (k = 0; k < 6; k++)
            for (j = 0; j < 2; j++)
                for (i = 0; i < 3; i++) {
                    rates[j][i][FIRST[k]] -= parts[j][i][k] * bias[SECOND[k]];
                    rates[j][i][SECOND[k]] -= parts[j][i][k] * bias[FIRST[k]];
                    constant[j][i] += parts[j][i][k] * bias[FIRST[k]] * bias[SECOND[k]];
                }
        put(about, RATES, rates[0][0], rates[1][0], 3, out);
    }
    put(about, PRODUCTS, parts[0][0], parts[1][0], 6, out);
    put(about, CONSTANT, constant[0], constant[1], 1, out);
    cross_matrix(x + MOMENT, across);
    product(inverted, across[0], 3, turning[0]);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) turning[i][j] *= about->pivoted ? x[MU] : 0.0;
    for (c = 0; c < about->channels; c++) {
        const double *stated = about->force + 3 * c, *turn = x + THRUST + about->channels * 4 + 3 * c;
        double along[3], force[3], place[3], torque[3], spin[3], push[3], size = 0.0, own = 0.0, by;
        double *column = out + (about->places[CHANNELS] + c) * 6;
        for (i = 0; i < 3; i++) {
            along[i] = stated[i] + turn[i];
            place[i] = about->position[3 * c + i] + x[THRUST + about->channels + 3 * c + i];
            size += along[i] * along[i];
            own += stated[i] * stated[i];
        }
        by = x[THRUST + c] * (own > 0.0 ? sqrt(own) / sqrt(size) : sqrt(own));
        for (i = 0; i < 3; i++) force[i] = by * along[i];
        cross(place, force, torque);
        cross(centre, force, spin);
        for (i = 0; i < 3; i++) torque[i] += x[THRUST + c] * about->couple[3 * c + i] - spin[i];
        product(inverted, torque, 1, spin);
        product(seen, spin, 1, push);
        for (i = 0; i < 3; i++) {
            column[i] = spin[i];
            column[3 + i] = push[i] + x[MU] * force[i];
            for (j = 0; j < 3; j++) column[i] -= turning[i][j] * force[j];
        }
    }
    if (about->places[LATER] >= 0) {
        cross_matrix(centre, across);
        product(inverted, across[0], 3, shifted[0]);
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) {
                response[i][j] = inverted[i][j];
                response[i][3 + j] = -shifted[i][j];
            }
        product(seen, response[0], 6, through[0]);
        memcpy(thrust, through, sizeof thrust);
        for (i = 0; i < 3; i++) thrust[i][3 + i] += x[MU];
        put_late(about, x, response[0], through[0], thrust[0], out);
    }
    if (about->pivoted) put_vertical(about, x, inverted, seen, turning, out);
    for (k = 0; k < 2; k++) {
        double none[9] = {0.0}, slope[9] = {0.0};
        for (i = 0; i < 3; i++) slope[4 * i] = x[SLOPE + k];
        put(about, SLOPES + k, none, slope, 3, out);
    }
    if (!straight(x, one)) put_turned(about, x, one, out);
}

/* (6, columns) what coefficients (columns, 6) do to both triangles, less what was measured where that is wanted, over the noise; rows
 * beyond a triangle's are nothing. */
static void against(const model *about, const told sensors[2], const supposed *one, const double *made, int measured, double *left) {
    long p = about->columns, r, c;
    int s, a;
    memset(left, 0, (size_t)(6 * p) * sizeof left[0]);
    for (s = 0; s < 2; s++) {
        const told *own = sensors + s;
        for (a = 0; a < 3; a++) {
            double *row = left + (3 * s + a) * p, along = 0.0;
            const double *freed = one->freed[s];
            for (r = 0; measured && r < own->rows; r++) row[r] = -own->measured[a * own->rows + r];
            for (c = 0; c < p; c++) {
                const double *column = own->triangle + c * own->rows;
                double by = made[c * 6 + 3 * s + a];
                long end = c < own->rows ? c + 1 : own->rows;
                if (by == 0.0) continue; /* most are, of what isn't supposed */
                for (r = 0; r < end; r++) row[r] += by * column[r];
            }
            if (freed != NULL) {
                for (r = 0; r < own->rows; r++) along += freed[r] * row[r];
                for (r = 0; r < own->rows; r++) row[r] -= along * freed[r];
            }
            for (r = 0; r < own->rows; r++) row[r] /= own->root[3 * s + a];
        }
    }
}

static void left_of(const model *about, const told sensors[2], const double *x, const supposed *one, double *made, double *left) {
    coefficients(about, x, one, made);
    against(about, sensors, one, made, 1, left);
}

/* sizes: suppositions, channels, columns, entries of x, unknowns, rows of the gyro's triangle and of the accelerometer's. */
static void opened(const long *sizes, const long *places, const double *numbers, model *out) {
    out->channels = sizes[1];
    out->columns = sizes[2];
    out->entries = sizes[3];
    out->places = places;
    out->imu = numbers;
    out->mounting = numbers + 3;
    out->pivoted = numbers[12] != 0.0;
    out->bearing = numbers + 13;
    out->gravity = numbers[16];
    out->level = numbers + 17;
    out->up = numbers + 26;
    out->flat = numbers + 29;
    out->lags = numbers + 35;
    out->ramp = numbers[38];
    out->position = numbers + 39;
    out->force = out->position + 3 * out->channels;
    out->couple = out->force + 3 * out->channels;
}

/* triangles: that of the gyro, what it measured, the accelerometer's, what it measured, and the roots (6) of the noise. */
static void told_of(const long *sizes, const double *const *triangles, told out[2]) {
    int s;
    for (s = 0; s < 2; s++) {
        out[s].rows = sizes[5 + s];
        out[s].triangle = triangles[2 * s];
        out[s].measured = triangles[2 * s + 1];
        out[s].root = triangles[4];
    }
}

/* turns (H, 2, 3, 3); freed (H, rows of both) or NULL. */
static supposed one_of(const long *sizes, const double *turns, const double *freed, long h) {
    supposed one;
    const double *own = freed == NULL ? NULL : freed + h * (sizes[5] + sizes[6]);
    one.gyro = turns + h * 18;
    one.accelerometer = one.gyro + 9;
    one.freed[0] = own;
    one.freed[1] = own == NULL ? NULL : own + sizes[5];
    return one;
}

/* (H, 6, columns) for x (H, entries). room: 6 columns. */
int mp_host_left(const long *sizes, const long *places, const double *numbers, const double *const *triangles, const double *x,
                 const double *turns, const double *freed, double *room, double *left) {
    model about;
    told sensors[2];
    long h;
    opened(sizes, places, numbers, &about);
    told_of(sizes, triangles, sensors);
    for (h = 0; h < sizes[0]; h++) {
        supposed one = one_of(sizes, turns, freed, h);
        left_of(&about, sensors, x + h * about.entries, &one, room, left + h * 6 * about.columns);
    }
    return MP_OK;
}

static int is_body(const double *x) {
    mp_real given[3][3], values[3], axes[3][3];
    matrix own;
    int i, j;
    for (i = 0; i < 10; i++)
        if (!(x[i] - x[i] == 0.0)) return 0;
    tensor(x, own);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) given[i][j] = (mp_real)own[i][j];
    mp_eigen((const mp_real(*)[3])given, values, axes);
    return (double)values[0] > SLENDER * fabs((double)values[2]) && x[MU] > 0.0;
}

/* a x = b for b (n, m), in place, by elimination with pivots; 0 where a is singular. */
static int eliminated(double *a, int n, double *b, int m) {
    int i, j, k;
    for (k = 0; k < n; k++) {
        int best = k;
        for (i = k + 1; i < n; i++)
            if (fabs(a[i * n + k]) > fabs(a[best * n + k])) best = i;
        if (!(fabs(a[best * n + k]) > 0.0)) return 0;
        for (j = 0; best != k && j < n; j++) {
            double kept = a[k * n + j];
            a[k * n + j] = a[best * n + j];
            a[best * n + j] = kept;
        }
        for (j = 0; best != k && j < m; j++) {
            double kept = b[k * m + j];
            b[k * m + j] = b[best * m + j];
            b[best * m + j] = kept;
        }
        for (i = k + 1; i < n; i++) {
            double by = a[i * n + k] / a[k * n + k];
            for (j = k + 1; j < n; j++) a[i * n + j] -= by * a[k * n + j];
            for (j = 0; j < m; j++) b[i * m + j] -= by * b[k * m + j];
        }
    }
    for (i = n - 1; i >= 0; i--)
        for (j = 0; j < m; j++) {
            for (k = i + 1; k < n; k++) b[i * m + j] -= a[i * n + k] * b[k * m + j];
            b[i * m + j] /= a[i * n + i];
        }
    return 1;
}

/* In four sums, which needn't wait for one another. */
static double dot(const double *a, const double *b, long count) {
    double sums[4] = {0.0, 0.0, 0.0, 0.0};
    long i;
    for (i = 0; i + 4 <= count; i += 4) {
        sums[0] += a[i] * b[i];
        sums[1] += a[i + 1] * b[i + 1];
        sums[2] += a[i + 2] * b[i + 2];
        sums[3] += a[i + 3] * b[i + 3];
    }
    for (; i < count; i++) sums[0] += a[i] * b[i];
    return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

/* Where the numbers of one fit stand. */
typedef struct {
    double *made, *moving, *other, *slopes, *moved, *normal, *damped, *step, *offset; /* slopes (n, 6, columns) */
} room_of;

static room_of divided(double *room, long p, long nx, long n) {
    room_of own;
    own.made = room;
    own.moving = own.made + 6 * p;
    own.other = own.moving + 6 * p;
    own.slopes = own.other + 6 * p;
    own.moved = own.slopes + 6 * p * n;
    own.normal = own.moved + nx;
    own.damped = own.normal + n * n;
    own.step = own.damped + n * n;
    own.offset = own.step + n;
    return own;
}

/* The derivative along each move: coefficients by differences, in which what is left is linear. */
static void sloped(const model *about, const told sensors[2], const supposed *one, const double *moves, long n, const double *x,
                   const room_of *own) {
    long k, i, all = 6 * about->columns;
    coefficients(about, x, one, own->made);
    for (k = 0; k < n; k++) {
        for (i = 0; i < about->entries; i++) own->moved[i] = x[i] + HALF_STEP * moves[i * n + k];
        coefficients(about, own->moved, one, own->moving);
        for (i = 0; i < all; i++) own->moving[i] = (own->moving[i] - own->made[i]) / HALF_STEP;
        against(about, sensors, one, own->moving, 0, own->slopes + k * all);
    }
}

static void normal_of(const room_of *own, long all, long n, const double *pulled) {
    long i, j;
    for (i = 0; i < n; i++)
        for (j = 0; j <= i; j++) own->normal[i * n + j] = own->normal[j * n + i] = dot(own->slopes + i * all, own->slopes + j * all, all);
    for (i = 0; i < n; i++) own->normal[i * n + i] += pulled[i] * pulled[i];
}

/* Damped Gauss-Newton steps of one supposition (massprop_cli/diagnosis/contest.py, _Descent). ends: a change of -2 log likelihood that
 * ends it, measurements less coefficients, and the most steps. */
static int descended(const model *about, const told sensors[2], const supposed *one, const double *moves, long n, const double *pulled,
                     const double *ends, const room_of *own, double *x, double *left, double *spread) {
    long all = 6 * about->columns, i, k;
    double cost, damping = 1e-6;
    int again, due = 1;
    left_of(about, sensors, x, one, own->made, left);
    cost = dot(left, left, all);
    memset(own->offset, 0, (size_t)n * sizeof own->offset[0]);
    for (again = 0; again < (int)ends[2]; again++) {
        double then, gained;
        int wrong, better;
        if (due) {
            sloped(about, sensors, one, moves, n, x, own);
            normal_of(own, all, n, pulled);
        }
        due = 0;
        memcpy(own->damped, own->normal, (size_t)(n * n) * sizeof own->damped[0]);
        for (k = 0; k < n; k++) {
            own->step[k] = -pulled[k] * pulled[k] * own->offset[k] - dot(own->slopes + k * all, left, all);
            own->damped[k * n + k] += damping * own->normal[k * n + k];
        }
        if (!eliminated(own->damped, (int)n, own->step, 1)) return MP_NOT_FINITE;
        for (i = 0; i < about->entries; i++) {
            own->moved[i] = x[i];
            for (k = 0; k < n; k++) own->moved[i] += moves[i * n + k] * own->step[k];
        }
        /* a mass that the log doesn't tell may be any; what it does tell must not wait for it */
        if (own->moved[MU] < x[MU] / LIGHTEST) own->moved[MU] = x[MU] / LIGHTEST;
        wrong = !is_body(own->moved);
        if (wrong) memcpy(own->moved, x, (size_t)about->entries * sizeof x[0]);
        left_of(about, sensors, own->moved, one, own->made, own->other);
        then = dot(own->other, own->other, all);
        for (k = 0; k < n; k++) then += pulled[k] * pulled[k] * (own->offset[k] + own->step[k]) * (own->offset[k] + own->step[k]);
        better = then < cost && !wrong;
        gained = better ? cost - then : wrong || !(then <= cost * (1.0 + ROUNDING)) ? HUGE_VAL : 0.0;
        damping = better ? damping / 10.0 : damping * 10.0 + 1e-4;
        if (better) {
            memcpy(x, own->moved, (size_t)about->entries * sizeof x[0]);
            memcpy(left, own->other, (size_t)all * sizeof left[0]);
            for (k = 0; k < n; k++) own->offset[k] += own->step[k];
            cost = then;
            due = 1;
        }
        if (!(gained > ends[0] * (1.0 + cost / ends[1]))) break;
    }
    memset(own->damped, 0, (size_t)(n * n) * sizeof own->damped[0]);
    for (k = 0; k < n; k++) own->damped[k * n + k] = 1.0;
    if (!eliminated(own->normal, (int)n, own->damped, (int)n)) return MP_NOT_FINITE;
    for (k = 0; k < n; k++) spread[k] = sqrt(own->damped[k * n + k] > 0.0 ? own->damped[k * n + k] : 0.0);
    return MP_OK;
}

/* Each supposition fitted: x (H, entries) from where it begins to where it ends along moves (H, entries, n), left (H, 6, columns),
 * spread (H, n). room: 18 columns + (6 columns + 2 n + 2) n + entries. */
int mp_host_fitted(const long *sizes, const long *places, const double *numbers, const double *const *triangles, const double *turns,
                   const double *freed, const double *moves, const double *pulled, const double *ends, double *room, double *x,
                   double *left, double *spread) {
    model about;
    told sensors[2];
    room_of own = divided(room, sizes[2], sizes[3], sizes[4]);
    long h, n = sizes[4];
    int status = MP_OK;
    opened(sizes, places, numbers, &about);
    told_of(sizes, triangles, sensors);
    for (h = 0; h < sizes[0] && status == MP_OK; h++) {
        supposed one = one_of(sizes, turns, freed, h);
        status = descended(&about, sensors, &one, moves + h * about.entries * n, n, pulled, ends, &own, x + h * about.entries,
                           left + h * 6 * about.columns, spread + h * n);
    }
    return status;
}
