#include "host.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "flight.h"
#include "linalg.h"

#define TOLD 131 /* numbers of a row: mean 10, covariance 100, relative 3, innovation 6, its sigma 6, normalised 6 */

SHARED int mp_host_interface(void);
SHARED size_t mp_host_size(void);
SHARED int mp_host_begin(mp_pass *pass, const double *table);
SHARED void mp_host_attitude_error(mp_pass *pass, const double *attitude_error);
SHARED int mp_host_run(mp_pass *pass, long count, long stride, const double *rows, double *told);
SHARED size_t mp_host_flight_size(void);
SHARED mp_pass *mp_host_pass(mp_flight *flight);
SHARED int mp_host_fly(mp_flight *flight, const double *commands, const double *vehicle, const double *rule);
SHARED int mp_host_phase(mp_flight *flight, const double *vehicle, const double *rule);
SHARED long mp_host_flown(mp_flight *flight, long count, long stride, const double *rows, int last, double *told, double *values,
                          int *status);
SHARED int mp_host_reference(const mp_pass *pass, double *out);

const double *mp_copied(mp_real *to, const double *from, int count) {
    int i;
    for (i = 0; i < count; i++) to[i] = (mp_real)from[i];
    return from + count;
}

static const double *read_int(int *to, const double *from) {
    *to = (int)*from;
    return from + 1;
}

/* Of these calls and what they are handed: another number where any of it is another (massprop_cli/kernel/__init__.py). */
int mp_host_interface(void) { return 16; }

size_t mp_host_size(void) { return sizeof(mp_pass); }

mp_vehicle mp_vehicle_of(const double *table) {
    mp_vehicle vehicle;
    int w;
    table = read_int(&vehicle.bearing, table);
    table = read_int(&vehicle.gyro_bias, table);
    table = read_int(&vehicle.accel_bias, table);
    table = read_int(&vehicle.slow_torque, table);
    table = read_int(&vehicle.tilt, table);
    table = read_int(&vehicle.bins, table);
    table = read_int(&vehicle.pulses, table);
    table = mp_copied(vehicle.imu, table, 3);
    table = mp_copied(&vehicle.gyro_noise, table, 1);
    table = mp_copied(vehicle.accel_noise, table, 3);
    table = mp_copied(&vehicle.gyro_bias_sigma, table, 1);
    table = mp_copied(&vehicle.accel_bias_sigma, table, 1);
    table = mp_copied(&vehicle.torque_noise, table, 1);
    table = mp_copied(&vehicle.torque_walk, table, 1);
    table = mp_copied(&vehicle.gyro_bias_walk, table, 1);
    table = mp_copied(&vehicle.prior_scale, table, 1);
    table = mp_copied(&vehicle.reach, table, 1);
    table = mp_copied(&vehicle.known_mass, table, 1);
    table = mp_copied(vehicle.centre, table, 3);
    table = mp_copied(&vehicle.bearing_mass, table, 1);
    table = mp_copied(&vehicle.gravity, table, 1);
    table = read_int(&vehicle.filtered, table);
    table = mp_copied(&vehicle.curvature, table, 1);
    table = mp_copied(&vehicle.later, table, 1);
    table = mp_copied(&vehicle.smearing, table, 1);
    table = mp_copied(&vehicle.thrust_sigma, table, 1);
    table = read_int(&vehicle.wheels, table);
    for (w = 0; w < vehicle.wheels && w < MP_WHEELS; w++) {
        table = mp_copied(vehicle.axis[w], table, 3);
        table = mp_copied(&vehicle.spin_sigma[w], table, 1);
        table = mp_copied(&vehicle.spin_inertia[w], table, 1);
        table = mp_copied(&vehicle.free_inertia[w], table, 1);
    }
    return vehicle;
}

int mp_host_begin(mp_pass *pass, const double *table) {
    mp_vehicle vehicle = mp_vehicle_of(table);
    return mp_begin(pass, &vehicle);
}

