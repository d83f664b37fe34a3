/* The coefficients that any x makes: the equations of massprop_cli/diagnosis/coefficients.py, which has them in NumPy. */
#include "hypothesis.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

/* Where entries stand in x. */
enum {
    MOMENT = 6,
    MU = HYPOTHESIS_MU,
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
    FALL,
    DROOP,
    CYCLE_DROOP,
    LAG,
    GYRO_LAG,
    ACCEL_LAG,
    DRIFT,
    MASS_RATE,
    INERTIA_RATE,
    TILT,
    SLOPE = 53,
    ROOM_TORQUE = 55,
    THRUST = 58
};
/* Blocks of columns; a block begins at a place, or is not there. */
enum {
    CHANNELS = HYPOTHESIS_CHANNELS,
    PRODUCTS = HYPOTHESIS_PRODUCTS,
    CONSTANT,
    RATES,
    LATER,
    LAGGING,
    SMEARED,
    DRIFTING,
    RISING,
    FALLING,
    SAGGING,
    EBBING,
    AGING,
    UP = HYPOTHESIS_UP,
    LEVEL,
    EAST,
    NORTH,
    BY_SCALE,
    BY_BIAS = 20,
    SLOPES = 23,
    PRECESSION = HYPOTHESIS_PRECESSION
};

typedef double matrix[3][3];

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

/* 1/m; as if nothing moved the mass where its pivot stands still. */
static double mass_inverse(const mp_hypotheses *about, const double *x) { return about->translates ? x[MU] : 0.0; }

void mp_hypothesis_product(matrix a, const double *b, int wide, double *out) {
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < wide; j++) out[i * wide + j] = a[i][0] * b[j] + a[i][1] * b[wide + j] + a[i][2] * b[2 * wide + j];
}

