/* The response of many cycles at once, for fits on the ground (massprop_cli/model/regressors.py): the same equations, cycle by cycle. */
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "host.h"
#include "preprocess.h"
#include "motion.h"
#include "linalg.h"

#define SAME 1e-14 /* s by which the rounding of times makes two intervals differ */

/* What is made of a stretch of cycles: n states, c combinations of coefficients. */
typedef struct {
    double *transition;  /* (K - 1, n, n) */
    double *observation; /* (K, 6, n) */
    double *to_rate;     /* (K - 1, 3, 3) */
    double *steps;       /* (K - 1, 3) */
    double *drive;       /* (K - 1, n, 1 + c) */
    double *measured;    /* (K, 6, 1 + c) */
} regressors;

SHARED int mp_host_regressors(const double *table, const double *reference, long count, long stride, const double *rows, const double *onto,
                          int combined, const regressors *out);

SHARED int mp_host_beyond(const double *table, const double *reference, const double *phi, long count, long stride, const double *rows,
                          const double *rate, double *next, double *seen);

SHARED int mp_host_bins(long events, const double *time, const double *step, const double *slope, long bins, const double *edges,
                        const double *lag, double *integral, double *moment);

SHARED int mp_host_pulses(long jets, long count, const double *part, const double *begin, const double *on, const double *ramps,
                          const double *touching, long bins, const double *edges, const double *lag, double *room, double *integral,
                          double *moment);

SHARED int mp_host_shown(long events, const double *event, long count, const double *at, long lags, const double *lag,
                         const double *rounded, double *out);

SHARED int mp_host_white(long filters, long count, long columns, long states, const double *step, const double *added,
                         const double *scattered, const unsigned char *used, const double *driven, const double *measured, double *now,
                         double *rows, double *spread);

SHARED int mp_host_integrals(const double *table, const double *reference, long count, long stride, const double *rows, double *step,
                             double *mean, double *known);


static void reference_of(const double *from, const mp_layout *layout, mp_reference *out) {
    int i;
    memset(out, 0, sizeof *out);
    from = mp_copied(out->theta, from, 10);
    from = mp_copied(out->inertia[0], from, 9);
    from = mp_copied(out->cg, from, 3);
    from = mp_copied(&out->mu, from, 1);
    from = mp_copied(out->bias, from, 3);
    from = mp_copied(out->acceleration, from, 3);
    for (i = 0; i < 3; i++) from = mp_copied(out->phi[i], from, layout->channels);
    (void)mp_copied(out->scale, from, 1 + MP_WHEELS);
}

int mp_about_of(const double *table, const double *reference, mp_vehicle *vehicle, mp_layout *layout, mp_reference *about) {
    int status;
    *vehicle = mp_vehicle_of(table);
    status = mp_laid_out(vehicle, layout);
    if (status == MP_OK) reference_of(reference, layout, about);
    return status;
}

/* (3, combined) what phi makes of channels, in combinations (3 x channels + 4, combined) of its coefficients; NULL: each by itself. */
static void combine(const mp_real *channels, int count, const double *onto, int combined, double *made) {
    int a, c, m;
    if (onto != NULL && combined == 1) { /* what a whole reference does, of which there are many */
        for (a = 0; a < 3; a++) {
            made[a] = 0.0;
            for (c = 0; c < count; c++) made[a] += (double)channels[c] * onto[a * count + c];
        }
        return;
    }
    memset(made, 0, (size_t)(3 * combined) * sizeof made[0]);
    for (a = 0; a < 3; a++)
        for (c = 0; c < count; c++) {
            if (onto == NULL) {
                made[a * combined + a * count + c] = (double)channels[c];
                continue;
            }
            for (m = 0; m < combined; m++) made[a * combined + m] += (double)channels[c] * onto[(a * count + c) * combined + m];
        }
}

