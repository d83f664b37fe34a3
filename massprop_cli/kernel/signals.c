/* Piecewise linear functions of time (massprop_cli/prepare/signal.py): their integrals over bins, and what lags and sensors make of them. */
#include <math.h>
#include <string.h>

#include "host.h"
#include "preprocess.h"

#define SAME 1e-14 /* s by which the rounding of times makes two intervals differ */

SHARED int mp_host_bins(long events, const double *time, const double *step, const double *slope, long bins, const double *edges,
                        const double *lag, double *integral, double *moment);

SHARED int mp_host_pulses(long jets, long count, const double *part, const double *begin, const double *on, const double *ramps,
                          const double *touching, long bins, const double *edges, const double *lag, double *room, double *integral,
                          double *moment);

SHARED int mp_host_shown(long events, const double *event, long count, const double *at, long lags, const double *lag,
                         const double *rounded, double *out);

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
