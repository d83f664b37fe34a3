#include "responsemap.h"

#include <math.h>
#include <string.h>

#include "linalg.h"

#define HALVINGS 12
#define LEAST R(1e-3)    /* smallest principal value over the largest that a body in the making may have */
#define FARTHEST R(1e3)  /* factor on the mass that no single step may exceed */

static const int FIRST[6] = {0, 0, 0, 1, 1, 2}, SECOND[6] = {0, 1, 2, 1, 2, 2};

/* (3, 6) Gamma(I): Gamma(I) s = w x I w. */
static void gamma_of(const mp_real inertia[3][3], mp_real out[3][6]) {
    int k, a;
    for (k = 0; k < 6; k++) {
        mp_real unit[3] = {R(0), R(0), R(0)}, column[3], made[3];
        for (a = 0; a < 3; a++) column[a] = inertia[a][SECOND[k]];
        unit[FIRST[k]] = R(1);
        mp_cross(unit, column, made);
        for (a = 0; a < 3; a++) out[a][k] = made[a];
        if (FIRST[k] == SECOND[k]) continue;
        for (a = 0; a < 3; a++) {
            column[a] = inertia[a][FIRST[k]];
            unit[a] = a == SECOND[k] ? R(1) : R(0);
        }
        mp_cross(unit, column, made);
        for (a = 0; a < 3; a++) out[a][k] += made[a];
    }
}

static void times6(const mp_real a[3][3], const mp_real b[3][6], mp_real out[3][6]) {
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 6; j++) out[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
}

/* The symmetric matrix of one element. */
static void unit_of(int k, mp_real out[3][3]) {
    mp_real six[6] = {R(0), R(0), R(0), R(0), R(0), R(0)};
    six[k] = R(1);
    mp_tensor(six, out);
}

/* m_r on a bearing. */
static mp_real rotating(const mp_vehicle *vehicle, mp_real mu) {
    return mp_max(R(1) / mu - vehicle->bearing_mass, R(0.01) / mu);
}

/* d.d 1 - d d^T */
static void spread_of(const mp_real d[3], mp_real out[3][3]) {
    mp_real square = mp_dot(d, d);
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) out[i][j] = (i == j ? square : R(0)) - d[i] * d[j];
}