static void step_written(const mp_layout *layout, const mp_reference *about, const mp_motion *from, const mp_motion *into,
                         const mp_time_update *update, const double *onto, int combined, long k, const regressors *out) {
    int n = layout->states, wide = 1 + combined, i, j, a, m;
    mp_real inverse[3][3], moment[3], scaled[1 + MP_WHEELS][3];
    double made[3 * (3 * MP_CHANNELS + 4)], *drive = out->drive + k * n * wide;
    for (i = 0; i < n; i++) {
        for (j = 0; j < n; j++) out->transition[(k * n + i) * n + j] = (double)update->transition[i][j];
        memset(drive + i * wide, 0, (size_t)wide * sizeof drive[0]);
        drive[i * wide] = (double)update->drive[i];
    }
    combine(update->step, layout->channels, onto, combined, made);
    mp_tensor(about->theta, inverse);
    for (j = 0; j < layout->scales; j++) {
        for (i = 0; i < 3; i++) moment[i] = from->scaled[j][0][i] + into->scaled[j][1][i];
        mp_times((const mp_real(*)[3])inverse, moment, scaled[j]);
    }
    for (i = 0; i < 3; i++) {
        mp_real growth = from->known[0][i] + into->known[1][i];
        for (j = 0; j < 3; j++) out->to_rate[(k * 3 + i) * 3 + j] = (double)update->to_rate[i][j];
        for (j = 0; j < layout->channels; j++) growth += about->phi[i][j] * update->step[j];
        for (j = 0; j < layout->scales; j++) growth += scaled[j][i] * about->scale[j];
        out->steps[k * 3 + i] = (double)growth;
        for (a = 0; a < 3; a++)
            for (m = 0; m < combined; m++) drive[i * wide + 1 + m] += (double)update->solve[i][a] * made[a * combined + m];
    }
}

static void cycle_written(const mp_layout *layout, const mp_motion *here, const double *onto, int combined, long k, const regressors *out) {
    int n = layout->states, wide = 1 + combined, last = 3 * layout->channels, i, j, a, m;
    double made[3 * (3 * MP_CHANNELS + 4)], *measured = out->measured + k * 6 * wide, *observation = out->observation + k * 6 * n;
    memset(measured, 0, (size_t)(6 * wide) * sizeof measured[0]);
    memset(observation, 0, (size_t)(6 * n) * sizeof observation[0]);
    combine(here->mean, layout->channels, onto, combined, made);
    for (i = 0; i < 3; i++) {
        double *felt = measured + (3 + i) * wide;
        measured[i * wide] = (double)here->raw_rate[i];
        felt[0] = (double)here->measured[i];
        for (a = 0; a < 3; a++)
            for (m = 0; m < combined; m++) felt[1 + m] -= (double)here->euler[i][a] * made[a * combined + m];
        for (j = 0; j < 4; j++) {
            if (onto == NULL) felt[1 + last + j] -= (double)here->own[i][j];
            else
                for (m = 0; m < combined; m++) felt[1 + m] -= (double)here->own[i][j] * onto[(last + j) * combined + m];
        }
        observation[i * n + i] = 1.0;
        if (layout->at_bias >= 0) observation[i * n + layout->at_bias + i] = 1.0;
        if (layout->at_accel >= 0) observation[(3 + i) * n + layout->at_accel + i] = 1.0;
        for (j = 0; j < 3; j++) {
            observation[(3 + i) * n + j] = (double)here->by_rate[i][j];
            if (layout->at_torque >= 0) observation[(3 + i) * n + layout->at_torque + j] = (double)here->euler[i][j];
            if (layout->at_tilt >= 0) observation[(3 + i) * n + layout->at_tilt + j] = (double)here->by_tilt[i][j];
        }
        for (j = 0; j < layout->scales; j++) observation[(3 + i) * n + layout->at_scale + j] = (double)here->felt[j][i];
    }
}

/* Of `count` cycles by rows, as mp_host_run has them; `onto` NULL: a column for each coefficient. */
int mp_host_regressors(const double *table, const double *reference, long count, long stride, const double *rows, const double *onto,
                   int combined, const regressors *out) {
    mp_vehicle vehicle;
    mp_layout layout;
    mp_reference about;
    mp_motion motion[2];
    mp_time_update update;
    mp_cycle cycle;
    long k;
    int status = mp_about_of(table, reference, &vehicle, &layout, &about);
    if (status != MP_OK) return status;
    for (k = 0; k < count; k++) {
        mp_cycle_of(&vehicle, rows + k * stride, &cycle);
        mp_motion_of(&vehicle, &layout, &cycle, &about, &motion[k % 2]);
        if (k > 0) {
            const mp_motion *from = &motion[(k + 1) % 2], *into = &motion[k % 2];
            mp_time_update_of(&vehicle, &layout, from, into, &about, &update);
            step_written(&layout, &about, from, into, &update, onto, combined, k - 1, out);
        }
        cycle_written(&layout, &motion[k % 2], onto, combined, k, out);
    }
    return MP_OK;
}

