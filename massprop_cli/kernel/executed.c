#include "executed.h"

#include <math.h>
#include <string.h>

#include "linalg.h"

#define TOUCHING R(1e-3)   /* pulses that end and begin within this part of a cycle are one; others overlap, and give all they have */
#define CANCELLED R(1e-12) /* part of what each channel makes alone below which their sum is rounding */
#define OPEN R(1e30)       /* s; the end of what is held until the next command */
#define ROUNDED R(1e-9)    /* s by which a sample is before what begins at its time */
#define FORGOTTEN R(-45)   /* logarithm of what a lag keeps that is below the last digit of anything */

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

/* When it has fallen, at the latest. */
static mp_real over(const mp_commands *table, int j, const mp_pulse *pulse) {
    return pulse->end + mp_max(R(1), pulse->level) * table->fall_s[j];
}

/* Its impulse, over the force at full thrust, and the first moment of that. */
static void moments(const mp_commands *table, int j, const mp_pulse *pulse, mp_real *impulse, mp_real *moment) {
    stretch part[3];
    int n, count = stretches(table, j, pulse, part);
    *impulse = *moment = R(0);
    for (n = 0; n < count; n++) {
        mp_real length = part[n].end - part[n].begin, sum = length * (part[n].from + part[n].to) / R(2);
        *impulse += sum;
        *moment += part[n].begin * sum + length * length * (part[n].from + R(2) * part[n].to) / R(6);
    }
}

/* Two pulses as one from the beginning of the first to the end of the last, with the impulse of both. That is level * held + level^2 *
 * falling: what falls takes longer from a higher level. By how much the first moment of the impulse changes. */
static mp_real combined(const mp_commands *table, int j, const mp_pulse *first, const mp_pulse *last, mp_pulse *out) {
    mp_real impulse[2], moment[2], held, falling, found;
    moments(table, j, first, &impulse[0], &moment[0]);
    moments(table, j, last, &impulse[1], &moment[1]);
    *out = (mp_pulse){mp_min(first->begin, last->begin), mp_max(first->end, last->end), R(2), 1};
    moments(table, j, out, &falling, &found);
    out->level = R(1);
    moments(table, j, out, &held, &found);
    falling = falling / R(2) - held;
    held -= falling;
    impulse[0] += impulse[1];
    out->level = R(2) * impulse[0] / mp_max(held + MP_SQRT(held * held + R(4) * falling * impulse[0]), MP_TINY);
    moments(table, j, out, &impulse[0], &found);
    return mp_abs(found - moment[0] - moment[1]);
}

/* Room for one more: two neighbours become one. Both are still to come, or both are over: a part of an impulse that has been executed must
 * not come again. Of those the two of which that changes least: a rate is what it was, but later or sooner. */
static void make_room(mp_preprocess *preprocess, int j) {
    const mp_commands *table = &preprocess->table;
    mp_pulse *pulses = preprocess->pulse[j], both;
    mp_real now = mp_sampled_later(table) - table->sensor[MP_MOVES].latency_s, least = OPEN, change;
    int k, chosen = 0;
    for (k = 0; k < MP_PENDING - 1; k++) {
        change = combined(table, j, pulses + k, pulses + k + 1, &both);
        if (pulses[k].begin < now && over(table, j, pulses + k + 1) > now) change = OPEN / R(2);
        if (!(change < least)) continue;
        least = change;
        chosen = k;
    }
    (void)combined(table, j, pulses + chosen, pulses + chosen + 1, &both);
    pulses[chosen] = both;
    preprocess->pulses[j] = MP_PENDING - 1;
    memmove(pulses + chosen + 1, pulses + chosen + 2, (size_t)(MP_PENDING - 2 - chosen) * sizeof pulses[0]);
}

/* The commands of a cycle that starts `after` the present one, to be executed after the delay. */
void mp_issued(mp_preprocess *preprocess, const mp_flown *flown, mp_real after) {
    const mp_commands *table = &preprocess->table;
    int j;
    for (j = 0; j < table->commands; j++) {
        mp_pulse *pulses = preprocess->pulse[j], *last;
        mp_real begin = after + table->delay_s + table->own_delay_s[j];
        int count = preprocess->pulses[j];
        if (table->jets && !(flown->command[j] > R(0))) continue;
        if (table->jets) begin += table->late * mp_max(table->period_s - flown->command[j], R(0));
        last = count > 0 ? pulses + count - 1 : NULL;
        if (table->jets && last != NULL && !last->combined && !(mp_abs(begin - last->end) > TOUCHING * table->period_s)) {
            last->end = begin + flown->command[j];
            continue;
        }
        if (!table->jets && last != NULL) last->end = begin;
        if (count == MP_PENDING) {
            make_room(preprocess, j);
            count = preprocess->pulses[j];
        }
        pulses[count].begin = begin;
        pulses[count].end = table->jets ? begin + flown->command[j] : OPEN;
        pulses[count].level = table->jets ? R(1) : flown->command[j];
        pulses[count].combined = 0;
        preprocess->pulses[j] = count + 1;
    }
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
mp_real mp_sampled_later(const mp_commands *table) {
    return table->sensor[MP_GYRO].instant ? table->period_s / R(table->records) / R(2) : R(0);
}

/* What each command does in each bin of a cycle, as late as the gyro shows it in the mean. */
static void in_bins(mp_preprocess *preprocess, const acting *those, mp_real duration) {
    const mp_sensor *sensor = &preprocess->table.sensor[MP_MOVES];
    mp_lagged was[MP_COMMANDS], is[MP_COMMANDS];
    mp_real late = mp_sampled_later(&preprocess->table), mean = mean_lag(sensor);
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
    mp_real late = mp_sampled_later(table), moved = late - table->sensor[MP_MOVES].latency_s, begin = late - sensor->latency_s;
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
            if (!(over(table, j, &pulse) + latest + (k == preprocess->pulses[j] - 1 ? table->period_s : R(0)) < R(0))) {
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

/* Neither sensor is used while a combined pulse acts, and as long as any shows it: its impulse is known, its course is not. */
static void unread(mp_preprocess *preprocess, mp_cycle *cycle) {
    const mp_commands *table = &preprocess->table;
    mp_real until = preprocess->unread_s, soonest = cycle->duration_s + mp_sampled_later(table), shown_s = table->memory_s - table->delay_s;
    int j, k;
    for (j = 0; j < table->commands; j++)
        for (k = 0; k < preprocess->pulses[j]; k++) {
            const mp_pulse *pulse = &preprocess->pulse[j][k];
            if (pulse->combined && pulse->begin < soonest) until = mp_max(until, over(table, j, pulse) + shown_s);
        }
    if (until > R(0)) cycle->deaf[0] = cycle->deaf[1] = 1;
    preprocess->unread_s = until - cycle->duration_s;
}

void mp_executed(mp_preprocess *preprocess, mp_cycle *cycle) {
    acting those;
    unread(preprocess, cycle);
    acting_of(preprocess, &those);
    in_bins(preprocess, &those, cycle->duration_s);
    by_gyro(preprocess, &those, cycle->duration_s);
    by_accelerometer(preprocess, &those, cycle->duration_s);
    impulses(preprocess, &those, cycle);
    passed(preprocess, cycle->duration_s);
}
