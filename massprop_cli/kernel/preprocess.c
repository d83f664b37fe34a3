#include "preprocess.h"

#include <math.h>
#include <string.h>

#include "linalg.h"

#define TOUCHING R(1e-3)   /* pulses that end and begin within this part of a cycle are one; others overlap, and give all they have */
#define CANCELLED R(1e-12) /* part of what each channel makes alone below which their sum is rounding */
#define OPEN R(1e30)       /* s; the end of what is held until the next command */
#define FARTHEST R(3)      /* sigmas of the gyro's bias beyond which it is none */
#define ROUNDED R(1e-9)    /* s by which a sample is before what begins at its time */
#define FORGOTTEN R(-45)   /* logarithm of what a lag keeps that is below the last digit of anything */

int mp_preprocess_begin(mp_preprocess *preprocess, const mp_commands *table, const mp_vehicle *vehicle) {
    mp_real ramps = R(0), latest = R(0);
    int i;
    if (table->commands > MP_COMMANDS || (!table->jets && table->commands != 6)) return MP_LIMIT;
    if (vehicle->bins < 2 || vehicle->bins > MP_BINS || vehicle->wheels > MP_WHEELS || !(table->period_s > R(0))) return MP_LIMIT;
    for (i = 0; i < table->commands; i++) ramps = mp_max(ramps, table->rise_s[i] + table->fall_s[i] + table->own_delay_s[i]);
    for (i = 0; i < MP_SENSORS; i++) latest = mp_max(latest, table->sensor[i].latency_s);
    if (!((table->delay_s + ramps + latest) / table->period_s + R(4) < R(MP_PENDING))) return MP_LIMIT;
    memset(preprocess, 0, sizeof *preprocess);
    preprocess->table = *table;
    preprocess->vehicle = *vehicle;
    for (i = 0; i < 4; i++) preprocess->attitude[i] = table->attitude_wxyz[i];
    preprocess->ready = 1;
    return MP_OK;
}

/* The commands of a cycle that starts `after` the present one, to be executed after the delay. */
static int issued(mp_preprocess *preprocess, const mp_flown *flown, mp_real after) {
    const mp_commands *table = &preprocess->table;
    int j, full = 0;
    for (j = 0; j < table->commands; j++) full |= preprocess->pulses[j] == MP_PENDING;
    if (full) return MP_LIMIT;
    for (j = 0; j < table->commands; j++) {
        mp_pulse *pulses = preprocess->pulse[j], *last;
        mp_real begin = after + table->delay_s + table->own_delay_s[j];
        int count = preprocess->pulses[j];
        if (table->jets && !(flown->command[j] > R(0))) continue;
        if (table->jets) begin += table->late * mp_max(table->period_s - flown->command[j], R(0));
        last = count > 0 ? pulses + count - 1 : NULL;
        if (table->jets && last != NULL && !(mp_abs(begin - last->end) > TOUCHING * table->period_s)) {
            last->end = begin + flown->command[j];
            continue;
        }
        if (!table->jets && last != NULL) last->end = begin;
        pulses[count].begin = begin;
        pulses[count].end = table->jets ? begin + flown->command[j] : OPEN;
        pulses[count].level = table->jets ? R(1) : flown->command[j];
        preprocess->pulses[j] = count + 1;
    }
    return MP_OK;
}

/* Commands of which something is executed, or may yet be. */
typedef struct {
    int count, which[MP_COMMANDS];
} acting;

static void acting_of(const mp_preprocess *preprocess, acting *out) {
    const mp_sensor *sensor = preprocess->table.sensor;
    int j, lags = sensor[MP_MOVES].lags + sensor[MP_GYRO].lags + sensor[MP_ACCELEROMETER].lags;
    out->count = 0;
    for (j = 0; j < preprocess->table.commands; j++)
        if (preprocess->pulses[j] > 0 || lags > 0) out->which[out->count++] = j;
}

/* A part of a pulse that goes linearly from one level to another. */
typedef struct {
    mp_real begin, end, from, to;
} stretch;

