/* The kernel over arrays, for the ground: numbers in double precision by rows, whatever the kernel's own precision. */
#include <math.h>
#include <stddef.h>

#include "massprop.h"
#include "small.h"

#if defined(_WIN32)
#define SHARED __declspec(dllexport)
#else
#define SHARED __attribute__((visibility("default")))
#endif

#define TOLD 128 /* numbers of a row: mean 10, covariance 100, innovation 6, its sigma 6, normalised 6 */

SHARED size_t mp_host_size(void);
SHARED int mp_host_begin(mp_pass *pass, const double *table);
SHARED int mp_host_run(mp_pass *pass, long count, long stride, const double *rows, double *told);
SHARED int mp_host_reference(const mp_pass *pass, double *out);

static const double *copied(mp_real *to, const double *from, int count) {
    int i;
    for (i = 0; i < count; i++) to[i] = (mp_real)from[i];
    return from + count;
}

static const double *read_int(int *to, const double *from) {
    *to = (int)*from;
    return from + 1;
}

size_t mp_host_size(void) { return sizeof(mp_pass); }

int mp_host_begin(mp_pass *pass, const double *table) {
    mp_vehicle vehicle;
    table = read_int(&vehicle.bearing, table);
    table = read_int(&vehicle.gyro_bias, table);
    table = read_int(&vehicle.accel_bias, table);
    table = read_int(&vehicle.slow_torque, table);
    table = read_int(&vehicle.tilt, table);
    table = read_int(&vehicle.bins, table);
    table = read_int(&vehicle.pulses, table);
    table = copied(vehicle.imu, table, 3);
    table = copied(&vehicle.gyro_noise, table, 1);
    table = copied(vehicle.accel_noise, table, 3);
    table = copied(&vehicle.gyro_bias_sigma, table, 1);
    table = copied(&vehicle.accel_bias_sigma, table, 1);
    table = copied(&vehicle.slow_torque_sigma, table, 1);
    table = copied(&vehicle.torque_noise, table, 1);
    table = copied(&vehicle.torque_walk, table, 1);
    table = copied(&vehicle.prior_scale, table, 1);
    table = copied(&vehicle.reach, table, 1);
    table = copied(&vehicle.known_mass, table, 1);
    table = copied(vehicle.centre, table, 3);
    table = copied(&vehicle.bearing_mass, table, 1);
    (void)copied(&vehicle.gravity, table, 1);
    return mp_begin(pass, &vehicle);
}

static void cycle_of(const mp_vehicle *vehicle, const double *row, mp_cycle *out) {
    row = copied(&out->end_s, row, 1);
    row = copied(&out->duration_s, row, 1);
    row = copied(out->rate, row, 3);
    row = copied(out->rate_step, row, 3);
    row = copied(out->force, row, 3);
    row = copied(out->up[0], row, 3);
    row = copied(out->up[1], row, 3);
    row = copied(out->rising, row, 6);
    row = copied(out->falling, row, 6);
    row = read_int(&out->deaf[0], row);
    row = read_int(&out->deaf[1], row);
    row = copied(out->impulse[0], row, 6 * vehicle->bins);
    row = copied(out->skew[0], row, 6 * vehicle->bins);
    if (vehicle->pulses) (void)copied(out->pulse_covariance[0], row, 36);
}

/* What isn't said is NaN. */
static void written(const mp_row *row, double *out) {
    int i;
    for (i = 0; i < 10; i++) out[i] = row->told ? (double)row->mean[i] : (double)NAN;
    for (i = 0; i < 100; i++) out[10 + i] = row->told ? (double)row->covariance[i / 10][i % 10] : (double)NAN;
    for (i = 0; i < 6; i++) {
        out[110 + i] = row->expected[i / 3] ? (double)row->innovation[i] : (double)NAN;
        out[116 + i] = row->expected[i / 3] ? (double)row->sigma[i] : (double)NAN;
        out[122 + i] = row->expected[i / 3] ? (double)row->normalised[i] : (double)NAN;
    }
}

int mp_host_run(mp_pass *pass, long count, long stride, const double *rows, double *told) {
    long k;
    for (k = 0; k < count; k++) {
        mp_cycle cycle;
        mp_row row;
        int status;
        cycle_of(&pass->vehicle, rows + k * stride, &cycle);
        status = mp_step(pass, &cycle, &row);
        if (status != MP_OK) return status;
        written(&row, told + k * TOLD);
    }
    return MP_OK;
}

/* (16 + 3 x channels) inertia, CG, mu, gyro bias, phi of the present estimate; 0 while there is none. */
int mp_host_reference(const mp_pass *pass, double *out) {
    int i, j, channels = pass->layout.channels;
    for (i = 0; i < 9; i++) out[i] = (double)pass->estimate.inertia[i / 3][i % 3];
    for (i = 0; i < 3; i++) {
        out[9 + i] = (double)pass->estimate.cg[i];
        out[13 + i] = (double)pass->estimate.bias[i];
        for (j = 0; j < channels; j++) out[16 + i * channels + j] = (double)pass->estimate.phi[i][j];
    }
    out[12] = (double)pass->estimate.mu;
    return pass->started;
}
