#include "verdict.h"

#include <math.h>
#include <string.h>

#include "linalg.h"

#define HARDLY R(0.4)  /* relative sigma of J up to which that of I = 1/J is taken from the interval of two sigma */
#define PRIOR R(0.5)   /* prior sigma over the natural size */
#define HALVED R(0.5)  /* a quantity is informed once its sigma is below this part of the prior's */
#define SURE R(0.1)    /* a sigma below this part of the tolerance makes up for steady updates that are missing, */
#define BEGUN 4        /* but for this part of their number */
#define LATEST 256     /* each cycle counts 1/LATEST less than the next in the mean square of the innovations, */
#define LOUDEST R(25)  /* no one of which counts more than this, */
#define AS_STATED 16   /* after so many that are taken to be as stated; */
#define MISFIT R(1.5)  /* beyond this model and flight contradict each other: noise is stated 1.22 times too small, or more */

static const int MOMENTS[3] = {0, 3, 5}, FIRST[6] = {0, 0, 0, 1, 1, 2}, SECOND[6] = {0, 1, 2, 1, 2, 2};

/* Conditioned on one quantity measured elsewhere; `data`: the part of the covariance that the log's noise makes. */
static void condition(mp_real value[10], mp_real covariance[10][10], mp_real data[10][10], int index, mp_real measured, mp_real variance) {
    mp_real column[10], gain[10], off = measured - value[index];
    int i, j;
    for (i = 0; i < 10; i++) column[i] = covariance[i][index];
    for (i = 0; i < 10; i++) gain[i] = column[i] / (column[index] + variance);
    for (i = 0; i < 10; i++) {
        value[i] += gain[i] * off;
        for (j = 0; j < 10; j++) covariance[i][j] -= gain[i] * column[j];
    }
    if (data == NULL) return;
    for (j = 0; j < 10; j++) column[j] = data[index][j];
    for (i = 0; i < 10; i++)
        for (j = 0; j < 10; j++) data[i][j] -= gain[i] * column[j];
    for (i = 0; i < 10; i++) column[i] = data[i][index];
    for (i = 0; i < 10; i++)
        for (j = 0; j < 10; j++) data[i][j] -= column[i] * gain[j];
}

/* Takes a quantity that the row can't say anything of as it is. */
static void taken(mp_values *out, mp_real data[10][10], int index, mp_real value, mp_real variance) {
    int i;
    for (i = 0; i < 10; i++) {
        out->covariance[index][i] = out->covariance[i][index] = R(0);
        data[index][i] = data[i][index] = R(0);
    }
    out->value[index] = value;
    out->covariance[index][index] = variance;
    out->told[index] = 1;
}

/* By how much wider the sigmas of I = J^-1 are than its slope makes them. */
static void curved(const mp_real relative[3], mp_real wider[10]) {
    mp_real factor[3];
    int i;
    for (i = 0; i < 3; i++) {
        mp_real near = R(1) / (R(1) - R(2) * mp_min(relative[i], HARDLY)), far = relative[i] / HARDLY;
        factor[i] = MP_SQRT(mp_max(near, near * (far * far)));
    }
    for (i = 0; i < 10; i++) wider[i] = i < 6 ? factor[FIRST[i]] * factor[SECOND[i]] : R(1);
}

/* A step of the ten quantities from `before`, straight in the first moment (m - bearing mass) (c - bearing) instead of in c; of a covariance
   with it the rows and columns of c. */
static void by_first_moment(mp_real bearing_mass, const mp_real before[10], mp_real after[10], mp_real covariance[10][10],
                            mp_real data[10][10]) {
    mp_real later = after[9] - bearing_mass, part = (before[9] - bearing_mass) / later, by_mass[3];
    mp_real(*each[2])[10] = {covariance, data};
    int i, j, k;
    if (!(before[9] > bearing_mass) || !(later > R(0))) return;
    for (i = 0; i < 3; i++) {
        mp_real moved = part * (after[6 + i] - before[6 + i]);
        after[6 + i] = before[6 + i] + moved;
        by_mass[i] = -moved / later;
    }
    for (k = 0; k < 2; k++)
        for (j = 0; j < 10; j++)
            for (i = 0; i < 3; i++) each[k][6 + i][j] = part * each[k][6 + i][j] + by_mass[i] * each[k][9][j];
    for (k = 0; k < 2; k++)
        for (j = 0; j < 10; j++)
            for (i = 0; i < 3; i++) each[k][j][6 + i] = part * each[k][j][6 + i] + by_mass[i] * each[k][j][9];
}