static int stretches(const mp_commands *table, int j, const mp_pulse *pulse, stretch out[3]) {
    mp_real rise = table->rise_s[j], fall = table->fall_s[j], top = mp_min(pulse->begin + rise, pulse->end), reached = pulse->level;
    int count = 0;
    if (rise > R(0)) {
        reached *= (top - pulse->begin) / rise;
        out[count++] = (stretch){pulse->begin, top, R(0), reached};
    }
    out[count++] = (stretch){top, pulse->end, reached, reached};
    if (fall > R(0)) out[count++] = (stretch){pulse->end, pulse->end + reached * fall, reached, R(0)};
    return count;
}

/* Integral over a time, and first moment about its beginning, of what command j does before any lag. */
static void acted(const mp_preprocess *preprocess, int j, mp_real begin, mp_real end, mp_real *integral, mp_real *moment) {
    int k, n;
    *integral = *moment = R(0);
    for (k = 0; k < preprocess->pulses[j]; k++) {
        stretch part[3];
        int count = stretches(&preprocess->table, j, &preprocess->pulse[j][k], part);
        for (n = 0; n < count; n++) {
            mp_real from = mp_max(begin, part[n].begin), to = mp_min(end, part[n].end), slope, v0, v1, length = to - from;
            if (!(to > from)) continue;
            slope = (part[n].to - part[n].from) / (part[n].end - part[n].begin);
            v0 = part[n].from + slope * (from - part[n].begin);
            v1 = part[n].from + slope * (to - part[n].begin);
            *integral += length * (v0 + v1) / R(2);
            *moment += length * ((from - begin) * (v0 + v1) / R(2) + length * (v0 + R(2) * v1) / R(6));
        }
    }
}

/* What it does at a time; of a step at that time nothing yet. */
static mp_real level(const mp_preprocess *preprocess, int j, mp_real at) {
    mp_real found = R(0);
    int k, n;
    for (k = 0; k < preprocess->pulses[j]; k++) {
        stretch part[3];
        int count = stretches(&preprocess->table, j, &preprocess->pulse[j][k], part);
        for (n = 0; n < count; n++)
            if (at - ROUNDED > part[n].begin && at - ROUNDED <= part[n].end)
                found += part[n].from + (part[n].to - part[n].from) * ((at - part[n].begin) / (part[n].end - part[n].begin));
    }
    return found;
}

static void multiplied(const mp_real a[2], const mp_real b[2], mp_real out[2]) {
    mp_real real = a[0] * b[0] - a[1] * b[1];
    out[1] = a[0] * b[1] + a[1] * b[0];
    out[0] = real;
}

/* exp(-t / lag): a series, and squared again as often as t was halved for it. */
static void kept(mp_real time_s, const mp_real lag_s[2], mp_real out[2]) {
    mp_real size = lag_s[0] * lag_s[0] + lag_s[1] * lag_s[1], z[2], term[2] = {R(1), R(0)};
    int k, halved = 0;
    z[0] = -time_s * lag_s[0] / size;
    z[1] = time_s * lag_s[1] / size;
    out[0] = z[0] < FORGOTTEN ? R(0) : R(1);
    out[1] = R(0);
    if (z[0] < FORGOTTEN) return;
    for (; mp_abs(z[0]) + mp_abs(z[1]) > R(1); halved++) {
        z[0] /= R(2);
        z[1] /= R(2);
    }
    for (k = 1; k <= TERMS; k++) {
        multiplied(term, z, term);
        term[0] /= R(k);
        term[1] /= R(k);
        out[0] += term[0];
        out[1] += term[1];
    }
    for (k = 0; k < halved; k++) multiplied(out, out, out);
}

