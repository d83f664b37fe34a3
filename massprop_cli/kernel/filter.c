#include "filter.h"

#include <math.h>
#include <string.h>

#include "linalg.h"

#define GROWN R(100) /* growth of an error beyond which what a rate long past says of the present one is lost in rounding */

void mp_filter_begin(const mp_layout *layout, const mp_real attitude_error[3][5], mp_filter *filter) {
    int i, j;
    memset(filter, 0, sizeof *filter);
    for (i = 0; i < layout->beginnings; i++) filter->mean[i][1 + layout->coefficients + i] = R(1);
    if (layout->at_tilt < 0) return;
    for (i = 0; i < 3; i++) {
        mp_real *tilt = filter->mean[layout->at_tilt + i];
        tilt[0] = attitude_error[i][0];
        tilt[1 + layout->coefficients + layout->at_tilt + i] = attitude_error[i][4];
        for (j = 0; layout->at_bias >= 0 && j < 3; j++) tilt[1 + layout->coefficients + layout->at_bias + j] = attitude_error[i][1 + j];
    }
}

/* x <- F x + u. The transition is the identity but for the rate's rows and the tilt's. */
static void carried(const mp_layout *layout, mp_filter *filter, const mp_time_update *update) {
    mp_real moved[6][MP_WIDTH];
    int rows[6] = {0, 1, 2, -1, -1, -1}, count = 3, i, j, a, c;
    if (layout->at_tilt >= 0)
        for (i = 0; i < 3; i++) rows[count++] = layout->at_tilt + i;
    for (i = 0; i < count; i++) {
        const mp_real *turn = update->transition[rows[i]];
        for (c = 0; c < layout->width; c++) moved[i][c] = R(0);
        for (j = 0; j < layout->states; j++)
            if (turn[j] != R(0))
                for (c = 0; c < layout->width; c++) moved[i][c] += turn[j] * filter->mean[j][c];
        moved[i][0] += update->drive[rows[i]];
        if (i < 3)
            for (a = 0; a < 3; a++)
                for (c = 0; c < layout->channels; c++) moved[i][1 + a * layout->channels + c] += update->solve[i][a] * update->step[c];
    }
    for (i = 0; i < count; i++) memcpy(filter->mean[rows[i]], moved[i], sizeof moved[i]);
}

/* What is measured beyond what the mean expects, (6, width). */
static void left(const mp_layout *layout, const mp_filter *filter, const mp_motion *here, mp_real *white) {
    int i, j, c, a, width = layout->width, channels = layout->channels;
    memset(white, 0, (size_t)(6 * width) * sizeof white[0]);
    for (i = 0; i < 3; i++) {
        mp_real *turning = white + i * width, *pushing = white + (3 + i) * width;
        turning[0] = here->raw_rate[i];
        for (c = 0; c < width; c++) turning[c] -= filter->mean[i][c];
        if (layout->at_bias >= 0)
            for (c = 0; c < width; c++) turning[c] -= filter->mean[layout->at_bias + i][c];
        pushing[0] = here->measured[i];
        for (a = 0; a < 3; a++)
            for (c = 0; c < channels; c++) pushing[1 + a * channels + c] = -(here->euler[i][a] * here->mean[c]);
        for (c = 0; c < 4; c++) pushing[1 + 3 * channels + c] = -here->own[i][c];
        if (layout->at_accel >= 0)
            for (c = 0; c < width; c++) pushing[c] -= filter->mean[layout->at_accel + i][c];
        for (j = 0; j < 3; j++) {
            for (c = 0; c < width; c++) pushing[c] -= here->by_rate[i][j] * filter->mean[j][c];
            if (layout->at_torque >= 0)
                for (c = 0; c < width; c++) pushing[c] -= here->euler[i][j] * filter->mean[layout->at_torque + j][c];
            if (layout->at_tilt >= 0)
                for (c = 0; c < width; c++) pushing[c] -= here->by_tilt[i][j] * filter->mean[layout->at_tilt + j][c];
        }
        for (j = 0; j < layout->scales; j++)
            for (c = 0; c < width; c++) pushing[c] -= here->felt[j][i] * filter->mean[layout->at_scale + j][c];
    }
}

