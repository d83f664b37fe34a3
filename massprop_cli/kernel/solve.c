#include "solve.h"

#include <math.h>
#include <string.h>

#include "responsemap.h"
#include "linalg.h"

#define LOOSE R(3)          /* one sigma of the coefficients of the gyroscopic coupling while they are free */
#define INCONSISTENT R(60)  /* more chi-square than the coupling's free coefficients would leave by chance */
#define CLEAR R(0.15)       /* relative sigma below which a row's 1/m may be that far from the estimate: by chance it is not */
#define EXACT R(1e-3)       /* part of a known mass that is none */
#define WEIGHED R(0.5)      /* part of a known mass' reciprocal that is one sigma of it on a bearing */
#define KNOWN R(0.1)        /* relative sigma below which an axis' response counts as known */
#define HEAVIER R(10)       /* factor on the mass that no step of the search may exceed; of a mass that isn't told, beside where it began */
#define BALANCED R(0.02)    /* of what turns on a bearing, the CG's distance from there over its natural size */
#define ROUNDED (R(1000) * MP_EPSILON) /* information on 1/m beside that of what draws it, as 1, below which it is rounding */
#define STEPS 6
#define STUCK R(3)          /* sigmas of a step that leads to no body: so far from where it should be its values mean nothing */
#define STILL R(0.1)        /* a step of fewer sigmas is the last */

static const int MOMENTS[3] = {0, 3, 5};
/* where each row of theta's root begins, and of what the slopes of inertia, CG and mu make of it */
static const int UPPER[10] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9}, STEEPENED[10] = {0, 0, 0, 0, 0, 0, 6, 7, 8, 9};

static int nuisances(const mp_layout *layout, int bound) { return layout->beginnings + (bound ? 0 : 18); }

/* Where in phi a coefficient of the gyroscopic coupling stands. */
static int coupling(const mp_layout *layout, int k) { return (k / 6 + 1) * layout->channels - 6 + k % 6; }

/* One row on beginnings and phi, nothing before column `first`, as a row on nuisances and theta's departure over its scale. */
static void reduced(const mp_layout *layout, const mp_posed *posed, const mp_real *row, int first, mp_real *out) {
    int m = layout->beginnings, n = layout->coefficients, own = posed->count - 10, i, k;
    mp_real left = row[m + n];
    for (i = 0; i < m; i++) out[i] = i < first ? R(0) : row[i];
    for (i = own; i < posed->count; i++) out[i] = R(0);
    if (!posed->bound)
        for (k = 0; k < 18; k++) {
            i = coupling(layout, k);
            out[m + k] = m + i < first ? R(0) : LOOSE * row[m + i];
        }
    for (k = first > m ? first - m : 0; k < n; k++) {
        mp_real by = row[m + k];
        const mp_real *slope = posed->slopes[k];
        if (by == R(0)) continue;
        left -= by * posed->phi[k];
        for (i = 0; i < 10; i++) out[own + i] += by * slope[i];
    }
    out[posed->count] = left;
}

/* Where a triangle is to be about theta; nothing in it yet. */
static void about(const mp_vehicle *vehicle, const mp_layout *layout, const mp_real theta[10], const mp_real scale[10], int bound,
                  mp_posed *out) {
    int i, k;
    out->bound = bound;
    out->count = nuisances(layout, bound) + 10;
    memcpy(out->theta, theta, sizeof out->theta);
    memcpy(out->scale, scale, sizeof out->scale);
    mp_coefficients(vehicle, theta, out->phi, out->slopes);
    if (!bound)
        for (k = 0; k < 18; k++) memset(out->slopes[coupling(layout, k)], 0, sizeof out->slopes[0]);
    for (k = 0; k < layout->coefficients; k++)
        for (i = 0; i < 10; i++) out->slopes[k][i] *= scale[i];
}

