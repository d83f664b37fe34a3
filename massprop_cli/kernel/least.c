/* What the body that fits a triangle on phi best leaves of it, of many triangles, for the ground (massprop_cli/diagnosis/change.py). */
#include <math.h>
#include <string.h>

#include "host.h"
#include "lift.h"
#include "small.h"

SHARED int mp_host_least(const double *table, const double *theta, long count, long most, double still, const double *triangles,
                         double *out);

/* Chi-square that theta leaves of a triangle (size + 1, size + 1), upper, the last column what was measured. */
static mp_real left_of(const double *triangle, int size, const mp_real *phi) {
    mp_real total = R(0);
    int r, k;
    for (r = 0; r <= size; r++) {
        const double *row = triangle + r * (size + 1);
        mp_real left = (mp_real)row[size];
        for (k = r; k < size; k++) left -= (mp_real)row[k] * phi[k];
        total += left * left;
    }
    return total;
}

/* One step from theta, held back by the body's own size; the square of what it wants, in sigmas. */
static mp_real stepped(const mp_vehicle *vehicle, const double *triangle, int size, mp_real theta[10]) {
    mp_real phi[MP_COEFFICIENTS], slopes[MP_COEFFICIENTS][10], scale[10], rows[(MP_COEFFICIENTS + 1) * 11], upper[MP_PACKED(11)];
    mp_real step[10], wanted = R(0);
    int i, k, r;
    mp_coefficients(vehicle, theta, phi, slopes);
    mp_sizes(vehicle, theta, scale);
    for (k = 0; k < size; k++)
        for (i = 0; i < 10; i++) slopes[k][i] *= scale[i];
    for (r = 0; r <= size; r++) {
        const double *row = triangle + r * (size + 1);
        mp_real *made = rows + r * 11;
        for (i = 0; i < 10; i++) made[i] = R(0);
        made[10] = (mp_real)row[size];
        for (k = r; k < size; k++) {
            mp_real by = (mp_real)row[k];
            made[10] -= by * phi[k];
            for (i = 0; i < 10; i++) made[i] += by * slopes[k][i];
        }
    }
    memset(upper, 0, sizeof upper);
    for (i = 0; i < 10; i++) upper[AT(11, i)] = R(1);
    mp_fold(upper, 11, rows, size + 1);
    for (i = 0; i < 10; i++) {
        step[i] = upper[AT(11, i) + 10 - i];
        wanted += step[i] * step[i];
    }
    mp_back(upper, 11, 0, 10, step);
    for (i = 0; i < 10; i++) step[i] *= scale[i];
    mp_stepped(vehicle, theta, step);
    return wanted;
}

/* Gauss and Newton from `theta` (10) on each of the triangles, of `most` steps at most, until one wants less than `still` sigmas. */
int mp_host_least(const double *table, const double *theta, long count, long most, double still, const double *triangles, double *out) {
    mp_vehicle vehicle = mp_vehicle_of(table);
    int size = 3 * (vehicle.bearing ? 15 : 12) + 4;
    long k, again;
    for (k = 0; k < count; k++) {
        const double *own = triangles + k * (size + 1) * (size + 1);
        mp_real at[10], phi[MP_COEFFICIENTS];
        (void)mp_copied(at, theta, 10);
        for (again = 0; again < most; again++)
            if (stepped(&vehicle, own, size, at) < (mp_real)(still * still)) break;
        mp_coefficients(&vehicle, at, phi, NULL);
        out[k] = (double)left_of(own, size, phi);
    }
    return MP_OK;
}