/* What a lag has come to, from zero, by a signal that began at a level a time ago and rises since; added. */
static void let_through(mp_real since_s, mp_real from, mp_real slope, const mp_real lag_s[2], const mp_real weight[2], mp_real out[2]) {
    mp_real rest[2], lagged[2];
    if (!(since_s > R(0))) return;
    kept(since_s, lag_s, rest);
    rest[0] = R(1) - rest[0];
    rest[1] = -rest[1];
    multiplied(lag_s, rest, lagged);
    lagged[0] = from * rest[0] + slope * (since_s - lagged[0]);
    lagged[1] = from * rest[1] - slope * lagged[1];
    multiplied(weight, lagged, lagged);
    out[0] += lagged[0];
    out[1] += lagged[1];
}

/* What one of a sensor's lags has come to by a pulse of command j, at a time; added. */
static void by_pulse(const mp_commands *table, const mp_sensor *sensor, int i, int j, const mp_pulse *pulse, mp_real at, mp_real out[2]) {
    stretch part[3];
    int n, count = stretches(table, j, pulse, part);
    for (n = 0; n < count; n++) {
        mp_real slope = (part[n].to - part[n].from) / mp_max(part[n].end - part[n].begin, MP_TINY);
        let_through(at - sensor->latency_s - part[n].begin, part[n].from, slope, sensor->lag_s[i], sensor->weight[i], out);
        let_through(at - sensor->latency_s - part[n].end, -part[n].to, -slope, sensor->lag_s[i], sensor->weight[i], out);
    }
}

/* The lags of a sensor at a time, of each command that acts. */
static void lagged(const mp_preprocess *preprocess, int s, mp_real at, const acting *those, mp_lagged out[MP_COMMANDS]) {
    const mp_sensor *sensor = &preprocess->table.sensor[s];
    int i, k, n;
    for (n = 0; n < those->count; n++) out[those->which[n]] = (mp_lagged){R(0), R(0), R(0)};
    for (i = 0; i < sensor->lags; i++) {
        mp_real by[2];
        kept(at, sensor->lag_s[i], by);
        for (n = 0; n < those->count; n++) {
            int j = those->which[n];
            mp_real y[2];
            multiplied(preprocess->lagging[j][s][i], by, y);
            for (k = 0; k < preprocess->pulses[j]; k++) by_pulse(&preprocess->table, sensor, i, j, &preprocess->pulse[j][k], at, y);
            out[j].value += y[0];
            multiplied(sensor->lag_s[i], y, y);
            out[j].first += y[0];
            multiplied(sensor->lag_s[i], y, y);
            out[j].second += y[0];
        }
    }
}

/* By how much the lags of a sensor are late. */
static mp_real mean_lag(const mp_sensor *sensor) {
    mp_real found = R(0), each[2];
    int i;
    for (i = 0; i < sensor->lags; i++) {
        multiplied(sensor->weight[i], sensor->lag_s[i], each);
        found += each[0];
    }
    return found;
}

/* By how much the bins of a cycle are later than it: samples at records' ends stand for what was half a record before. */
static mp_real sampled_later(const mp_commands *table) {
    return table->sensor[MP_GYRO].instant ? table->period_s / R(table->records) / R(2) : R(0);
}

/* What each command does in each bin of a cycle, as late as the gyro shows it in the mean. */
static void in_bins(mp_preprocess *preprocess, const acting *those, mp_real duration) {
    const mp_sensor *sensor = &preprocess->table.sensor[MP_MOVES];
    mp_lagged was[MP_COMMANDS], is[MP_COMMANDS];
    mp_real late = sampled_later(&preprocess->table), mean = mean_lag(sensor);
    int count = preprocess->vehicle.bins, b, n;
    lagged(preprocess, MP_MOVES, late, those, was);
    for (b = 0; b < count; b++) {
        mp_real begin = late + duration * (R(b) / R(count)), end = late + duration * (R(b + 1) / R(count));
        lagged(preprocess, MP_MOVES, end, those, is);
        for (n = 0; n < those->count; n++) {
            int j = those->which[n];
            mp_real integral, moment;
            acted(preprocess, j, begin - sensor->latency_s, end - sensor->latency_s, &integral, &moment);
            preprocess->integral[b][j] = integral - (is[j].first - was[j].first);
            preprocess->moment[b][j] = moment - (end - begin) * is[j].first + mean * integral - (is[j].second - was[j].second);
            was[j] = is[j];
        }
    }
}