/* Conditioned on all that is known from elsewhere, and then wider where I is curved: an axis is no more uncertain than what is known
   leaves it. `data`: the part of the covariance that the log's noise makes. */
static void finished(const mp_rule *rule, const mp_vehicle *vehicle, const mp_row *row, mp_real data[10][10], mp_values *out) {
    mp_real relative[3], before[3], wider[10], stated[10];
    int i, j;
    for (i = 0; i < 3; i++) before[i] = mp_max(data[MOMENTS[i]][MOMENTS[i]], MP_TINY);
    for (i = 0; i < rule->known; i++) {
        mp_real variance = rule->known_sigma[i] * rule->known_sigma[i];
        int index = rule->known_index[i];
        memcpy(stated, out->value, sizeof stated);
        if (!out->told[index]) {
            taken(out, data, index, rule->known_value[i], variance);
            continue;
        }
        condition(out->value, out->covariance, data, index, rule->known_value[i], variance);
        if (MP_ON_BEARING(vehicle) && out->told[9] && (index < 6 || index > 8))
            by_first_moment(vehicle->bearing_mass, stated, out->value, out->covariance, data);
    }
    for (i = 0; i < 3; i++) relative[i] = row->relative[i] * MP_SQRT(mp_max(data[MOMENTS[i]][MOMENTS[i]] / before[i], R(0)));
    curved(relative, wider);
    for (i = 0; i < 10; i++)
        for (j = 0; j < 10; j++) out->covariance[i][j] += data[i][j] * (wider[i] * wider[j] - R(1));
}

static void quantities(const mp_rule *rule, const mp_vehicle *vehicle, const mp_row *from, mp_values *out) {
    mp_row row = *from;
    mp_real mu = row.mean[9], slope[10], part[10], data[10][10], scale = vehicle->wheels > 0 ? R(0) : rule->thrust_sigma * rule->thrust_sigma;
    int i, j, known = -1, weighed, pedestal = MP_ON_PEDESTAL(vehicle);
    for (i = 0; i < rule->known; i++)
        if (rule->known_index[i] == 9) known = i;
    weighed = !pedestal && mu > R(0) && !(MP_SQRT(row.covariance[9][9]) > (MP_ON_BEARING(vehicle) && known >= 0 ? MP_FAINT_MASS : MP_UNTOLD_MASS) * mu);
    if (!weighed && known >= 0) { /* inertia and CG are linear in its reciprocal */
        mp_real mass = rule->known_value[known], relative = rule->known_sigma[known] / mass;
        condition(row.mean, row.covariance, NULL, 9, R(1) / mass, (relative * relative + scale) / (mass * mass));
    }
    for (i = 0; i < 10; i++) {
        out->told[i] = i < 6 || weighed || (i < 9 && (!MP_SLIDES(vehicle) || known >= 0));
        out->value[i] = i < 9 ? row.mean[i] : weighed ? R(1) / mu : R(0);
        slope[i] = i < 9 ? R(1) : weighed ? R(-1) / (mu * mu) : R(0);
        if (i < 6 && vehicle->wheels > 0) out->value[i] -= rule->beyond[i];
        if (i >= 6 && i < 9 && pedestal) {
            slope[i] = R(1) / mu;
            out->value[i] = (row.mean[i] - vehicle->centre[i - 6]) * slope[i];
        }
        part[i] = i >= 6 && i < 9 && !pedestal ? R(0) : out->value[i];
    }
    /* what of the mass doesn't turn isn't proportional to the thrust */
    if (MP_ON_BEARING(vehicle) && weighed && out->value[9] > vehicle->bearing_mass)
        for (i = 0; i < 3; i++)
            part[6 + i] = (vehicle->centre[i] - out->value[6 + i]) * (vehicle->bearing_mass / (out->value[9] - vehicle->bearing_mass));
    for (i = 0; i < 10; i++)
        for (j = 0; j < 10; j++) {
            data[i][j] = row.covariance[i][j] * slope[i] * slope[j];
            out->covariance[i][j] = data[i][j] + scale * part[i] * part[j];
        }
    finished(rule, vehicle, &row, data, out);
    for (i = 0; i < 10; i++) out->sigma[i] = out->told[i] ? MP_SQRT(out->covariance[i][i]) : R(0);
}