/* The triangle of all that a run has taken in, with a prior of `scale` about `centre`, or about theta. */
static void posed_of(const mp_vehicle *vehicle, const mp_layout *layout, const mp_run *run, const mp_real theta[10],
                     const mp_real scale[10], const mp_real *centre, int bound, mp_real *rows, mp_posed *out) {
    int size, i;
    about(vehicle, layout, theta, scale, bound, out);
    size = out->count + 1;
    memset(out->triangle, 0, sizeof out->triangle);
    for (i = layout->beginnings; i < out->count; i++) out->triangle[AT(size, i)] = R(1);
    if (centre != NULL)
        for (i = 0; i < 10; i++) {
            int row = out->count - 10 + i;
            out->triangle[AT(size, row) + out->count - row] = (centre[i] - theta[i]) / scale[i];
        }
    for (i = 0; i < layout->width; i++)
        reduced(layout, out, run->triangle + AT(layout->width, i) - i, i, rows + i * size);
    mp_fold(out->triangle, size, rows, layout->width);
}

/* What stands beside a triangle's last ten unknowns. */
static void beside(const mp_posed *posed, mp_real out[10]) {
    int i, first = posed->count - 10, size = posed->count + 1;
    for (i = 0; i < 10; i++) out[i] = posed->triangle[AT(size, first + i) + posed->count - first - i];
}

/* (10) one sigma of each of theta by the data alone. */
static void sigmas_of(const mp_posed *posed, mp_real out[10]) {
    mp_real inverse[10][10];
    int i, j;
    mp_inverse10(posed->triangle, posed->count + 1, posed->count - 10, inverse);
    for (i = 0; i < 10; i++) {
        mp_real sum = R(0);
        for (j = i; j < 10; j++) sum += inverse[i][j] * inverse[i][j];
        out[i] = posed->scale[i] * MP_SQRT(sum);
    }
}

/* Sigmas of theta, that of mu not beyond what a known mass leaves; where the log tells another, it is heard. */
static void weighed(const mp_vehicle *vehicle, const mp_real theta[10], mp_real sigma[10]) {
    if (MP_ON_BEARING(vehicle) && vehicle->known_mass > R(0))
        sigma[9] = mp_min(sigma[9], WEIGHED * mp_max(R(1) / vehicle->known_mass, theta[9]));
}

/* One sigma of each of theta before anything is known. */
static void scale_of(const mp_vehicle *vehicle, const mp_real theta[10], mp_real out[10]) {
    int i;
    mp_sizes(vehicle, theta, out);
    for (i = 0; i < 10; i++) out[i] *= vehicle->prior_scale;
    weighed(vehicle, theta, out);
}

void mp_judge(const mp_layout *layout, const mp_posed *posed, const mp_real *ordered, mp_real *rows, mp_real normalised[6],
              mp_real unexplained[6], mp_real spread[6][6]) {
    int count = posed->count, size = count + 1, i, j;
    mp_real columns[MP_UNKNOWNS][6];
    for (i = 0; i < 6; i++) {
        mp_real *row = rows + i * size;
        reduced(layout, posed, ordered + i * layout->width, 0, row);
        for (j = 0; j < count; j++) columns[j][i] = row[j];
        unexplained[i] = row[count];
    }
    mp_forward6(posed->triangle, size, count, columns);
    for (j = 0; j < count; j++) {
        mp_real right = posed->triangle[AT(size, j) + count - j];
        for (i = 0; i < 6; i++) unexplained[i] -= columns[j][i] * right;
    }
    mp_root6(columns, count, spread);
    for (i = 0; i < 6; i++) {
        mp_real sum = unexplained[i];
        for (j = 0; j < i; j++) sum -= spread[i][j] * normalised[j];
        normalised[i] = sum / spread[i][i];
    }
}

/* Where the search began draws what the data don't tell, by these sigmas. */
static void pulled(const mp_pass *pass, const mp_real theta[10], mp_real out[10]) {
    mp_real cg = MP_ON_BEARING(&pass->vehicle) ? BALANCED : R(1);
    int i;
    mp_sizes(&pass->vehicle, theta, out);
    for (i = 0; i < 10; i++) out[i] = mp_max(out[i], pass->centre_sizes[i]) * (i < 6 ? R(0.2) : i < 9 ? cg : R(1));
    weighed(&pass->vehicle, theta, out);
}

