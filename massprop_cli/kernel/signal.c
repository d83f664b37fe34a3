/* Integrals of commanded actuators over the bins of a log, for the ground (massprop_cli/prepare). */
#include <math.h>

#include "host.h"

/* What a first-order lag has come to after a `length` of what began at `value` and rose. */
static double lagged(double y, double value, double rise, double length, double lag) {
    double rest;
    if (!(lag > 0.0) || (y == 0.0 && value == 0.0 && rise == 0.0)) return y;
    rest = -expm1(-length / lag);
    return y * (1.0 - rest) + value * rest + rise * (length - lag * rest);
}

/* Integral and first moment over each bin of what goes on linearly but for events in the order of time, zero before the first, or of what
 * a lag makes of it (massprop_cli/prepare/signal.py). */
SHARED int mp_host_bins(long events, const double *time, const double *step, const double *slope, long bins, const double *edges,
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

/* Adds `weight` times the integrals of one pulse, by its events in the order of time; it is nothing after the last, and `first`, from which
 * bin on to look for it, goes on to the one in which it begins. */
static void add_pulse(long events, long most, const double *room, double weight, long bins, const double *edges, long *first,
                      double *integral, double *moment) {
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
        integral[b] += weight * sum;
        moment[b] += weight * late;
    }
}

/* The same of jets' pulses (massprop_cli/prepare/actuators.py), `weight` times, added to what is there: on-times (jets, count) from `begin`
 * (count) on, ramps (jets, 2) of rise and fall; room: 12 count + 2 bins. */
SHARED int mp_host_pulses(long jets, long count, const double *begin, const double *on, const double *ramps, const double *touching,
                          double weight, long bins, const double *edges, const double *lag, double *room, double *integral,
                          double *moment) {
    long j, k, b, most = 4 * count;
    double *lagging = room + 3 * most;
    for (j = 0; j < jets; j++, on += count, ramps += 2, integral += bins, moment += bins) {
        double rise = ramps[0], fall = ramps[1], since = 0.0, end = 0.0;
        long events = 0, first = 0;
        int open = 0;
        for (k = 0; k <= count; k++) {
            int last = k == count;
            if (!last && !(on[k] > 0)) continue;
            if (open && (last || fabs(begin[k] - end) > *touching)) {
                double top = since + rise < end ? since + rise : end, reached = rise > 0 ? (top - since) / rise : 1.0;
                events = put_event(room, most, events, since, rise > 0 ? 0.0 : 1.0, rise > 0 ? 1 / rise : 0.0);
                if (rise > 0) events = put_event(room, most, events, top, 0.0, -1 / rise);
                events = put_event(room, most, events, end, fall > 0 ? 0.0 : -reached, fall > 0 ? -1 / fall : 0.0);
                if (fall > 0) events = put_event(room, most, events, end + reached * fall, 0.0, 1 / fall);
                open = 0;
                if (!(*lag > 0)) { /* each by itself: most bins have none */
                    add_pulse(events, most, room, weight, bins, edges, &first, integral, moment);
                    events = 0;
                }
            }
            if (last) break;
            if (!open) since = begin[k];
            open = 1;
            end = begin[k] + on[k];
        }
        if (events == 0) continue;
        mp_host_bins(events, room, room + most, room + 2 * most, bins, edges, lag, lagging, lagging + bins);
        for (b = 0; b < bins; b++) {
            integral[b] += weight * lagging[b];
            moment[b] += weight * lagging[bins + b];
        }
    }
    return MP_OK;
}
