#include "flight.h"

#include <string.h>

#include "linalg.h"

int mp_flight_begin(mp_flight *flight, const mp_commands *commands, const mp_vehicle *vehicle, const mp_rule *rule) {
    int status = mp_preprocess_begin(&flight->preprocess, commands, vehicle);
    if (status == MP_OK) status = mp_begin(&flight->pass, vehicle);
    flight->rule = *rule;
    memset(&flight->steady, 0, sizeof flight->steady);
    memset(flight->far, 0, sizeof flight->far);
    return status;
}

/* The completed cycle into the estimate, without a reading whose innovation is beyond the gate: that innovation is reported. A run of such
   readings is motion that the tables do not have, and used. */
static int estimated(mp_flight *flight) {
    mp_real gate[2], seen[2][3];
    mp_row *row = &flight->row;
    int s, left[2] = {0, 0}, status;
    for (s = 0; s < 2; s++) gate[s] = flight->far[s] < MP_BELIEVED ? flight->rule.gate : R(0);
    status = mp_step(&flight->pass, &flight->cycle, gate, row);
    for (s = 0; s < 2 && status == MP_OK; s++) {
        if (!row->beyond[s]) continue;
        memcpy(seen[s], row->normalised + 3 * s, sizeof seen[s]);
        left[s] = 1;
        if (s == 0) mp_preprocess_without_gyro(&flight->preprocess, row->rate, &flight->cycle);
        else mp_preprocess_without_accelerometer(&flight->cycle);
        status = mp_step(&flight->pass, &flight->cycle, gate, row);
    }
    for (s = 0; s < 2 && status == MP_OK; s++) {
        if (left[s]) memcpy(row->normalised + 3 * s, seen[s], sizeof seen[s]);
        row->expected[s] |= left[s];
        if (row->expected[s]) flight->far[s] = mp_beyond(row, s, flight->rule.gate) ? flight->far[s] + 1 : 0;
    }
    return status;
}

/* A completed cycle, where it counts. */
static int taken_in(mp_flight *flight, int usable, mp_values *out, int *made) {
    int status;
    *made = 0;
    if (!usable) return MP_OK;
    if (!flight->pass.run.begun) memcpy(flight->pass.attitude_error, flight->preprocess.attitude_error, sizeof flight->pass.attitude_error);
    status = estimated(flight);
    if (status != MP_OK) return status;
    if (flight->pass.started) memcpy(flight->preprocess.bias, flight->pass.estimate.bias, sizeof flight->preprocess.bias);
    mp_report(&flight->rule, &flight->pass, &flight->row, &flight->steady, out);
    *made = 1;
    return MP_OK;
}

int mp_flight_step(mp_flight *flight, const mp_flown *flown, mp_values *out, int *made) {
    int completed = 0, usable = 0, status;
    *made = 0;
    if (!flight->pass.ready) return MP_ORDER;
    status = mp_preprocess_step(&flight->preprocess, flown, &flight->cycle, &completed, &usable);
    if (status != MP_OK || !completed) return status;
    return taken_in(flight, usable, out, made);
}

int mp_flight_last(mp_flight *flight, mp_values *out, int *made) {
    int completed = 0, usable = 0, status;
    *made = 0;
    if (!flight->pass.ready) return MP_ORDER;
    status = mp_preprocess_last(&flight->preprocess, &flight->cycle, &completed, &usable);
    if (status != MP_OK || !completed) return status;
    return taken_in(flight, usable, out, made);
}