/* Of coefficients phi and rates (K, 3), all other states zero: (K - 1, n) the state one step on, and (K, 6) what is measured beyond what
 * the rates give. */
int mp_host_beyond(const double *table, const double *reference, const double *phi, long count, long stride, const double *rows,
                   const double *rate, double *next, double *seen) {
    mp_vehicle vehicle;
    mp_layout layout;
    mp_reference about;
    mp_motion motion[2];
    mp_time_update update;
    mp_cycle cycle;
    double made[3];
    const double *last;
    long k;
    int i, j, status = mp_about_of(table, reference, &vehicle, &layout, &about);
    if (status != MP_OK) return status;
    last = phi + 3 * layout.channels;
    for (k = 0; k < count; k++) {
        const mp_motion *here = &motion[k % 2];
        const double *now = rate + 3 * k, *before = now - 3;
        double *turning = seen + 6 * k, *pushing = turning + 3;
        mp_cycle_of(&vehicle, rows + k * stride, &cycle);
        mp_motion_of(&vehicle, &layout, &cycle, &about, &motion[k % 2]);
        combine(here->mean, layout.channels, phi, 1, made);
        for (i = 0; i < 3; i++) {
            turning[i] = (double)here->raw_rate[i] - now[i];
            pushing[i] = (double)here->measured[i];
            for (j = 0; j < 3; j++) pushing[i] -= (double)here->euler[i][j] * made[j] + (double)here->by_rate[i][j] * now[j];
            for (j = 0; j < 4; j++) pushing[i] -= (double)here->own[i][j] * last[j];
        }
        if (k == 0) continue;
        mp_time_update_of(&vehicle, &layout, &motion[(k + 1) % 2], here, &about, &update);
        combine(update.step, layout.channels, phi, 1, made);
        for (i = 0; i < layout.states; i++) {
            next[i] = (double)update.drive[i];
            for (j = 0; j < 3; j++) next[i] += (double)update.transition[i][j] * before[j] + (i < 3 ? (double)update.solve[i][j] * made[j] : 0.0);
        }
        next += layout.states;
    }
    return MP_OK;
}

/* What phi multiplies, about a reference: (K - 1, C) under the triangular window, (K, C) mean over each cycle; (K - 1, 3) known growth of
 * the rate. */
int mp_host_integrals(const double *table, const double *reference, long count, long stride, const double *rows, double *step,
                      double *mean, double *known) {
    mp_vehicle vehicle;
    mp_layout layout;
    mp_reference about;
    mp_motion motion[2];
    mp_cycle cycle;
    long k;
    int i, status = mp_about_of(table, reference, &vehicle, &layout, &about);
    if (status != MP_OK) return status;
    for (k = 0; k < count; k++) {
        const mp_motion *from = &motion[(k + 1) % 2], *into = &motion[k % 2];
        mp_cycle_of(&vehicle, rows + k * stride, &cycle);
        mp_motion_of(&vehicle, &layout, &cycle, &about, &motion[k % 2]);
        for (i = 0; i < layout.channels; i++) {
            mean[k * layout.channels + i] = (double)into->mean[i];
            if (k > 0) step[(k - 1) * layout.channels + i] = (double)(from->rising[i] + into->falling[i]);
        }
        for (i = 0; k > 0 && i < 3; i++) known[(k - 1) * 3 + i] = (double)(from->known[0][i] + into->known[1][i]);
    }
    return MP_OK;
}

/* What a first-order lag has come to after a `length` of what began at `value` and rose. */
static double lagged(double y, double value, double rise, double length, double lag) {
    double rest;
    if (!(lag > 0.0) || (y == 0.0 && value == 0.0 && rise == 0.0)) return y;
    rest = -expm1(-length / lag);
    return y * (1.0 - rest) + value * rest + rise * (length - lag * rest);
}