/* What 1/m, the last unknown of a triangle, is told by the data alone, where they tell it to better than `faint`, relative: both it and one
   sigma of what draws it to `drawn` are over a scale as small as itself, which would hold it down where a search began at a mass many times
   too large. The factor on the last of the triangle's diagonal, `own`; what stands right of it becomes what it would be. */
static mp_real freed(const mp_vehicle *vehicle, const mp_real theta[10], const mp_real scale[10], mp_real own, mp_real *right,
                     mp_real drawn, mp_real faint) {
    mp_real left = own * own - R(1), alone;
    if ((MP_ON_BEARING(vehicle) && vehicle->known_mass > R(0)) || !(left > ROUNDED)) return R(1);
    left = MP_SQRT(left);
    alone = *right * (own / left) - drawn / left;
    if (!(scale[9] < faint * (theta[9] * left + scale[9] * alone))) return R(1);
    *right = alone;
    return left / own;
}

void mp_pose(mp_pass *pass) {
    mp_real scale[10];
    scale_of(&pass->vehicle, pass->estimate.theta, scale);
    posed_of(&pass->vehicle, &pass->layout, &pass->run, pass->estimate.theta, scale, NULL, pass->run.bound, pass->room.rows, &pass->posed);
    pulled(pass, pass->estimate.theta, pass->pull);
}

/* Where the inertia I = J^-1 may be judged: theta by the data, near the centre where these don't tell. */
static void sensed(const mp_pass *pass, const mp_real step[10], mp_real covariance[10][10], mp_real out[10]) {
    const mp_real *theta = pass->posed.theta;
    mp_real pull[10], left[10], joint[100], sensible[10], mass = MP_ON_BEARING(&pass->vehicle) ? pass->vehicle.known_mass : R(0);
    mp_real mu = theta[9] + step[9], untold = MP_UNTOLD_MASS * mu;
    int i, j;
    memcpy(pull, pass->pull, sizeof pull);
    /* where the log doesn't tell the mass, the rest is judged beside the known one */
    if (mass > R(0)) {
        mp_real faint = MP_FAINT_MASS * mp_max(R(1) / mass, theta[9]);
        if (covariance[9][9] > faint * faint) pull[9] = EXACT / mass;
    } else if (mu > R(0) && covariance[9][9] < untold * untold) {
        pull[9] = mp_max(pull[9], mu); /* a search that began orders of magnitude away draws no mass that the log tells */
    }
    for (i = 0; i < 10; i++) {
        left[i] = (step[i] + theta[i] - pass->centre.theta[i]) / pull[i];
        for (j = 0; j < 10; j++) joint[10 * i + j] = covariance[i][j] / pull[i] / pull[j] + (i == j ? R(1) : R(0));
    }
    memcpy(sensible, step, sizeof sensible);
    if (mp_cholesky(joint, 10)) {
        mp_solved(joint, 10, left);
        for (i = 0; i < 10; i++) {
            mp_real sum = R(0);
            for (j = 0; j < 10; j++) sum += covariance[i][j] * (left[j] / pull[j]);
            sensible[i] = step[i] - sum;
        }
    }
    mp_nearest(theta, sensible, out);
}

/* Error of c or kappa, as its product with J is split about the reference: its own move, where another axis' J is faint. */
static void split(const mp_pass *pass, const mp_real theta[10], const mp_real sigma[10], mp_real out[10]) {
    mp_real relative[3];
    int i;
    for (i = 0; i < 10; i++) out[i] = R(0);
    if (MP_ON_PEDESTAL(&pass->vehicle)) return; /* what the accelerometer feels is linear in theta */
    for (i = 0; i < 3; i++) relative[i] = mp_min(sigma[MOMENTS[i]] / mp_max(theta[MOMENTS[i]], MP_TINY), R(1));
    for (i = 0; i < 3; i++)
        out[6 + i] = (theta[6 + i] - pass->reference.theta[6 + i]) * mp_max(relative[(i + 1) % 3], relative[(i + 2) % 3]);
}