static int commands_of(const double *table, mp_commands *out) {
    int i, j;
    table = read_int(&out->jets, table);
    table = read_int(&out->commands, table);
    table = read_int(&out->records, table);
    table = read_int(&out->waits, table);
    if (out->commands > MP_COMMANDS) return MP_LIMIT;
    table = mp_copied(&out->period_s, table, 1);
    table = mp_copied(&out->delay_s, table, 1);
    table = mp_copied(&out->memory_s, table, 1);
    table = mp_copied(&out->late, table, 1);
    table = mp_copied(&out->pulse_sigma, table, 1);
    table = mp_copied(out->body_from_imu[0], table, 9);
    table = mp_copied(out->attitude_wxyz, table, 4);
    for (i = 0; i < MP_SENSORS; i++) {
        table = read_int(&out->sensor[i].instant, table);
        table = read_int(&out->sensor[i].lags, table);
        table = mp_copied(&out->sensor[i].latency_s, table, 1);
        table = mp_copied(out->sensor[i].weight[0], table, 2 * MP_LAGS);
        table = mp_copied(out->sensor[i].lag_s[0], table, 2 * MP_LAGS);
    }
    for (j = 0; j < out->commands; j++) {
        table = mp_copied(out->wrench[j], table, 6);
        table = mp_copied(&out->rise_s[j], table, 1);
        table = mp_copied(&out->fall_s[j], table, 1);
        table = mp_copied(&out->own_delay_s[j], table, 1);
    }
    return MP_OK;
}

static void rule_of(const double *table, mp_rule *out) {
    int i;
    table = mp_copied(&out->thrust_sigma, table, 1);
    table = read_int(&out->count, table);
    table = read_int(&out->relative, table);
    table = mp_copied(out->tolerance, table, 3);
    table = mp_copied(out->beyond, table, 6);
    table = mp_copied(&out->gate, table, 1);
    table = read_int(&out->known, table);
    for (i = 0; i < out->known; i++) {
        table = read_int(&out->known_index[i], table);
        table = mp_copied(&out->known_value[i], table, 1);
        table = mp_copied(&out->known_sigma[i], table, 1);
    }
}

size_t mp_host_flight_size(void) { return sizeof(mp_flight); }

mp_pass *mp_host_pass(mp_flight *flight) { return &flight->pass; }

int mp_host_fly(mp_flight *flight, const double *commands, const double *vehicle, const double *rule) {
    mp_commands table;
    mp_vehicle of = mp_vehicle_of(vehicle);
    mp_rule by;
    int status = commands_of(commands, &table);
    if (status != MP_OK) return status;
    rule_of(rule, &by);
    return mp_flight_begin(flight, &table, &of, &by);
}

void mp_cycle_of(const mp_vehicle *vehicle, const double *row, mp_cycle *out) {
    int b;
    row = mp_copied(&out->end_s, row, 1);
    row = mp_copied(&out->duration_s, row, 1);
    row = mp_copied(out->rate, row, 3);
    row = mp_copied(out->rate_step, row, 3);
    row = mp_copied(out->carried, row, 3);
    row = mp_copied(out->force, row, 3);
    row = mp_copied(out->up[0], row, 3);
    row = mp_copied(out->up[1], row, 3);
    row = mp_copied(out->rising, row, 6);
    row = mp_copied(out->falling, row, 6);
    row = mp_copied(out->whole, row, 6);
    row = read_int(&out->deaf[0], row);
    row = read_int(&out->deaf[1], row);
    row = mp_copied(out->impulse[0], row, 6 * vehicle->bins);
    row = mp_copied(out->skew[0], row, 6 * vehicle->bins);
    if (vehicle->pulses) row = mp_copied(out->pulse_covariance[0], row, 36);
    for (b = 0; b < vehicle->bins && vehicle->wheels > 0; b++) {
        row = mp_copied(out->momentum[b], row, vehicle->wheels);
        row = mp_copied(out->growing[b], row, vehicle->wheels);
    }
    for (b = 0; b < 3 && vehicle->wheels > 0; b++) row = mp_copied(out->grown[b], row, vehicle->wheels);
}