void mp_coefficients(const mp_vehicle *vehicle, const mp_real theta[10], mp_real phi[MP_COEFFICIENTS],
                     mp_real slopes[MP_COEFFICIENTS][10]) {
    mp_real inverse[3][3], inertia[3][3], turn[3][3], lever[3][3], coupling[3][6], gyro[3][6];
    const mp_real *moment = theta + 6;
    mp_real mu = theta[9], scale = MP_SLIDES(vehicle) ? mu : MP_ON_PEDESTAL(vehicle) ? R(0) : R(1);
    int channels = MP_SLIDES(vehicle) ? 15 : 12, last = 3 * channels, k, a, c;
    mp_tensor(theta, inverse);
    mp_inverse((const mp_real(*)[3])inverse, inertia);
    mp_cross_matrix(moment, turn);
    gamma_of((const mp_real(*)[3])inertia, coupling);
    mp_product((const mp_real(*)[3])inverse, (const mp_real(*)[3])turn, lever);
    times6((const mp_real(*)[3])inverse, (const mp_real(*)[6])coupling, gyro);
    for (a = 0; a < 3; a++) {
        mp_real *row = phi + a * channels;
        for (c = 0; c < 3; c++) {
            row[c] = inverse[a][c];
            row[3 + c] = MP_ON_BEARING(vehicle) ? -vehicle->gravity * lever[a][c] : -lever[a][c];
            if (MP_SLIDES(vehicle)) row[6 + c] = -mu * lever[a][c];
        }
        for (c = 0; c < 6; c++) row[channels - 6 + c] = -gyro[a][c];
    }
    phi[last] = mu;
    for (a = 0; a < 3; a++) phi[last + 1 + a] = scale * moment[a];
    if (slopes == NULL) return;
    memset(slopes, 0, MP_COEFFICIENTS * sizeof slopes[0]);
    for (k = 0; k < 6; k++) {
        mp_real unit[3][3], moved[3][3], changed[3][3], by_lever[3][3], other[3][6], by_gyro[3][6], changing[3][6];
        unit_of(k, unit);
        mp_product((const mp_real(*)[3])unit, (const mp_real(*)[3])turn, by_lever);
        mp_product((const mp_real(*)[3])inertia, (const mp_real(*)[3])unit, moved);
        mp_product((const mp_real(*)[3])moved, (const mp_real(*)[3])inertia, changed);
        gamma_of((const mp_real(*)[3])changed, changing);
        times6((const mp_real(*)[3])unit, (const mp_real(*)[6])coupling, by_gyro);
        times6((const mp_real(*)[3])inverse, (const mp_real(*)[6])changing, other);
        for (a = 0; a < 3; a++) {
            mp_real(*row)[10] = slopes + a * channels;
            for (c = 0; c < 3; c++) {
                row[c][k] = unit[a][c];
                row[3 + c][k] = MP_ON_BEARING(vehicle) ? -vehicle->gravity * by_lever[a][c] : -by_lever[a][c];
                if (MP_SLIDES(vehicle)) row[6 + c][k] = -mu * by_lever[a][c];
            }
            for (c = 0; c < 6; c++) row[channels - 6 + c][k] = other[a][c] - by_gyro[a][c];
        }
    }
    for (k = 0; k < 3; k++) {
        mp_real unit[3] = {R(0), R(0), R(0)}, across[3][3], by_moment[3][3];
        unit[k] = R(1);
        mp_cross_matrix(unit, across);
        mp_product((const mp_real(*)[3])inverse, (const mp_real(*)[3])across, by_moment);
        for (a = 0; a < 3; a++) {
            mp_real(*row)[10] = slopes + a * channels;
            for (c = 0; c < 3; c++) {
                row[3 + c][6 + k] = MP_ON_BEARING(vehicle) ? -vehicle->gravity * by_moment[a][c] : -by_moment[a][c];
                if (!MP_SLIDES(vehicle)) continue;
                row[6 + c][6 + k] = -mu * by_moment[a][c];
                row[6 + c][9] = -lever[a][c];
            }
        }
        slopes[last + 1 + k][6 + k] = scale;
        if (MP_SLIDES(vehicle)) slopes[last + 1 + k][9] = moment[k];
    }
    slopes[last][9] = R(1);
}

void mp_parameters(const mp_vehicle *vehicle, const mp_real theta[10], mp_real out[10]) {
    mp_real inverse[3][3], inertia[3][3];
    int i, j;
    mp_tensor(theta, inverse);
    mp_inverse((const mp_real(*)[3])inverse, inertia);
    for (i = 6; i < 10; i++) out[i] = theta[i];
    if (MP_ON_PEDESTAL(vehicle))
        for (i = 0; i < 3; i++) out[6 + i] = vehicle->centre[i] + theta[6 + i] * theta[9];
    if (MP_SLIDES(vehicle)) {
        mp_real mass = rotating(vehicle, theta[9]), offset[3], spread[3][3];
        for (i = 0; i < 3; i++) offset[i] = theta[6 + i] / mass;
        spread_of(offset, spread);
        for (i = 0; i < 3; i++) {
            out[6 + i] = vehicle->centre[i] + offset[i];
            for (j = 0; j < 3; j++) inertia[i][j] -= mass * spread[i][j];
        }
    }
    mp_elements((const mp_real(*)[3])inertia, out);
}