/* What the gyro's mean rate shows of it: from what had been done by the cycle's beginning, and from the mean to its end. */
static void by_gyro(mp_preprocess *preprocess, const acting *those, mp_real duration) {
    const mp_commands *table = &preprocess->table;
    const mp_sensor *sensor = &table->sensor[MP_GYRO];
    mp_lagged was[MP_COMMANDS], is[MP_COMMANDS];
    mp_real late = sampled_later(table), moved = late - table->sensor[MP_MOVES].latency_s, begin = late - sensor->latency_s;
    mp_real integral, moment, before, mean = mean_lag(sensor);
    int j, k, n;
    lagged(preprocess, MP_MOVES, late, those, is);
    for (n = 0; n < those->count; n++) preprocess->falling[those->which[n]] = is[those->which[n]].first;
    if (sensor->instant) {
        for (k = 1; k <= table->records; k++) {
            mp_real at = duration * (R(k) / R(table->records));
            lagged(preprocess, MP_GYRO, at, those, is);
            for (n = 0; n < those->count; n++) {
                j = those->which[n];
                acted(preprocess, j, moved, at - sensor->latency_s, &integral, &moment);
                preprocess->falling[j] += (integral - is[j].first) / R(table->records);
            }
        }
    } else {
        lagged(preprocess, MP_GYRO, late, those, was);
        lagged(preprocess, MP_GYRO, late + duration, those, is);
        for (n = 0; n < those->count; n++) {
            j = those->which[n];
            acted(preprocess, j, moved, begin, &before, &moment);
            acted(preprocess, j, begin, begin + duration, &integral, &moment);
            preprocess->falling[j] += before + integral - (moment + mean * integral - (is[j].second - was[j].second)) / duration;
        }
    }
    for (n = 0; n < those->count; n++) {
        j = those->which[n];
        preprocess->rising[j] = -preprocess->falling[j];
        for (k = 0; k < preprocess->vehicle.bins; k++) preprocess->rising[j] += preprocess->integral[k][j];
    }
}

/* What the accelerometer shows of it. */
static void by_accelerometer(mp_preprocess *preprocess, const acting *those, mp_real duration) {
    const mp_commands *table = &preprocess->table;
    const mp_sensor *sensor = &table->sensor[MP_ACCELEROMETER];
    mp_lagged was[MP_COMMANDS], is[MP_COMMANDS];
    mp_real moment, shown;
    int j, k, n;
    if (sensor->instant) {
        for (n = 0; n < those->count; n++) preprocess->whole[those->which[n]] = R(0);
        for (k = 1; k <= table->records; k++) {
            mp_real at = duration * (R(k) / R(table->records));
            lagged(preprocess, MP_ACCELEROMETER, at, those, is);
            for (n = 0; n < those->count; n++) {
                j = those->which[n];
                shown = sensor->lags ? is[j].value : level(preprocess, j, at - sensor->latency_s);
                preprocess->whole[j] += duration / R(table->records) * shown;
            }
        }
        return;
    }
    lagged(preprocess, MP_ACCELEROMETER, R(0), those, was);
    lagged(preprocess, MP_ACCELEROMETER, duration, those, is);
    for (n = 0; n < those->count; n++) {
        j = those->which[n];
        acted(preprocess, j, -sensor->latency_s, duration - sensor->latency_s, &preprocess->whole[j], &moment);
        preprocess->whole[j] -= is[j].first - was[j].first;
    }
}