/* What isn't said is NaN. */
static void written(const mp_row *row, double *out) {
    int i;
    for (i = 0; i < 10; i++) out[i] = row->told ? (double)row->mean[i] : (double)NAN;
    for (i = 0; i < 100; i++) out[10 + i] = row->told ? (double)row->covariance[i / 10][i % 10] : (double)NAN;
    for (i = 0; i < 3; i++) out[110 + i] = row->told ? (double)row->relative[i] : (double)NAN;
    for (i = 0; i < 6; i++) {
        out[113 + i] = row->expected[i / 3] ? (double)row->innovation[i] : (double)NAN;
        out[119 + i] = row->expected[i / 3] ? (double)row->sigma[i] : (double)NAN;
        out[125 + i] = row->expected[i / 3] ? (double)row->normalised[i] : (double)NAN;
    }
}

/* Where the attitude may be before the first cycle, (15). */
void mp_host_attitude_error(mp_pass *pass, const double *attitude_error) { (void)mp_copied(pass->attitude_error[0], attitude_error, 15); }

int mp_host_run(mp_pass *pass, long count, long stride, const double *rows, double *told) {
    long k;
    for (k = 0; k < count; k++) {
        mp_cycle cycle;
        mp_row row;
        int status;
        mp_cycle_of(&pass->vehicle, rows + k * stride, &cycle);
        status = mp_step(pass, &cycle, NULL, &row);
        if (status != MP_OK) return status;
        written(&row, told + k * TOLD);
    }
    return MP_OK;
}

/* Another phase: commands in flight and the attitude go on. */
int mp_host_phase(mp_flight *flight, const double *vehicle, const double *rule) {
    rule_of(rule, &flight->rule);
    memset(&flight->steady, 0, sizeof flight->steady);
    return mp_host_begin(&flight->pass, vehicle);
}

static void flown_of(const mp_commands *table, int wheels, const double *row, mp_flown *out) {
    row = mp_copied(&out->end_s, row, 1);
    row = mp_copied(&out->duration_s, row, 1);
    row = mp_copied(out->delta_theta, row, 3);
    row = mp_copied(out->delta_v, row, 3);
    row = read_int(&out->deaf[0], row);
    row = read_int(&out->deaf[1], row);
    row = read_int(&out->unused, row);
    row = mp_copied(out->command, row, table->commands);
    (void)mp_copied(out->speed, row, wheels);
}

/* (30) values, sigmas and verdicts; NaN where nothing is told. */
static void reported(const mp_values *from, double *out) {
    int i;
    for (i = 0; i < 10; i++) {
        out[i] = from->told[i] ? (double)from->value[i] : (double)NAN;
        out[10 + i] = from->told[i] ? (double)from->sigma[i] : (double)NAN;
        out[20 + i] = (double)from->verdict[i];
    }
}

/* Cycles as they were flown, and with `last` no more of them; how many were estimated from. */
long mp_host_flown(mp_flight *flight, long count, long stride, const double *rows, int last, double *told, double *values, int *status) {
    long k, done = 0;
    for (k = 0; k < count + (last != 0); k++) {
        mp_flown flown;
        mp_values found;
        int made;
        if (k < count) {
            flown_of(&flight->preprocess.table, flight->preprocess.vehicle.wheels, rows + k * stride, &flown);
            *status = mp_flight_step(flight, &flown, &found, &made);
        } else {
            *status = mp_flight_last(flight, &found, &made);
        }
        if (*status != MP_OK) return done;
        if (!made) continue;
        written(&flight->row, told + done * TOLD);
        reported(&found, values + done * 30);
        done += 1;
    }
    *status = MP_OK;
    return done;
}

/* (19 + 3 x channels) inertia, CG, mu, gyro bias, acceleration by a slow torque, phi of the present estimate; 0 while there is none. */
int mp_host_reference(const mp_pass *pass, double *out) {
    int i, j, channels = pass->layout.channels;
    for (i = 0; i < 9; i++) out[i] = (double)pass->estimate.inertia[i / 3][i % 3];
    for (i = 0; i < 3; i++) {
        out[9 + i] = (double)pass->estimate.cg[i];
        out[13 + i] = (double)pass->estimate.bias[i];
        out[16 + i] = (double)pass->estimate.acceleration[i];
        for (j = 0; j < channels; j++) out[19 + i * channels + j] = (double)pass->estimate.phi[i][j];
    }
    out[12] = (double)pass->estimate.mu;
    for (i = 0; i < pass->layout.scales; i++) out[19 + 3 * channels + i] = (double)pass->estimate.scale[i];
    return pass->started;
}