void mp_hypothesis_inverse(matrix a, matrix out) {
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

void mp_hypotheses_of(const long *sizes, const long *places, const double *numbers, mp_hypotheses *out) {
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
    out->world = numbers + 26;
    out->room_torque = numbers + 35;
    out->steady = numbers + 38;
    out->lags = numbers + 41;
    out->ramp = numbers[44];
    out->thrusting = (long)numbers[45];
    out->translates = numbers[46] != 0.0;
    out->turns = numbers + 47;
    out->position = numbers + 50;
    out->force = out->position + 3 * out->channels;
    out->couple = out->force + 3 * out->channels;
}

void mp_sensors_of(const long *sizes, const double *const *triangles, mp_sensor out[2]) {
    int s;
    for (s = 0; s < 2; s++) {
        out[s].rows = sizes[5 + s];
        out[s].triangle = triangles[2 * s];
        out[s].measured = triangles[2 * s + 1];
        out[s].root = triangles[4];
    }
}

void mp_hypothesis_tensor(const double *six, matrix out) {
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
    mp_hypothesis_product(turn, turn[0], 3, twice[0]);
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
static void put(const mp_hypotheses *about, int block, const double *spin, const double *push, int wide, double *out) {
    long at = about->places[block];
    int i, j;
    if (at < 0) return;
    for (j = 0; j < wide; j++)
        for (i = 0; i < 3; i++) {
            out[(at + j) * 6 + i] = spin[i * wide + j];
            out[(at + j) * 6 + 3 + i] = push[i * wide + j];
        }
}

static void put_times(const mp_hypotheses *about, int block, double by_spin, const double *spin, double by_push, const double *push, int wide,
                      double *out) {
    double parts[2][18];
    int i;
    for (i = 0; i < 3 * wide; i++) {
        parts[0][i] = by_spin * spin[i];
        parts[1][i] = by_push * push[i];
    }
    put(about, block, parts[0], parts[1], wide, out);
}

/* What the stated wrench does later, smeared, with a drifting clock, a longer rise or fall, beside other jets, or a body that changes. */
static void put_late(const mp_hypotheses *about, const double *x, const double *response, const double *through, const double *thrust,
                     double *out) {
    double later[2], lagging[2], smeared[2], aging[18], aged[18];
    int i;
    for (i = 0; i < 2; i++) {
        double more = x[i ? ACCEL_LAG : GYRO_LAG], begins = about->lags[1 + i] == 0.0 ? more : 0.0;
        later[i] = x[DELAY] + x[LAG] + begins;
        lagging[i] = more - begins;
        smeared[i] = (later[i] * later[i] + x[LAG] * x[LAG] + begins * begins) / 2 + x[LAG] * about->lags[0];
        smeared[i] += about->ramp * x[RISE] * x[FALL];
    }
    put_times(about, LATER, later[0], response, later[1], thrust, 6, out);
    put_times(about, LAGGING, lagging[0], response, lagging[1], thrust, 6, out);
    put_times(about, SMEARED, smeared[0], response, smeared[1], thrust, 6, out);
    put_times(about, DRIFTING, x[DRIFT], response, x[DRIFT], thrust, 6, out);
    put_times(about, RISING, x[RISE], response, x[RISE], thrust, 6, out);
    put_times(about, FALLING, x[FALL], response, x[FALL], thrust, 6, out);
    put_times(about, SAGGING, x[DROOP], response, x[DROOP], thrust, 6, out);
    put_times(about, EBBING, x[CYCLE_DROOP], response, x[CYCLE_DROOP], thrust, 6, out);
    for (i = 0; i < 18; i++) {
        aging[i] = -x[INERTIA_RATE] * response[i];
        aged[i] = -x[INERTIA_RATE] * through[i] - x[MASS_RATE] * (thrust[i] - through[i]);
    }
    put(about, AGING, aging, aged, 6, out);
}

/* A block of the vertical, or of what is level (3, 3), and the torque along it that stands still in the room. */
static void put_with_torque(const mp_hypotheses *about, int block, double by, matrix spin, matrix push, double torque, matrix inverted,
                            matrix seen, double *out) {
    matrix parts[2], felt;
    int i, j;
    mp_hypothesis_product(seen, inverted[0], 3, felt[0]);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            parts[0][i][j] = by * spin[i][j] + torque * inverted[i][j];
            parts[1][i][j] = by * push[i][j] + torque * felt[i][j];
        }
    put(about, block, parts[0][0], parts[1][0], 3, out);
}

/* What the vertical does, and a wrong one; and what stands still in the room. */
static void put_vertical(const mp_hypotheses *about, const double *x, matrix inverted, matrix seen, matrix turning, double *out) {
    matrix across, up[2], level[2], turn, own;
    double turned[3], torque[3];
    int i, j, k, integrated = about->places[BY_SCALE] >= 0; /* whether the gyro carries the attitude */
    for (i = 0; i < 3; i++) torque[i] = about->room_torque[i] + x[ROOM_TORQUE + i];
    cross_matrix(x + MOMENT, across);
    mp_hypothesis_product(inverted, across[0], 3, up[0][0]);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            up[0][i][j] *= -about->gravity;
            level[0][i][j] = -turning[i][j];
        }
    mp_hypothesis_product(seen, up[0][0], 3, up[1][0]);
    mp_hypothesis_product(seen, level[0][0], 3, level[1][0]);
    for (i = 0; i < 3; i++) {
        up[1][i][i] += about->gravity;
        level[1][i][i] += mass_inverse(about, x);
    }
    put(about, LEVEL, level[0][0], level[1][0], 3, out);
    cross(x + GYRO_TURN, about->world + 6, turned);
    for (i = 0; i < 2; i++) {
        const double *flat = about->world + 3 * i;
        double away = (i ? x[TILT] : -x[TILT + 1]) + flat[0] * turned[0] + flat[1] * turned[1] + flat[2] * turned[2];
        put_with_torque(about, EAST + i, integrated ? away : 0.0, up[0], up[1], torque[i], inverted, seen, out);
    }
    for (i = 0; i < 3; i++) {
        put_times(about, BY_SCALE + i, x[GYRO_SCALE + i], up[0][0], x[GYRO_SCALE + i], up[1][0], 3, out);
        put_times(about, BY_BIAS + i, x[GYRO_BIAS + i], up[0][0], x[GYRO_BIAS + i], up[1][0], 3, out);
    }
    if (integrated) {
        cross_matrix(x + GYRO_TURN, turn);
        for (k = 0; k < 2; k++) {
            mp_hypothesis_product(up[k], turn[0], 3, own[0]);
            for (i = 0; i < 3; i++)
                for (j = 0; j < 3; j++) up[k][i][j] -= own[i][j];
        }
    }
    put_with_torque(about, UP, 1.0, up[0], up[1], torque[2], inverted, seen, out);
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
static void put_turned(const mp_hypotheses *about, const double *x, const mp_hypothesis *one, double *out) {
    matrix turns[2], along, rotated, part, back;
    double squares[6][6];
    int s, i;
    long c;
    for (s = 0; s < 2; s++) {
        mp_hypothesis_gain(about, x, s, along);
        rotation(x + (s ? ACCEL_TURN : GYRO_TURN), rotated);
        mp_hypothesis_product(along, rotated[0], 3, part[0]);
        mp_hypothesis_product(part, s ? one->accelerometer : one->gyro, 3, turns[s][0]);
    }
    for (c = 0; c < about->columns; c++)
        for (s = 0; s < 2; s++) {
            double *own = out + c * 6 + 3 * s, was[3] = {own[0], own[1], own[2]};
            for (i = 0; i < 3; i++) own[i] = turns[s][i][0] * was[0] + turns[s][i][1] * was[1] + turns[s][i][2] * was[2];
        }
    for (i = 0; i < 3; i++) { /* what carries the weight on a table was taken off as it is without a turn */
        const double *turn = turns[1][i], *steady = about->steady;
        out[about->places[CONSTANT] * 6 + 3 + i] += turn[0] * steady[0] + turn[1] * steady[1] + turn[2] * steady[2] - steady[i];
    }
    mp_hypothesis_inverse(turns[0], back);
    of_products(back, squares);
    mixed(squares[0], 6, out + about->places[PRODUCTS] * 6);
    if (about->places[RATES] >= 0) mixed(back[0], 3, out + about->places[RATES] * 6);
    for (c = about->thrusting; about->places[PRECESSION] >= 0 && c < about->channels; c++)
        mixed(back[0], 3, out + (about->places[PRECESSION] + HYPOTHESIS_PER_AXIS * (c - about->thrusting)) * 6);
}

static int straight(const double *x, const mp_hypothesis *one) {
    int i, own = 1;
    for (i = GYRO_TURN; i < IMU; i++) own &= x[i] == 0.0;
    for (i = 0; i < 9; i++) own &= one->gyro[i] == (i % 4 == 0) && one->accelerometer[i] == (i % 4 == 0);
    return own;
}

void mp_hypothesis_wrench(const mp_hypotheses *about, const double *x, long channel, const double *centre, double force[3], double torque[3]) {
    const double *pushed = about->force + 3 * channel, *couple = about->couple + 3 * channel, thrust = x[THRUST + channel];
    const double *turn = x + THRUST + about->channels * 4 + 3 * channel;
    const int pushes = pushed[0] != 0.0 || pushed[1] != 0.0 || pushed[2] != 0.0;
    const double *stated = pushes ? pushed : couple;
    double along[3], place[3], size = 0.0, own = 0.0, by;
    int i;
    for (i = 0; i < 3; i++) {
        along[i] = stated[i] + turn[i];
        place[i] = about->position[3 * channel + i] + x[THRUST + about->channels + 3 * channel + i] - centre[i];
        size += along[i] * along[i];
        own += stated[i] * stated[i];
    }
    by = thrust * (own > 0.0 ? sqrt(own) / sqrt(size) : sqrt(own));
    for (i = 0; i < 3; i++) force[i] = pushes ? by * along[i] : 0.0;
    cross(place, force, torque);
    for (i = 0; i < 3; i++) torque[i] += pushes ? thrust * couple[i] : by * along[i];
}

void mp_hypothesis_gain(const mp_hypotheses *about, const double *x, int sensor, matrix out) {
    const double *scale = x + (sensor ? ACCEL_SCALE : GYRO_SCALE), *mounting = about->mounting;
    int i, j, k;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            out[i][j] = 0.0;
            for (k = 0; k < 3; k++) out[i][j] += mounting[3 * i + k] * exp(scale[k]) * mounting[3 * j + k];
        }
}