/* A A^T, of an A with nothing left of where `first` says each row begins. */
static void outer10(mp_real a[10][10], const int first[10], mp_real out[10][10]) {
    int i, j, k;
    for (i = 0; i < 10; i++)
        for (j = 0; j <= i; j++) {
            mp_real sum = R(0);
            for (k = first[i]; k < 10; k++) sum += a[i][k] * a[j][k];
            out[i][j] = out[j][i] = sum;
        }
}

int mp_estimate(mp_pass *pass, mp_row *row) {
    const mp_posed *posed = &pass->posed;
    mp_real root[10][10], step[10], right[10], at[10], sigma[10], slopes[10][10], apart[10], moved[10][10], share;
    mp_real *mean = row->mean, (*covariance)[10] = row->covariance;
    int i, j, k;
    mp_inverse10(posed->triangle, posed->count + 1, posed->count - 10, root);
    beside(posed, right);
    share = posed->triangle[AT(posed->count + 1, posed->count - 1)];
    share = freed(&pass->vehicle, posed->theta, posed->scale, share, right + 9, R(0), CLEAR);
    for (i = 0; i < 10; i++) root[i][9] /= share;
    for (i = 0; i < 10; i++) {
        step[i] = R(0);
        for (j = 0; j < 10; j++) {
            root[i][j] *= posed->scale[i];
            step[i] += root[i][j] * right[j];
        }
    }
    outer10(root, UPPER, covariance);
    for (i = 0; i < 10; i++) sigma[i] = MP_SQRT(covariance[i][i]);
    sensed(pass, step, covariance, at);
    mp_slopes(&pass->vehicle, at, slopes);
    mp_parameters(&pass->vehicle, at, mean);
    split(pass, at, sigma, apart);
    for (i = 0; i < 10; i++)
        for (j = 0; j < 10; j++) mean[i] += slopes[i][j] * (posed->theta[j] + step[j] - at[j]);
    for (i = 0; i < 10; i++) {
        for (j = 0; j < 10; j++) moved[i][j] = R(0);
        for (k = 0; k < 10; k++) {
            if (slopes[i][k] == R(0)) continue;
            for (j = 0; j < 10; j++) moved[i][j] += slopes[i][k] * root[k][j];
        }
    }
    outer10(moved, STEEPENED, covariance);
    for (k = 6; k < 9; k++) {
        mp_real off[10];
        for (i = 0; i < 10; i++) off[i] = slopes[i][k] * apart[k];
        for (i = 0; i < 10; i++)
            for (j = 0; j < 10; j++) covariance[i][j] += off[i] * off[j];
    }
    for (i = 0; i < 3; i++) row->relative[i] = mp_min(sigma[MOMENTS[i]] / mp_max(at[MOMENTS[i]], MP_TINY), R(1e6));
    return mp_stale(pass, at, sigma, ASTRAY);
}

int mp_stale(const mp_pass *pass, const mp_real theta[10], const mp_real sigma[10], mp_real most) {
    mp_real scales[10], begun[10];
    int i, stale = 0;
    mp_scales(&pass->vehicle, theta, scales);
    mp_scales(&pass->vehicle, pass->reference.theta, begun);
    for (i = 0; i < 10; i++) {
        mp_real apart = theta[i] - pass->reference.theta[i];
        mp_real scale = i >= 6 && i < 9 && MP_ON_BEARING(&pass->vehicle) ? BALANCED * scales[i] : scales[i];
        /* what is small beside the reference is known to be so */
        stale |= sigma[i] < KNOWN * mp_max(scales[i], begun[i]) && apart * apart > most * sigma[i] * scale;
    }
    return stale;
}

/* What the accelerometer seems to tell of the CG by a steady torque that isn't the reference's, over what is known of it: of w' x c in the
   specific force, c is told by the reference's w'. */
static mp_real told_by_torque(const mp_pass *pass, const mp_real theta[10], const mp_real sigma[10]) {
    const mp_real *noise = pass->vehicle.accel_noise;
    mp_real widest = mp_max(sigma[6], mp_max(sigma[7], sigma[8])), turning = R(0);
    int i;
    if (MP_ON_PEDESTAL(&pass->vehicle)) return R(0);
    for (i = 0; i < 3; i++) {
        mp_real apart = pass->estimate.acceleration[i] - pass->reference.acceleration[i];
        turning += apart * apart;
    }
    if (MP_ON_BEARING(&pass->vehicle)) widest *= theta[9];
    widest /= mp_min(noise[0], mp_min(noise[1], noise[2]));
    return R(pass->run.at) * turning * (widest * widest);
}

