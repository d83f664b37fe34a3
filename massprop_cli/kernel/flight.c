#include "flight.h"

#include <string.h>

int mp_flight_begin(mp_flight *flight, const mp_commands *commands, const mp_vehicle *vehicle, const mp_rule *rule) {
    int status = mp_preprocess_begin(&flight->preprocess, commands, vehicle);
    if (status == MP_OK) status = mp_begin(&flight->pass, vehicle);
    flight->rule = *rule;
    memset(&flight->steady, 0, sizeof flight->steady);
    return status;
}

/* A completed cycle, where it counts. */
static int taken_in(mp_flight *flight, int usable, mp_values *out, int *made) {
    int status;
    *made = 0;
    if (!usable) return MP_OK;
    if (!flight->pass.run.begun) memcpy(flight->pass.attitude_error, flight->preprocess.attitude_error, sizeof flight->pass.attitude_error);
    status = mp_step(&flight->pass, &flight->cycle, &flight->row);
    if (status != MP_OK) return status;
    if (flight->pass.started) memcpy(flight->preprocess.bias, flight->pass.estimate.bias, sizeof flight->preprocess.bias);
    mp_report(&flight->rule, &flight->pass, &flight->row, &flight->steady, out);
    *made = 1;
    return MP_OK;
}

int mp_flight_step(mp_flight *flight, const mp_flown *flown, mp_values *out, int *made) {
    int completed = 0, usable = 0, status = mp_preprocess_step(&flight->preprocess, flown, &flight->cycle, &completed, &usable);
    *made = 0;
    if (status != MP_OK || !completed) return status;
    return taken_in(flight, usable, out, made);
}

int mp_flight_last(mp_flight *flight, mp_values *out, int *made) {
    int completed = 0, usable = 0, status = mp_preprocess_last(&flight->preprocess, &flight->cycle, &completed, &usable);
    *made = 0;
    if (status != MP_OK || !completed) return status;
    return taken_in(flight, usable, out, made);
}