/* Integral and first moment over each bin of what goes on linearly but for events in the order of time, zero before the first, or of what
 * a lag makes of it (massprop_cli/prepare/signal.py). */
int mp_host_bins(long events, const double *time, const double *step, const double *slope, long bins, const double *edges,
                 const double *lag, double *integral, double *moment) {
    double value = 0, rise = 0, now = events > 0 ? time[0] : edges[0], y = 0;
    long b, next = 0;
    while (next < events && time[next] < edges[0]) {
        y = lagged(y, value, rise, time[next] - now, *lag);
        value += rise * (time[next] - now) + step[next];
        rise += slope[next];
        now = time[next++];
    }
    if (now < edges[0]) {
        y = lagged(y, value, rise, edges[0] - now, *lag);
        value += rise * (edges[0] - now);
    }
    now = edges[0];
    for (b = 0; b < bins; b++) {
        double begun = y, whole = edges[b + 1] - edges[b];
        integral[b] = moment[b] = 0;
        for (;;) {
            int inside = next < events && time[next] < edges[b + 1];
            double until = inside ? time[next] : edges[b + 1], length = until - now, mean = value + rise * length / 2;
            integral[b] += length * mean;
            moment[b] += length * ((now - edges[b]) * mean + length * (value / 2 + rise * length / 3));
            y = lagged(y, value, rise, length, *lag);
            value += rise * length;
            now = until;
            if (!inside) break;
            value += step[next];
            rise += slope[next++];
        }
        integral[b] -= *lag * (y - begun);
        moment[b] -= *lag * (whole * y - integral[b]);
    }
    return MP_OK;
}

/* A lag in parallel with others: where it is, and what it keeps over a time, which is the same again and again. */
typedef struct {
    double weight[2], lag[2], y[2], kept[2], over;
} lag_state;

static void times(const double a[2], const double b[2], double out[2]) {
    double real = a[0] * b[0] - a[1] * b[1];
    out[1] = a[0] * b[1] + a[1] * b[0];
    out[0] = real;
}

/* It goes on under what begins at a level and rises. */
static void goes_on(lag_state *own, double length, double value, double rise) {
    double rest[2], slow[2], size = own->lag[0] * own->lag[0] + own->lag[1] * own->lag[1];
    if (!(fabs(length - own->over) < SAME)) {
        double decay = exp(-length * own->lag[0] / size), angle = length * own->lag[1] / size;
        own->kept[0] = decay * cos(angle);
        own->kept[1] = decay * sin(angle);
        own->over = length;
    }
    rest[0] = 1.0 - own->kept[0];
    rest[1] = -own->kept[1];
    times(own->lag, rest, slow);
    times(own->y, own->kept, own->y);
    own->y[0] += value * rest[0] + rise * (length - slow[0]);
    own->y[1] += value * rest[1] - rise * slow[1];
}

/* A signal behind lags in parallel, at times in their order, and its first and second integral, (3, count); zero before its first event. Of
 * each event (5, events) its time, and level, slope and both integrals of the signal there; of each lag its weight and itself, real and
 * imaginary part (massprop_cli/prepare/sensor.py). What begins at a time, or `rounded` before it, is not yet there. */
