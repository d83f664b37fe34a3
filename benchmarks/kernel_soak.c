/* soak CYCLES NOISE [stated] [PART]: flies vector.txt of an exported folder (its first PART cycles), then the same body turning freely for as
 * many cycles as are asked for, with that noise [rad/s, m/s^2], which the vehicle states too if so said; times every cycle, less what asking
 * for the time takes. On each line: cycles so far, mean and worst time of one since the last line [ns], how many numbers were wrong. */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "table.h"

static mp_flight flight;
static double rate[3], inertia[3][3], cg[3], total_ns, worst_ns, asking_ns;
static long cycles, counted, wrong;
static unsigned long long drawn = 1;

static double noise(void) {
    double sum = 0;
    int i;
    for (i = 0; i < 12; i++) {
        drawn = drawn * 6364136223846793005ULL + 1442695040888963407ULL;
        sum += (double)(drawn >> 11) / 9007199254740992.0;
    }
    return sum - 6;
}

static double now_ns(void) {
    struct timespec at;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &at);
    return 1e9 * (double)at.tv_sec + (double)at.tv_nsec;
}

static void fly(const mp_flown *flown) {
    mp_values values;
    int made, i;
    double begun = now_ns(), taken;
    if (mp_flight_step(&flight, flown, &values, &made) != MP_OK) wrong += 1;
    taken = now_ns() - begun - asking_ns;
    total_ns += taken;
    counted += 1;
    cycles += 1;
    if (taken > worst_ns) worst_ns = taken;
    for (i = 0; made && i < 10; i++)
        if (values.told[i] && !(values.value[i] - values.value[i] == 0 && values.sigma[i] > 0)) wrong += 1;
}

/* What is kept of all cycles must stay finite. */
static void told(void) {
    int i;
    for (i = 0; i < MP_PACKED(MP_WIDTH); i++) wrong += !(flight.pass.run.triangle[i] - flight.pass.run.triangle[i] == 0);
    for (i = 0; i < flight.pass.layout.width; i++) wrong += !(flight.pass.run.filter.mean[0][i] - flight.pass.run.filter.mean[0][i] == 0);
    printf("%ld %.0f %.0f %ld\n", cycles, total_ns / (double)counted, worst_ns, wrong);
    total_ns = worst_ns = 0;
    counted = 0;
}

/* The body that turns freely is the one that the vector's end is linear about; it stays so, whatever the estimate does from there on. */
static void let_go(void) {
    int i, j;
    for (i = 0; i < 3; i++) {
        cg[i] = (double)flight.pass.reference.cg[i];
        for (j = 0; j < 3; j++) inertia[i][j] = (double)flight.pass.reference.inertia[i][j];
    }
}

/* Body axes to the IMU's, or back. */
static double turned(const double v[3], int axis, int back) {
    const mp_real(*turn)[3] = mp_commands_table.body_from_imu;
    double sum = 0;
    int i;
    for (i = 0; i < 3; i++) sum += (double)(back ? turn[axis][i] : turn[i][axis]) * v[i];
    return sum;
}

/* Its angular acceleration. */
static void dot(const double w[3], double out[3]) {
    double momentum[3], moment[3], cofactor[3][3], determinant;
    int i, j;
    for (i = 0; i < 3; i++) momentum[i] = inertia[i][0] * w[0] + inertia[i][1] * w[1] + inertia[i][2] * w[2];
    for (i = 0; i < 3; i++) moment[i] = w[(i + 2) % 3] * momentum[(i + 1) % 3] - w[(i + 1) % 3] * momentum[(i + 2) % 3];
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            cofactor[i][j] = inertia[(i + 1) % 3][(j + 1) % 3] * inertia[(i + 2) % 3][(j + 2) % 3] -
                             inertia[(i + 1) % 3][(j + 2) % 3] * inertia[(i + 2) % 3][(j + 1) % 3];
    determinant = inertia[0][0] * cofactor[0][0] + inertia[0][1] * cofactor[0][1] + inertia[0][2] * cofactor[0][2];
    for (i = 0; i < 3; i++) out[i] = (cofactor[0][i] * moment[0] + cofactor[1][i] * moment[1] + cofactor[2][i] * moment[2]) / determinant;
}