void mp_slopes(const mp_vehicle *vehicle, const mp_real theta[10], mp_real out[10][10]) {
    mp_real inverse[3][3], inertia[3][3], six[6];
    int i, j, k;
    mp_tensor(theta, inverse);
    mp_inverse((const mp_real(*)[3])inverse, inertia);
    for (i = 0; i < 10; i++)
        for (j = 0; j < 10; j++) out[i][j] = i == j ? R(1) : R(0);
    for (k = 0; k < 6; k++) {
        mp_real unit[3][3], moved[3][3], changed[3][3];
        unit_of(k, unit);
        mp_product((const mp_real(*)[3])inertia, (const mp_real(*)[3])unit, moved);
        mp_product((const mp_real(*)[3])moved, (const mp_real(*)[3])inertia, changed);
        mp_elements((const mp_real(*)[3])changed, six);
        for (i = 0; i < 6; i++) out[i][k] = -six[i];
    }
    if (MP_ON_PEDESTAL(vehicle))
        for (k = 0; k < 3; k++) out[6 + k][6 + k] = theta[9];
    if (MP_SLIDES(vehicle)) {
        const mp_real *kappa = theta + 6;
        mp_real mass = rotating(vehicle, theta[9]), by_mass = R(-1) / (theta[9] * theta[9]) / (mass * mass), spread[3][3];
        for (k = 0; k < 3; k++) {
            mp_real change[3][3];
            for (i = 0; i < 3; i++)
                for (j = 0; j < 3; j++)
                    change[i][j] = (i == j ? R(2) * kappa[k] : R(0)) - (i == k ? kappa[j] : R(0)) - (j == k ? kappa[i] : R(0));
            mp_elements((const mp_real(*)[3])change, six);
            for (i = 0; i < 6; i++) out[i][6 + k] = -six[i] / mass;
            out[6 + k][6 + k] = R(1) / mass;
            out[6 + k][9] = -kappa[k] * by_mass;
        }
        spread_of(kappa, spread);
        mp_elements((const mp_real(*)[3])spread, six);
        for (i = 0; i < 6; i++) out[i][9] = six[i] * by_mass;
    }
}

static void principal_of(const mp_real theta[10], mp_real out[3]) {
    mp_real inverse[3][3], axes[3][3];
    mp_tensor(theta, inverse);
    mp_eigen((const mp_real(*)[3])inverse, out, axes);
}

void mp_sizes(const mp_vehicle *vehicle, const mp_real theta[10], mp_real out[10]) {
    mp_real principal[3], trace, factor = R(1);
    int i;
    principal_of(theta, principal);
    trace = R(1) / principal[0] + R(1) / principal[1] + R(1) / principal[2];
    if (MP_ON_BEARING(vehicle)) {
        factor = rotating(vehicle, theta[9]);
        if (MP_SLIDES(vehicle)) trace -= R(2) * mp_dot(theta + 6, theta + 6) / factor;
    }
    for (i = 0; i < 6; i++) out[i] = principal[2];
    for (i = 6; i < 9; i++) out[i] = factor * MP_SQRT(trace * theta[9]);
    out[9] = theta[9];
}

void mp_scales(const mp_vehicle *vehicle, const mp_real theta[10], mp_real out[10]) {
    mp_real inverse[3][3], inertia[3][3], own[3], moment;
    int i;
    mp_tensor(theta, inverse);
    mp_inverse((const mp_real(*)[3])inverse, inertia);
    for (i = 0; i < 3; i++) own[i] = MP_SQRT(mp_abs(inverse[i][i]));
    for (i = 0; i < 6; i++) out[i] = own[FIRST[i]] * own[SECOND[i]];
    moment = MP_SQRT(mp_abs((inertia[0][0] + inertia[1][1] + inertia[2][2]) * theta[9]));
    if (MP_ON_BEARING(vehicle)) moment *= rotating(vehicle, theta[9]);
    for (i = 6; i < 9; i++) out[i] = moment;
    out[9] = theta[9];
}

/* Whether a symmetric matrix's smallest principal value is no less than LEAST of the largest: as a rule the circles that hold them
   (Gershgorin 1931) tell it. */