int mp_stands(const mp_pass *pass) {
    const mp_posed *posed = &pass->posed;
    mp_real sigma[10], elapsed = pass->end_s - pass->begun_s;
    int i;
    for (i = 0; i < 3; i++) {
        mp_real apart = pass->estimate.bias[i] - pass->reference.bias[i];
        if (apart * apart * elapsed > STALE * pass->vehicle.gyro_noise) return 0;
    }
    sigmas_of(posed, sigma);
    return told_by_torque(pass, posed->theta, sigma) <= STALE && !mp_stale(pass, posed->theta, sigma, STALE);
}

/* What a search ended with. */
typedef struct {
    mp_real theta[10];
    mp_real beginnings[MP_BEGINNINGS];
    mp_real phi[MP_COEFFICIENTS];
    mp_real chi_square;
    int stuck;
} found;

/* The least step of 1/m over its scale. What doesn't tell it may want less than none, which must keep nothing else from moving. */
static mp_real lightest(const mp_pass *pass, const mp_real theta[10], mp_real scale, mp_real last, mp_real solved) {
    mp_real least = theta[9] / HEAVIER;
    if (!(theta[9] + scale * solved > scale / mp_abs(last))) least = mp_min(theta[9], mp_max(theta[9], pass->centre.theta[9]) / HEAVIER);
    return (least - theta[9]) / scale;
}

/* Square, in sigmas, of what is left of a step from where a triangle stands that was taken as far as it leads to a body. */
static mp_real wanted(const mp_posed *posed, const mp_real step[10], const mp_real theta[10]) {
    int count = posed->count, size = count + 1, i, j;
    mp_real square = R(0);
    for (i = 0; i < 10; i++) {
        const mp_real *own = posed->triangle + AT(size, count - 10 + i) - i;
        mp_real sum = R(0);
        for (j = i; j < 10; j++) sum += own[j] * ((step[j] - (theta[j] - posed->theta[j])) / posed->scale[j]);
        square += sum * sum;
    }
    return square;
}

/* Gauss-Newton on the triangle. */
static void searched(mp_pass *pass, const mp_run *run, const mp_real from[10], int bound, found *out) {
    const mp_layout *layout = &pass->layout;
    mp_posed *posed = &pass->room.posed;
    int count = nuisances(layout, bound) + 10, size = count + 1, again, i;
    mp_real solved[MP_UNKNOWNS], scale[10], step[10], right[10], moved, *last;
    memcpy(out->theta, from, sizeof out->theta);
    for (again = 0; again < STEPS; again++) {
        pulled(pass, out->theta, scale);
        posed_of(&pass->vehicle, layout, run, out->theta, scale, pass->centre.theta, bound, pass->room.rows, posed);
        last = posed->triangle + AT(size, count - 1);
        moved = (pass->centre.theta[9] - out->theta[9]) / scale[9];
        *last *= freed(&pass->vehicle, out->theta, scale, *last, last + 1, moved, MP_UNTOLD_MASS);
        for (i = 0; i < count; i++) solved[i] = posed->triangle[AT(size, i) + count - i];
        mp_back(posed->triangle, size, count - 1, 1, solved + count - 1);
        solved[count - 1] = mp_max(solved[count - 1], lightest(pass, out->theta, scale[9], *last, solved[count - 1]));
        for (i = 0; i < count - 1; i++) solved[i] -= posed->triangle[AT(size, i) + count - 1 - i] * solved[count - 1];
        mp_back(posed->triangle, size, 0, count - 1, solved);
        for (i = 0; i < 10; i++) step[i] = scale[i] * solved[count - 10 + i];
        mp_stepped(&pass->vehicle, out->theta, step);
        beside(posed, right);
        moved = R(0);
        for (i = 0; i < 10; i++) moved += right[i] * right[i];
        if (moved < STILL * STILL) break;
    }
    out->stuck = wanted(posed, step, out->theta) > STUCK * STUCK;
    for (i = 0; i < layout->beginnings; i++) out->beginnings[i] = solved[i];
    mp_coefficients(&pass->vehicle, out->theta, out->phi, NULL);
    if (!bound)
        for (i = 0; i < 18; i++)
            out->phi[coupling(layout, i)] = posed->phi[coupling(layout, i)] + LOOSE * solved[layout->beginnings + i];
    last = posed->triangle + AT(size, count);
    out->chi_square = *last * *last;
}