/* The next cycle is the present one: what is over goes, and its lags go on without it. */
static void passed(mp_preprocess *preprocess, mp_real duration) {
    const mp_commands *table = &preprocess->table;
    mp_real latest = R(0), by[MP_SENSORS][MP_LAGS][2];
    int i, j, k, s, left;
    for (s = 0; s < MP_SENSORS; s++) {
        latest = mp_max(latest, table->sensor[s].latency_s);
        for (i = 0; i < table->sensor[s].lags; i++) kept(duration, table->sensor[s].lag_s[i], by[s][i]);
    }
    for (j = 0; j < table->commands; j++) {
        for (s = 0; s < MP_SENSORS; s++)
            for (i = 0; i < table->sensor[s].lags; i++) multiplied(preprocess->lagging[j][s][i], by[s][i], preprocess->lagging[j][s][i]);
        for (k = 0, left = 0; k < preprocess->pulses[j]; k++) {
            mp_pulse pulse = preprocess->pulse[j][k];
            pulse.begin -= duration;
            if (pulse.end < OPEN) pulse.end -= duration;
            /* the last is kept a while, since the next command may go on with it */
            if (!(pulse.end + table->fall_s[j] + latest + (k == preprocess->pulses[j] - 1 ? table->period_s : R(0)) < R(0))) {
                preprocess->pulse[j][left++] = pulse;
                continue;
            }
            for (s = 0; s < MP_SENSORS; s++)
                for (i = 0; i < table->sensor[s].lags; i++)
                    by_pulse(table, &table->sensor[s], i, j, &pulse, R(0), preprocess->lagging[j][s][i]);
        }
        preprocess->pulses[j] = left;
    }
}

/* What channels make together; nothing where they cancel but for rounding. */
static void net(const mp_commands *table, const acting *those, const mp_real *part, mp_real out[6]) {
    mp_real size[6];
    int i, n;
    for (i = 0; i < 6; i++) out[i] = size[i] = R(0);
    for (n = 0; n < those->count; n++) {
        int j = those->which[n];
        mp_real own = part[j];
        if (!table->jets) {
            out[j] = own;
            continue;
        }
        for (i = 0; i < 6; i++) {
            mp_real made = own * table->wrench[j][i];
            out[i] += made;
            size[i] += mp_abs(made);
        }
    }
    for (i = 0; i < 6; i++)
        if (mp_abs(out[i]) < CANCELLED * size[i]) out[i] = R(0);
}

static void impulses(mp_preprocess *preprocess, const acting *those, mp_cycle *cycle) {
    const mp_commands *table = &preprocess->table;
    mp_real bin_s = cycle->duration_s / R(preprocess->vehicle.bins), skew[MP_COMMANDS];
    int b, j, n, i, k;
    for (b = 0; b < preprocess->vehicle.bins; b++) {
        for (n = 0; n < those->count; n++) {
            j = those->which[n];
            skew[j] = preprocess->moment[b][j] / bin_s - preprocess->integral[b][j] / R(2);
        }
        net(table, those, preprocess->integral[b], cycle->impulse[b]);
        net(table, those, skew, cycle->skew[b]);
    }
    net(table, those, preprocess->rising, cycle->rising);
    net(table, those, preprocess->falling, cycle->falling);
    net(table, those, preprocess->whole, cycle->whole);
    if (!preprocess->vehicle.pulses) return;
    memset(cycle->pulse_covariance, 0, sizeof cycle->pulse_covariance);
    for (n = 0; n < those->count; n++) {
        mp_real sigma;
        j = those->which[n];
        sigma = table->pulse_sigma * preprocess->whole[j];
        for (i = 0; i < 6; i++)
            for (k = 0; k < 6; k++) {
                mp_real a = table->jets ? table->wrench[j][i] : i == j ? R(1) : R(0);
                mp_real c = table->jets ? table->wrench[j][k] : k == j ? R(1) : R(0);
                cycle->pulse_covariance[i][k] += sigma * sigma * a * c;
            }
    }
}