int mp_host_shown(long events, const double *event, long count, const double *at, long lags, const double *lag, const double *rounded,
                  double *out) {
    lag_state own[MP_LAGS];
    const double *time = event, *level = time + events, *rising = level + events, *first = rising + events, *second = first + events;
    double now = 0.0, mean = 0.0;
    long q, i, next = 0;
    if (lags > MP_LAGS) return MP_LIMIT;
    memset(own, 0, sizeof own);
    for (i = 0; i < lags; i++) {
        memcpy(own[i].weight, lag + 4 * i, 4 * sizeof lag[0]);
        own[i].over = -1.0;
        mean += own[i].weight[0] * own[i].lag[0] - own[i].weight[1] * own[i].lag[1];
    }
    for (q = 0; q < count; q++) {
        double since, value, once, twice;
        while (next < events && time[next] < at[q] - *rounded) {
            for (i = 0; i < lags && next > 0; i++)
                goes_on(own + i, time[next] - now, level[next - 1] + rising[next - 1] * (now - time[next - 1]), rising[next - 1]);
            now = time[next++];
        }
        if (next == 0) {
            out[q] = out[count + q] = out[2 * count + q] = 0.0;
            continue;
        }
        for (i = 0; i < lags; i++)
            goes_on(own + i, at[q] - now, level[next - 1] + rising[next - 1] * (now - time[next - 1]), rising[next - 1]);
        now = at[q];
        since = now - time[next - 1];
        value = level[next - 1] + rising[next - 1] * since;
        once = first[next - 1] + since * (level[next - 1] + rising[next - 1] * since / 2);
        twice = second[next - 1] + since * (first[next - 1] + since * (level[next - 1] / 2 + rising[next - 1] * since / 6));
        if (lags > 0) {
            value = 0.0;
            twice -= mean * once;
        }
        for (i = 0; i < lags; i++) {
            double y[2];
            times(own[i].weight, own[i].y, y);
            value += y[0];
            times(own[i].lag, y, y);
            once -= y[0];
            times(own[i].lag, y, y);
            twice += y[0];
        }
        out[q] = value;
        out[count + q] = once;
        out[2 * count + q] = twice;
    }
    return MP_OK;
}

/* Events in the order of time, three numbers each in columns of `most`; they come in pairs that are nearly in order. */
static long put_event(double *events, long most, long count, double time, double step, double slope) {
    long at = count;
    for (; at > 0 && events[at - 1] > time; at--) {
        events[at] = events[at - 1];
        events[most + at] = events[most + at - 1];
        events[2 * most + at] = events[2 * most + at - 1];
    }
    events[at] = time;
    events[most + at] = step;
    events[2 * most + at] = slope;
    return count + 1;
}

/* Adds the integrals of one pulse, by its events in the order of time; it is nothing after the last, and `first`, from which bin on to look
 * for it, goes on to the one in which it begins. */
static void add_pulse(long events, long most, const double *room, long bins, const double *edges, long *first, double *integral,
                      double *moment) {
    const double *time = room, *step = room + most, *slope = room + 2 * most;
    double value = 0, rise = 0, now = time[0];
    long b, next = 0;
    while (*first > 0 && edges[*first] > now) *first -= 1;
    while (*first < bins && edges[*first + 1] <= now) *first += 1;
    for (; next < events && time[next] < edges[0]; now = time[next++]) {
        value += rise * (time[next] - now) + step[next];
        rise += slope[next];
    }
    if (now < edges[0]) {
        value += rise * (edges[0] - now);
        now = edges[0];
    }
    for (b = *first; b < bins && next < events; b++) {
        double sum = 0, late = 0;
        for (;;) {
            int inside = next < events && time[next] < edges[b + 1];
            double until = inside ? time[next] : edges[b + 1], length = until - now, mean = value + rise * length / 2;
            sum += length * mean;
            late += length * ((now - edges[b]) * mean + length * (value / 2 + rise * length / 3));
            value += rise * length;
            now = until;
            if (!inside) break;
            value += step[next];
            rise += slope[next++];
            if (next == events) break;
        }
        integral[b] += sum;
        moment[b] += late;
    }
}

/* The same of jets' pulses (massprop_cli/prepare/actuators.py), added to what is there: parts of the thrust and on-times (jets, count) from
 * `begin` (jets, count) on, ramps (jets, 2) of rise and fall; room: 12 count + 2 bins. */