/* Running mean square of the normalised innovations of gyro or accelerometer, whichever is larger, where that is beyond chance; else 1. */
static mp_real excess(const mp_row *row, mp_steady *steady) {
    mp_real most = R(1);
    int i, sensor;
    for (sensor = 0; sensor < 2; sensor++) {
        mp_real square = R(0);
        if (steady->counted[sensor] == 0) {
            steady->counted[sensor] = AS_STATED;
            steady->misfit[sensor] = R(1);
        }
        if (row->expected[sensor]) {
            for (i = 0; i < 3; i++) square += row->normalised[3 * sensor + i] * row->normalised[3 * sensor + i];
            if (steady->counted[sensor] < LATEST) steady->counted[sensor] += 1;
            steady->misfit[sensor] += (mp_min(square / R(3), LOUDEST) - steady->misfit[sensor]) / R(steady->counted[sensor]);
        }
        if (steady->misfit[sensor] > MISFIT) most = mp_max(most, steady->misfit[sensor]);
    }
    return most;
}

/* What the innovations show beyond the stated noise goes into every sigma. */
static void widened(mp_real ratio, mp_values *out) {
    mp_real factor = MP_SQRT(ratio);
    int i, j;
    for (i = 0; i < 10; i++) {
        out->sigma[i] *= factor;
        for (j = 0; j < 10; j++) out->covariance[i][j] *= ratio;
    }
}

/* Where forces beyond any vehicle's have left no number, nothing is told. */
static void checked(mp_values *out) {
    int i;
    for (i = 0; i < 10; i++) {
        if (mp_finite(&out->value[i], 1) && mp_finite(&out->sigma[i], 1)) continue;
        out->told[i] = 0;
        out->value[i] = out->sigma[i] = R(0);
    }
}

void mp_report(const mp_rule *rule, const mp_pass *pass, const mp_row *row, mp_steady *steady, mp_values *out) {
    mp_real trace = pass->estimate.inertia[0][0] + pass->estimate.inertia[1][1] + pass->estimate.inertia[2][2];
    mp_real ratio;
    int i;
    memset(out, 0, sizeof *out);
    if (!row->told) {
        memset(steady, 0, sizeof *steady);
        return;
    }
    quantities(rule, &pass->vehicle, row, out);
    ratio = excess(row, steady);
    if (ratio > R(1)) widened(ratio, out);
    checked(out);
    for (i = 0; i < 10; i++) {
        mp_real moment = i >= 6 && i < 9 && MP_ON_PEDESTAL(&pass->vehicle) ? R(1) / pass->estimate.mu : R(1); /* for a metre of the CG */
        mp_real size = i < 6 ? trace : i < 9 ? MP_SQRT(trace * pass->estimate.mu) * moment : R(1) / pass->estimate.mu;
        mp_real tolerance = rule->tolerance[i < 6 ? 0 : i < 9 ? 1 : 2] * (rule->relative ? size : moment);
        mp_real prior = i == 0 || i == 3 || i == 5 || i == 9 ? mp_min(size, out->value[i]) : size;
        int informed = out->told[i] && out->sigma[i] < HALVED * (PRIOR * prior);
        int still = steady->told[i] && out->told[i] && mp_abs(out->value[i] - steady->value[i]) <= tolerance;
        steady->steady[i] = !(informed && still) ? 0 : steady->steady[i] < rule->count ? steady->steady[i] + 1 : rule->count;
        steady->told[i] = out->told[i];
        steady->value[i] = out->value[i];
        if (!out->told[i]) continue;
        out->verdict[i] = !informed ? MP_NOT_EXCITED : MP_NOT_CONVERGED;
        if (steady->steady[i] == rule->count) out->verdict[i] = MP_CONVERGED;
        if (informed && out->sigma[i] < SURE * tolerance && steady->steady[i] * BEGUN >= rule->count) out->verdict[i] = MP_CONVERGED;
        if (ratio > R(1)) out->verdict[i] = MP_CONTRADICTED;
    }
}