void mp_hypothesis_precession(const double *torque, matrix out) {
    matrix across;
    int i, k;
    cross_matrix(torque, across);
    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++) out[i][k] = -across[i][k];
}

/* What the momentum of a channel does that turns with the body: rows by the products of rates and momentum, and by the gyro's bias. */
static void put_precession(const double *x, const double *torque, matrix inverted, matrix seen, double *rows) {
    matrix turned, parts[2];
    int i, k, s;
    mp_hypothesis_precession(torque, turned);
    mp_hypothesis_product(inverted, turned[0], 3, parts[0][0]);
    mp_hypothesis_product(seen, parts[0][0], 3, parts[1][0]);
    for (s = 0; s < 2; s++)
        for (i = 0; i < 3; i++) {
            double *bias = rows + 3 * 6 + 3 * s + i;
            *bias = 0.0;
            for (k = 0; k < 3; k++) {
                rows[k * 6 + 3 * s + i] = parts[s][i][k];
                *bias -= parts[s][i][k] * x[GYRO_BIAS + k];
            }
        }
}

void mp_hypothesis_coefficients(const mp_hypotheses *about, const double *x, const mp_hypothesis *one, double *out) {
    matrix inverted, inertia, seen, across, turning, shifted;
    double centre[3], arm[3], leaning[3], pushed[3][6], leant[3][6], parts[2][3][6], constant[2][3], rates[2][3][3];
    double response[3][6], through[3][6], thrust[3][6];
    int i, j, k;
    long c;
    memset(out, 0, (size_t)(6 * about->columns) * sizeof out[0]);
    mp_hypothesis_tensor(x, inverted);
    mp_hypothesis_inverse(inverted, inertia);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            inverted[i][j] *= about->turns[i] * about->turns[j];
            inertia[i][j] *= about->turns[i] * about->turns[j];
        }
    for (i = 0; i < 3; i++) {
        centre[i] = about->pivoted ? about->bearing[i] + x[BEARING + i] : x[MOMENT + i];
        arm[i] = about->imu[i] + x[IMU + i] - centre[i];
        leaning[i] = x[MOMENT + i] * mass_inverse(about, x);
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
    mp_hypothesis_product(seen, parts[0][0], 6, parts[1][0]);
    by_products(arm, pushed);
    if (about->pivoted) {
        matrix level;
        memcpy(level, about->level, sizeof level);
        by_products(leaning, leant);
        mp_hypothesis_product(level, leant[0], 6, response[0]);
        for (i = 0; i < 3; i++)
            for (k = 0; k < 6; k++) pushed[i][k] -= response[i][k];
    }
    for (i = 0; i < 3; i++)
        for (k = 0; k < 6; k++) parts[1][i][k] += pushed[i][k];
    mp_hypothesis_product(inverted, x + TORQUE, 1, constant[0]);
    mp_hypothesis_product(seen, constant[0], 1, constant[1]);
    for (i = 0; i < 3; i++) constant[1][i] += x[ACCEL_BIAS + i];
    if (about->places[RATES] >= 0) {
        const double *bias = x + GYRO_BIAS;
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) rates[0][i][j] = inverted[i][j] * x[DRAG + j];
        mp_hypothesis_product(seen, rates[0][0], 3, rates[1][0]);
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
    mp_hypothesis_product(inverted, across[0], 3, turning[0]);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) turning[i][j] *= about->pivoted ? mass_inverse(about, x) : 0.0;
    for (c = 0; c < about->channels; c++) {
        double force[3], torque[3], spin[3], push[3];
        double *column = out + (about->places[CHANNELS] + c) * 6;
        mp_hypothesis_wrench(about, x, c, centre, force, torque);
        mp_hypothesis_product(inverted, torque, 1, spin);
        mp_hypothesis_product(seen, spin, 1, push);
        for (i = 0; i < 3; i++) {
            column[i] = spin[i];
            column[3 + i] = push[i] + mass_inverse(about, x) * force[i];
            for (j = 0; j < 3; j++) column[i] -= turning[i][j] * force[j];
        }
        if (c >= about->thrusting && about->places[PRECESSION] >= 0)
            put_precession(x, torque, inverted, seen,
                           out + (about->places[PRECESSION] + HYPOTHESIS_PER_AXIS * (c - about->thrusting)) * 6);
    }
    if (about->places[LATER] >= 0) {
        cross_matrix(centre, across);
        mp_hypothesis_product(inverted, across[0], 3, shifted[0]);
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) {
                response[i][j] = inverted[i][j];
                response[i][3 + j] = -shifted[i][j];
            }
        mp_hypothesis_product(seen, response[0], 6, through[0]);
        memcpy(thrust, through, sizeof thrust);
        for (i = 0; i < 3; i++) thrust[i][3 + i] += mass_inverse(about, x);
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