/* One cycle of it, by Runge and Kutta in four steps. */
static void turn(mp_flown *flown, double size) {
    double h = (double)flown->duration_s / 4, angle[3] = {0, 0, 0}, push[3] = {0, 0, 0};
    int s, i, k;
    for (s = 0; s < 4; s++) {
        double k1[3], k2[3], k3[3], k4[3], w[3], acceleration[3], arm[3], inner[3];
        dot(rate, k1);
        for (i = 0; i < 3; i++) w[i] = rate[i] + h / 2 * k1[i];
        dot(w, k2);
        for (i = 0; i < 3; i++) w[i] = rate[i] + h / 2 * k2[i];
        dot(w, k3);
        for (i = 0; i < 3; i++) {
            arm[i] = (double)flight.front.vehicle.imu[i] - cg[i];
            acceleration[i] = (k2[i] + k3[i]) / 2;
        }
        for (i = 0; i < 3; i++) inner[i] = w[(i + 1) % 3] * arm[(i + 2) % 3] - w[(i + 2) % 3] * arm[(i + 1) % 3];
        for (i = 0; i < 3; i++) {
            int a = (i + 1) % 3, b = (i + 2) % 3;
            push[i] += h * (acceleration[a] * arm[b] - acceleration[b] * arm[a] + w[a] * inner[b] - w[b] * inner[a]);
        }
        for (i = 0; i < 3; i++) w[i] = rate[i] + h * k3[i];
        dot(w, k4);
        for (i = 0; i < 3; i++) {
            angle[i] += h * rate[i] + h * h / 6 * (k1[i] + k2[i] + k3[i]);
            rate[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
        }
    }
    for (k = 0; k < 3; k++) {
        flown->delta_theta[k] = (mp_real)(turned(angle, k, 0) + size * noise() * (double)flown->duration_s);
        flown->delta_v[k] = (mp_real)(turned(push, k, 0) + size * noise() * (double)flown->duration_s);
    }
}

int main(int count, char **said) {
    long wanted = count > 1 ? atol(said[1]) : 100000, next = 1000, k, length;
    double size = count > 2 ? atof(said[2]) : 1e-10, begun;
    mp_flown flown;
    int phase, i, j;
    mp_vehicle quiet = mp_vehicle_table[0];
    if (scanf("%d %ld", &phase, &length) != 2) return 2;
    if (count > 4) length = atol(said[4]);
    begun = now_ns();
    for (k = 0; k < 1000; k++) (void)now_ns();
    asking_ns = (now_ns() - begun) / 1000;
    if (count > 3 && strcmp(said[3], "stated") == 0) quiet.gyro_noise = quiet.accel_noise[0] = quiet.accel_noise[1] = quiet.accel_noise[2] = (mp_real)size;
    if (mp_flight_begin(&flight, &mp_commands_table, &quiet, &mp_rule_table[0]) != MP_OK) return 3;
    memset(&flown, 0, sizeof flown);
    flown.duration_s = mp_commands_table.period_s;
    for (i = 0; i < 3; i++) rate[i] = 0.3 - 0.1 * i;
    for (k = 0; k < length && cycles < wanted; k++) {
        double numbers[15 + MP_COMMANDS];
        for (i = 0; i < 15 + mp_commands_table.commands; i++)
            if (scanf("%la", &numbers[i]) != 1) return 2;
        memset(&flown, 0, sizeof flown);
        flown.end_s = (mp_real)numbers[0];
        flown.duration_s = (mp_real)numbers[1];
        for (i = 0; i < 3; i++) {
            flown.delta_theta[i] = (mp_real)numbers[2 + i];
            flown.delta_v[i] = (mp_real)numbers[5 + i];
            rate[i] = turned(numbers + 2, i, 1) / numbers[1];
        }
        for (j = 0; j < mp_commands_table.commands; j++) flown.command[j] = (mp_real)numbers[15 + j];
        flown.unused = numbers[14] > 0;
        fly(&flown);
        if (cycles == next) { told(); next *= 10; }
    }
    let_go();
    for (j = 0; j < mp_commands_table.commands; j++) flown.command[j] = 0;
    while (cycles < wanted) {
        flown.end_s += flown.duration_s;
        turn(&flown, size);
        fly(&flown);
        if (cycles == next) { told(); next *= 10; }
    }
    if (counted) told();
    return wrong > 0;
}