/* Wheels, whose speeds change evenly from one cycle's end to the next: what they store, and what the vehicle feels of it. */
static void wheels(mp_preprocess *preprocess, const mp_flown *flown, mp_cycle *cycle) {
    const mp_vehicle *vehicle = &preprocess->vehicle;
    mp_real parts = R(vehicle->bins), bin_s = cycle->duration_s / parts;
    int b, w, i;
    for (w = 0; w < vehicle->wheels; w++) {
        mp_real begun = vehicle->spin_inertia[w] * (preprocess->spun ? preprocess->speed[w] : flown->speed[w]);
        mp_real growth = vehicle->spin_inertia[w] * flown->speed[w] - begun;
        for (b = 0; b < vehicle->bins; b++) {
            cycle->momentum[b][w] = begun + growth * ((R(b) + R(0.5)) / parts);
            cycle->growing[b][w] = growth / parts * bin_s / R(12);
            for (i = 0; i < 3; i++) cycle->impulse[b][i] -= vehicle->axis[w][i] * (growth / parts);
        }
        cycle->grown[0][w] = cycle->grown[1][w] = growth / R(2);
        cycle->grown[2][w] = growth;
        for (i = 0; i < 3; i++) {
            cycle->rising[i] -= vehicle->axis[w][i] * cycle->grown[0][w];
            cycle->falling[i] -= vehicle->axis[w][i] * cycle->grown[1][w];
            cycle->whole[i] -= vehicle->axis[w][i] * cycle->grown[2][w];
        }
        preprocess->speed[w] = flown->speed[w];
    }
    preprocess->spun = 1;
}

/* World from body. */
static void matrix(const mp_real q[4], mp_real out[3][3]) {
    mp_real w = q[0], x = q[1], y = q[2], z = q[3];
    out[0][0] = R(1) - R(2) * (y * y + z * z);
    out[0][1] = R(2) * (x * y - w * z);
    out[0][2] = R(2) * (x * z + w * y);
    out[1][0] = R(2) * (x * y + w * z);
    out[1][1] = R(1) - R(2) * (x * x + z * z);
    out[1][2] = R(2) * (y * z - w * x);
    out[2][0] = R(2) * (x * z - w * y);
    out[2][1] = R(2) * (y * z + w * x);
    out[2][2] = R(1) - R(2) * (x * x + y * y);
}

static void product(const mp_real a[4], const mp_real b[4], mp_real out[4]) {
    mp_real cross[3];
    int i;
    mp_cross(a + 1, b + 1, cross);
    out[0] = a[0] * b[0] - mp_dot(a + 1, b + 1);
    for (i = 0; i < 3; i++) out[1 + i] = a[0] * b[1 + i] + b[0] * a[1 + i] + cross[i];
}

/* The rotation by a vector. */
static void quaternion(const mp_real vector[3], mp_real out[4]) {
    mp_real half = mp_dot(vector, vector) / R(4), cosine = R(1), sine = R(1), term = R(1);
    int i, k;
    for (k = 1; k <= TERMS; k++) {
        term *= -half / R((2 * k - 1) * (2 * k));
        cosine += term;
        sine += term / R(2 * k + 1);
    }
    out[0] = cosine;
    for (i = 0; i < 3; i++) out[1 + i] = vector[i] * (sine / R(2));
}

/* q <- q times the rotation by a vector, of length one. */
static void rotated(mp_real q[4], const mp_real vector[3]) {
    mp_real by[4], out[4], size;
    int i;
    quaternion(vector, by);
    product(q, by, out);
    size = MP_SQRT(out[0] * out[0] + out[1] * out[1] + out[2] * out[2] + out[3] * out[3]);
    for (i = 0; i < 4; i++) q[i] = out[i] / size;
}

/* World's vertical in body axes, less what the attitude is off by. */
static void vertical(const mp_real q[4], const mp_real back[4], mp_real out[3]) {
    mp_real freed[4], rotation[3][3];
    int i;
    product(back, q, freed);
    matrix(freed, rotation);
    for (i = 0; i < 3; i++) out[i] = rotation[2][i];
}

/* By how much the attitude is off at a cycle's end, by the gyro's bias as the estimate has it. */
static void carried_off(mp_preprocess *preprocess, const mp_cycle *cycle, const mp_real mean[3][3]) {
    mp_real bias[3], size = MP_SQRT(mp_dot(preprocess->bias, preprocess->bias)), sigma = preprocess->vehicle.gyro_bias_sigma;
    int i, j;
    for (i = 0; i < 3; i++) bias[i] = preprocess->bias[i] * mp_min(R(1), FARTHEST * sigma / mp_max(size, sigma));
    for (i = 0; i < 3; i++) {
        for (j = 0; j < 3; j++) preprocess->window[i][j] += mean[i][j] * cycle->duration_s;
        preprocess->off[i] = mp_dot(preprocess->window[i], bias);
    }
}