/* [[V, H S], [0, S]] with S <- [F S, G], made lower triangular: root of the innovations, gain times it, updated S. */
static void joined(const mp_layout *layout, mp_filter *filter, const mp_time_update *update, const mp_motion *here, mp_real *joint) {
    int n = layout->states, q = update == NULL ? 0 : layout->process, columns = 6 + n + q, i, j, k;
    memset(joint, 0, (size_t)((6 + n) * columns) * sizeof joint[0]);
    for (i = 0; i < n; i++) {
        mp_real *own = joint + (6 + i) * columns + 6;
        if (update == NULL) {
            for (j = 0; j < n; j++) own[j] = filter->root[i][j];
            continue;
        }
        for (k = 0; k < n; k++)
            if (update->transition[i][k] != R(0))
                for (j = 0; j < n; j++) own[j] += update->transition[i][k] * filter->root[k][j];
        for (j = 0; j < q; j++) own[n + j] = update->process[i][j];
    }
    for (i = 0; i < 3; i++) {
        mp_real *turning = joint + i * columns, *pushing = joint + (3 + i) * columns;
        const mp_real *states = joint + 6 * columns;
        for (j = 0; j < 6; j++) {
            turning[j] = here->noise[i][j];
            pushing[j] = here->noise[3 + i][j];
        }
        for (j = 6; j < columns; j++) {
            turning[j] = states[i * columns + j];
            if (layout->at_bias >= 0) turning[j] += states[(layout->at_bias + i) * columns + j];
            if (layout->at_accel >= 0) pushing[j] += states[(layout->at_accel + i) * columns + j];
            for (k = 0; k < 3; k++) {
                pushing[j] += here->by_rate[i][k] * states[k * columns + j];
                if (layout->at_torque >= 0) pushing[j] += here->euler[i][k] * states[(layout->at_torque + k) * columns + j];
                if (layout->at_tilt >= 0) pushing[j] += here->by_tilt[i][k] * states[(layout->at_tilt + k) * columns + j];
            }
            for (k = 0; k < layout->scales; k++) pushing[j] += here->felt[k][i] * states[(layout->at_scale + k) * columns + j];
        }
    }
    mp_lower(joint, 6 + n, columns);
}

void mp_filter_step(const mp_layout *layout, mp_filter *filter, const mp_time_update *update, const mp_motion *here, mp_real *joint,
                    mp_real *white, mp_real root[6][6]) {
    int n = layout->states, width = layout->width, columns = 6 + n + (update == NULL ? 0 : layout->process), i, j, c;
    if (update != NULL) carried(layout, filter, update);
    left(layout, filter, here, white);
    memcpy(root, here->noise, sizeof here->noise);
    if (layout->process > 0) {
        joined(layout, filter, update, here, joint);
        for (i = 0; i < 6; i++)
            for (j = 0; j < 6; j++) root[i][j] = joint[i * columns + j];
    }
    for (i = 0; i < 6; i++) {
        mp_real *own = white + i * width, over;
        for (j = 0; j < i; j++)
            if (root[i][j] != R(0))
                for (c = 0; c < width; c++) own[c] -= root[i][j] * white[j * width + c];
        over = R(1) / root[i][i];
        for (c = 0; c < width; c++) own[c] *= over;
    }
    if (layout->process == 0) return;
    for (i = 0; i < n; i++) {
        const mp_real *updated = joint + (6 + i) * columns;
        for (j = 0; j < 6; j++)
            for (c = 0; c < width; c++) filter->mean[i][c] += updated[j] * white[j * width + c];
        for (j = 0; j < n; j++) filter->root[i][j] = updated[6 + j];
    }
}

void mp_ordered(const mp_layout *layout, const mp_real *white, mp_real *rows) {
    int width = layout->width, m = layout->beginnings, n = layout->coefficients, i, c;
    for (i = 0; i < 6; i++) {
        const mp_real *from = white + i * width;
        mp_real *to = rows + i * width;
        for (c = 0; c < m; c++) to[c] = -from[1 + n + c];
        for (c = 0; c < n; c++) to[m + c] = -from[1 + c];
        to[m + n] = from[0];
    }
}

void mp_renew(const mp_vehicle *vehicle, const mp_layout *layout, mp_run *run) {
    int i, c, first = 1 + layout->coefficients, much = 0;
    if (!run->begun || layout->process > 0 || MP_ON_BEARING(vehicle)) return;
    for (i = 0; i < 3; i++)
        for (c = 0; c < 3; c++) much |= mp_abs(run->filter.mean[i][first + c]) >= GROWN;
    if (!much) return;
    /* the triangle's first rows alone hold the old beginning; all others are what it leaves */
    for (i = 0; i < 3; i++) {
        mp_real *own = run->triangle + AT(layout->width, i) - i;
        for (c = i; c < layout->width; c++) own[c] = R(0);
        own[i] = R(1) / layout->prior[i];
        for (c = 0; c < layout->width; c++) run->filter.mean[i][c] = R(0);
        run->filter.mean[i][first + i] = R(1);
    }
}

void mp_run_begin(const mp_layout *layout, long at, mp_run *run) {
    int i;
    memset(run, 0, sizeof *run);
    run->at = at;
    for (i = 0; i < layout->beginnings; i++) run->triangle[AT(layout->width, i)] = R(1) / layout->prior[i];
}