/* Whether the commands alone, without the gyroscopic coupling, tell each axis' response. */
static int each_axis_is_known(mp_pass *pass, const mp_run *run, const mp_real theta[10]) {
    mp_real scale[10], sigma[10];
    int i, known = 1;
    scale_of(&pass->vehicle, theta, scale);
    posed_of(&pass->vehicle, &pass->layout, run, theta, scale, NULL, run->bound, pass->room.rows, &pass->room.posed);
    sigmas_of(&pass->room.posed, sigma);
    for (i = 0; i < 3; i++) known &= sigma[MOMENTS[i]] < KNOWN * theta[MOMENTS[i]];
    return known;
}

/* So many states in the last cycle; as they were where there are none. */
static void state_of(const mp_layout *layout, const mp_run *run, int at, int count, const mp_real *phi, const mp_real *beginnings,
                     mp_real *out) {
    int i, c, n = layout->coefficients;
    if (at < 0 || !run->begun) return;
    for (i = 0; i < count; i++) {
        const mp_real *mean = run->filter.mean[at + i];
        out[i] = mean[0];
        for (c = 0; c < n; c++) out[i] += mean[1 + c] * phi[c];
        for (c = 0; c < layout->beginnings; c++) out[i] += mean[1 + n + c] * beginnings[c];
    }
}

/* The estimate by a search from `theta`, and chi-square of what that leaves. */
static mp_real improved(mp_pass *pass, mp_run *run, const mp_real theta[10]) {
    const mp_layout *layout = &pass->layout;
    found loose, tied;
    const found *best = &tied;
    mp_real bias[3], acceleration[3], scale[1 + MP_WHEELS], phi[MP_COEFFICIENTS];
    int bound = run->bound, free = !run->bound;
    if (free) {
        searched(pass, run, theta, 0, &loose);
        bound = each_axis_is_known(pass, run, loose.theta);
    }
    searched(pass, run, free ? loose.theta : theta, 1, &tied);
    if (free && !bound && !(tied.chi_square < loose.chi_square + INCONSISTENT)) best = &loose;
    memcpy(bias, pass->reference.bias, sizeof bias);
    memcpy(acceleration, pass->reference.acceleration, sizeof acceleration);
    memcpy(scale, pass->reference.scale, sizeof scale);
    mp_coefficients(&pass->vehicle, best->theta, phi, NULL);
    state_of(layout, run, layout->at_bias, 3, phi, best->beginnings, bias);
    /* until commands alone tell each axis, a steady torque may be anything; on a bearing the weight that it holds up may be as much */
    if (bound || MP_ON_BEARING(&pass->vehicle)) state_of(layout, run, layout->at_torque, 3, phi, best->beginnings, acceleration);
    mp_body(&pass->vehicle, best->theta, bias, acceleration, best == &loose ? loose.phi : NULL, &pass->estimate);
    state_of(layout, run, layout->at_scale, layout->scales, phi, best->beginnings, scale);
    memcpy(pass->estimate.scale, scale, sizeof scale);
    run->bound = bound;
    run->stuck = best->stuck;
    return best->chi_square;
}

void mp_improve(mp_pass *pass, mp_run *run) {
    int bound = run->bound, first;
    mp_real chi_square = improved(pass, run, pass->estimate.theta);
    mp_reference estimate;
    if (!run->stuck) return;
    /* a search that is stuck begins anew */
    estimate = pass->estimate;
    first = run->bound;
    run->bound = bound;
    if (improved(pass, run, pass->centre.theta) < chi_square) return;
    pass->estimate = estimate;
    run->bound = first;
    run->stuck = 1;
}