/* Where the attitude may be at the start of a cycle. */
static void attitude_error(mp_preprocess *preprocess, const mp_real from_body[3][3], int biased) {
    int i, j, k;
    for (i = 0; i < 3; i++) {
        preprocess->attitude_error[i][0] = R(0);
        preprocess->attitude_error[i][4] = MP_SQRT(preprocess->squares_s2);
        for (j = 0; j < 3; j++) preprocess->attitude_error[i][1 + j] = R(0);
        if (!biased) continue;
        for (k = 0; k < 3; k++) preprocess->attitude_error[i][0] += from_body[k][i] * preprocess->off[k];
        for (j = 0; j < 3; j++) {
            for (k = 0; k < 3; k++) preprocess->attitude_error[i][1 + j] -= from_body[k][i] * preprocess->window[k][j];
        }
    }
}

/* q of the rotation back by what the attitude is off. */
static void backed(const mp_preprocess *preprocess, mp_real out[4]) {
    mp_real back[3];
    int i;
    for (i = 0; i < 3; i++) back[i] = -preprocess->off[i];
    quaternion(back, out);
}

/* The vertical at both ends of a cycle, and how the attitude is carried from one to the other. */
static void attitudes(mp_preprocess *preprocess, mp_cycle *cycle) {
    mp_real turn[3], coning[3], first[3][3], mean[3][3], back[4], then[4], step[4], mean_up[3], swung[3];
    int biased = MP_ON_BEARING(&preprocess->vehicle) && preprocess->vehicle.gyro_bias, i, j;
    for (i = 0; i < 3; i++) cycle->carried[i] = cycle->rate[i];
    if (!MP_ON_BEARING(&preprocess->vehicle)) {
        memset(cycle->up, 0, sizeof cycle->up);
        return;
    }
    for (i = 0; i < 3; i++) turn[i] = cycle->rate[i] * cycle->duration_s;
    if (preprocess->cycles == 0) { /* where the motion begins that the gyro shows later than it is labelled */
        mp_real before[3], late = sampled_later(&preprocess->table) - preprocess->table.sensor[MP_MOVES].latency_s;
        for (i = 0; i < 3; i++) before[i] = cycle->rate[i] * late;
        rotated(preprocess->attitude, before);
    }
    backed(preprocess, back);
    vertical(preprocess->attitude, back, cycle->up[0]);
    matrix(preprocess->attitude, first);
    attitude_error(preprocess, (const mp_real(*)[3])first, biased);
    mp_cross(preprocess->turn, turn, coning);
    for (i = 0; i < 3; i++) coning[i] = turn[i] + coning[i] / R(12);
    rotated(preprocess->attitude, coning);
    if (biased) {
        matrix(preprocess->attitude, mean);
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) mean[i][j] = (mean[i][j] + first[i][j]) / R(2);
        carried_off(preprocess, cycle, (const mp_real(*)[3])mean);
        for (i = 0; i < 3; i++) back[1 + i] = -back[1 + i];
        backed(preprocess, then);
        product(back, then, step);
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) cycle->carried[i] += mean[j][i] * (R(2) * step[1 + j]) / cycle->duration_s;
    }
    backed(preprocess, then);
    vertical(preprocess->attitude, then, cycle->up[1]);
    for (i = 0; i < 3; i++) {
        preprocess->turn[i] = turn[i];
        mean_up[i] = (cycle->up[0][i] + cycle->up[1][i]) / R(2);
    }
    mp_cross(mean_up, cycle->rate, swung); /* the weight as it was when the gyro's motion was */
    for (i = 0; i < 3; i++) cycle->force[i] -= preprocess->vehicle.later * preprocess->vehicle.gravity * swung[i];
    preprocess->squares_s2 += cycle->duration_s * cycle->duration_s;
}