static int is_definite(const mp_real theta[10]) {
    mp_real off[3], principal[3], least, most;
    int i;
    off[0] = mp_abs(theta[1]) + mp_abs(theta[2]);
    off[1] = mp_abs(theta[1]) + mp_abs(theta[4]);
    off[2] = mp_abs(theta[2]) + mp_abs(theta[4]);
    least = theta[0] - off[0];
    most = theta[0] + off[0];
    for (i = 1; i < 3; i++) {
        int own = i == 1 ? 3 : 5;
        least = mp_min(least, theta[own] - off[i]);
        most = mp_max(most, theta[own] + off[i]);
    }
    if (least > R(2) * LEAST * most) return 1;
    principal_of(theta, principal);
    return !(principal[0] < LEAST * principal[2]);
}

static int is_body(const mp_vehicle *vehicle, const mp_real theta[10]) {
    mp_real found[10];
    if (!mp_finite(theta, 10) || theta[9] <= R(0) || !is_definite(theta)) return 0;
    mp_parameters(vehicle, theta, found);
    return mp_finite(found, 6) && is_definite(found);
}

void mp_stepped(const mp_vehicle *vehicle, mp_real theta[10], const mp_real step[10]) {
    mp_real share = R(1), moved[10];
    int again, i;
    for (again = 0; again < HALVINGS; again++) {
        for (i = 0; i < 10; i++) moved[i] = theta[i] + share * step[i];
        if (is_body(vehicle, moved) && moved[9] / theta[9] > R(1) / FARTHEST && moved[9] / theta[9] < FARTHEST) {
            memcpy(theta, moved, sizeof moved);
            return;
        }
        share /= R(2);
    }
}

void mp_nearest(const mp_real theta[10], const mp_real step[10], mp_real out[10]) {
    mp_real share = mp_finite(step, 10) ? R(1) : R(0), lighter = mp_max(step[9], (R(1) / FARTHEST - R(1)) * theta[9]);
    int again, i;
    for (again = 0; again < HALVINGS; again++) {
        for (i = 0; i < 10; i++) out[i] = share > R(0) ? theta[i] + share * (i < 9 ? step[i] : lighter) : theta[i];
        if (is_definite(out)) return;
        share /= R(2);
    }
    for (i = 0; i < 10; i++) out[i] = theta[i];
}

void mp_body(const mp_vehicle *vehicle, const mp_real theta[10], const mp_real bias[3], const mp_real acceleration[3],
             const mp_real *phi, mp_reference *out) {
    mp_real found[10], made[MP_COEFFICIENTS];
    int channels = MP_SLIDES(vehicle) ? 15 : 12, i, j;
    mp_parameters(vehicle, theta, found);
    if (phi == NULL) mp_coefficients(vehicle, theta, made, NULL);
    memset(out, 0, sizeof *out);
    memcpy(out->theta, theta, 10 * sizeof theta[0]);
    mp_tensor(found, out->inertia);
    for (i = 0; i < 3; i++) {
        out->cg[i] = found[6 + i];
        out->bias[i] = bias[i];
        out->acceleration[i] = acceleration[i];
        for (j = 0; j < channels; j++) out->phi[i][j] = (phi == NULL ? made : phi)[i * channels + j];
    }
    out->mu = theta[9];
}

void mp_body_of(const mp_vehicle *vehicle, const mp_real given[3][3], const mp_real cg[3], mp_real mu, mp_reference *out) {
    const mp_real still[3] = {R(0), R(0), R(0)};
    mp_real inertia[3][3], inverse[3][3], theta[10];
    int i, j;
    for (i = 0; i < 3; i++) {
        theta[6 + i] = cg[i];
        for (j = 0; j < 3; j++) inertia[i][j] = given[i][j];
    }
    if (MP_ON_BEARING(vehicle)) {
        mp_real mass = rotating(vehicle, mu), offset[3], spread[3][3];
        for (i = 0; i < 3; i++) {
            offset[i] = cg[i] - vehicle->centre[i];
            theta[6 + i] = mass * offset[i];
        }
        spread_of(offset, spread);
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) inertia[i][j] += MP_SLIDES(vehicle) ? mass * spread[i][j] : R(0);
    }
    mp_inverse((const mp_real(*)[3])inertia, inverse);
    mp_elements((const mp_real(*)[3])inverse, theta);
    theta[9] = mu;
    mp_body(vehicle, theta, still, still, NULL, out);
}