int mp_host_pulses(long jets, long count, const double *part, const double *begin, const double *on, const double *ramps,
                   const double *touching, long bins, const double *edges, const double *lag, double *room, double *integral,
                   double *moment) {
    long j, k, b, most = 4 * count;
    double *lagging = room + 3 * most;
    for (j = 0; j < jets; j++, part += count, begin += count, on += count, ramps += 2, integral += bins, moment += bins) {
        double rise = ramps[0], fall = ramps[1], since = 0.0, end = 0.0, full = 0.0, now = 0.0;
        long events = 0, first = 0;
        int open = 0;
        for (k = 0; k <= count; k++) {
            int last = k == count;
            if (!last && !(on[k] > 0)) continue;
            if (open && (last || fabs(begin[k] - end) > *touching)) {
                double top = since + rise < end ? since + rise : end, reached = rise > 0 ? (top - since) / rise : 1.0;
                events = put_event(room, most, events, since, rise > 0 ? 0.0 : full, rise > 0 ? full / rise : 0.0);
                if (rise > 0) events = put_event(room, most, events, top, 0.0, -full / rise);
                events = put_event(room, most, events, end, fall > 0 ? 0.0 : -reached * now, fall > 0 ? -now / fall : 0.0);
                if (fall > 0) events = put_event(room, most, events, end + reached * fall, 0.0, now / fall);
                open = 0;
                if (!(*lag > 0)) { /* each by itself: most bins have none */
                    add_pulse(events, most, room, bins, edges, &first, integral, moment);
                    events = 0;
                }
            }
            if (last) break;
            if (!open) {
                since = begin[k];
                full = part[k];
            } else if (part[k] != now) {
                events = put_event(room, most, events, end, part[k] - now, 0.0);
            }
            open = 1;
            now = part[k];
            end = begin[k] + on[k];
        }
        if (events == 0) continue;
        mp_host_bins(events, room, room + most, room + 2 * most, bins, edges, lag, lagging, lagging + bins);
        for (b = 0; b < bins; b++) {
            integral[b] += lagging[b];
            moment[b] += lagging[bins + b];
        }
    }
    return MP_OK;
}

/* (3, 3) covariance one cycle on: step kept stepT + added, (states, states) each. */
static void spread_on(double kept[3][3], long states, const double *step, const double *added) {
    double made[3][3] = {{0}};
    long i, j, m;
    for (i = 0; i < states; i++)
        for (j = 0; j < states; j++)
            for (m = 0; m < states; m++) made[i][j] += step[i * states + m] * kept[m][j];
    for (i = 0; i < states; i++)
        for (j = 0; j < states; j++) {
            kept[i][j] = added[i * states + j];
            for (m = 0; m < states; m++) kept[i][j] += made[i][m] * step[j * states + m];
        }
}

/* White innovations (filters, count, columns) and their variances (filters, count) of filters on rate and torque, for all columns at once
 * (massprop_cli/estimate/whitening.py). now: (filters, 3, columns) as they begin; of three states the last forgets from cycle to cycle. */
int mp_host_white(long filters, long count, long columns, long states, const double *step, const double *added,
                  const double *scattered, const unsigned char *used, const double *driven, const double *measured, double *now,
                  double *rows, double *spread) {
    long f, k, c, i, j;
    double half = states > 2 ? step[2] : 0.0;
    for (f = 0; f < filters; f++) {
        double kept[3][3] = {{0}}, was[3], gain[3] = {0.0, 0.0, 0.0};
        double *rate = now + f * 3 * columns, *torque = rate + columns, *held = torque + columns;
        for (k = 0; k < count; k++) {
            double *row = rows + (f * count + k) * columns, *variance = spread + f * count + k, root;
            const double *drive = driven + k * columns, *seen = measured + k * columns;
            for (c = 0; k > 0 && c < columns; c++) {
                rate[c] += drive[c] + torque[c] + half * held[c];
                held[c] = 0.0;
            }
            if (k > 0) {
                spread_on(kept, states, step, added + f * states * states);
                kept[0][0] += scattered[k];
            }
            *variance = 1.0;
            if (!used[k]) {
                memset(row, 0, (size_t)columns * sizeof row[0]);
                continue;
            }
            *variance += kept[0][0];
            root = sqrt(*variance);
            for (i = 0; i < states; i++) gain[i] = kept[i][0] / *variance;
            for (c = 0; c < columns; c++) {
                double innovation = seen[c] - rate[c];
                rate[c] += gain[0] * innovation;
                torque[c] += gain[1] * innovation;
                held[c] += gain[2] * innovation;
                row[c] = innovation / root;
            }
            for (j = 0; j < states; j++) was[j] = kept[0][j];
            for (i = 0; i < states; i++)
                for (j = 0; j < states; j++) kept[i][j] -= gain[i] * was[j];
        }
    }
    return MP_OK;
}