/* A cycle whose executed commands are known. */
static void completed(mp_preprocess *preprocess, const mp_flown *flown, mp_cycle *cycle, int *usable) {
    const mp_vehicle *vehicle = &preprocess->vehicle;
    mp_real theta[3], v[3], rounding;
    acting those;
    int i;
    cycle->end_s = flown->end_s;
    cycle->duration_s = flown->duration_s;
    for (i = 0; i < 3; i++) {
        theta[i] = flown->delta_theta[i] / flown->duration_s;
        v[i] = flown->delta_v[i] / flown->duration_s;
    }
    mp_times((const mp_real(*)[3])preprocess->table.body_from_imu, theta, cycle->rate);
    mp_times((const mp_real(*)[3])preprocess->table.body_from_imu, v, cycle->force);
    for (i = 0; i < 3; i++) {
        cycle->rate_step[i] = preprocess->cycles > 0 ? cycle->rate[i] - preprocess->rate[i] : R(0);
        preprocess->rate[i] = cycle->rate[i];
    }
    for (i = 0; i < 2; i++) cycle->deaf[i] = flown->deaf[i];
    attitudes(preprocess, cycle);
    acting_of(preprocess, &those);
    in_bins(preprocess, &those, flown->duration_s);
    by_gyro(preprocess, &those, flown->duration_s);
    by_accelerometer(preprocess, &those, flown->duration_s);
    impulses(preprocess, &those, cycle);
    passed(preprocess, flown->duration_s);
    *usable = !flown->unused && (preprocess->spun || vehicle->wheels == 0);
    wheels(preprocess, flown, cycle);
    /* on the ground `unused` says so too, more strictly (massprop_cli/prepare/align.py): rounding must not make two answers of it */
    rounding = R(2e-6) * preprocess->table.period_s + R(2e-15) * mp_abs(flown->end_s);
    *usable = *usable && preprocess->since_s >= preprocess->table.memory_s - rounding;
    preprocess->since_s += flown->duration_s;
    preprocess->cycles += 1;
}

static int is_finite(const mp_preprocess *preprocess, const mp_flown *flown) {
    int fine = mp_finite(&flown->end_s, 1) && mp_finite(&flown->duration_s, 1);
    fine = fine && mp_finite(flown->delta_theta, 3) && mp_finite(flown->delta_v, 3);
    return fine && mp_finite(flown->command, preprocess->table.commands) && mp_finite(flown->speed, preprocess->vehicle.wheels);
}

int mp_preprocess_step(mp_preprocess *preprocess, const mp_flown *flown, mp_cycle *cycle, int *made, int *usable) {
    int status;
    *made = 0;
    if (!preprocess->ready) return MP_ORDER;
    if (!is_finite(preprocess, flown)) return MP_NOT_FINITE;
    if (!(flown->duration_s > R(0)) || (preprocess->told && !(flown->end_s > preprocess->end_s))) return MP_TIME;
    status = issued(preprocess, flown, preprocess->holding ? preprocess->waiting.duration_s : R(0));
    if (status != MP_OK) return status;
    preprocess->end_s = flown->end_s;
    preprocess->told = 1;
    if (!preprocess->table.waits) {
        completed(preprocess, flown, cycle, usable);
        *made = 1;
        return MP_OK;
    }
    if (preprocess->holding) {
        completed(preprocess, &preprocess->waiting, cycle, usable);
        *made = 1;
    }
    preprocess->waiting = *flown;
    preprocess->holding = 1;
    return MP_OK;
}

int mp_preprocess_last(mp_preprocess *preprocess, mp_cycle *cycle, int *made, int *usable) {
    *made = preprocess->holding;
    if (!preprocess->ready) return MP_ORDER;
    if (preprocess->holding) completed(preprocess, &preprocess->waiting, cycle, usable);
    preprocess->holding = 0;
    return MP_OK;
}
