/* Small dense linear algebra. Matrices are by rows; a packed triangle holds its rows from the diagonal on. */
#ifndef MASSPROP_LINALG_H
#define MASSPROP_LINALG_H

#include "massprop.h"

#define R(x) ((mp_real)(x))
#define TERMS 16 /* of the series of sine and cosine: exact to rounding up to six radians */
#define AT(size, row) ((row) * (size) - (row) * ((row) - 1) / 2) /* where a row of a packed triangle begins */

int mp_finite(const mp_real *v, int count);
static inline mp_real mp_max(mp_real a, mp_real b) { return a > b ? a : b; }
static inline mp_real mp_min(mp_real a, mp_real b) { return a < b ? a : b; }
static inline mp_real mp_abs(mp_real a) { return a < R(0) ? -a : a; }
static inline mp_real mp_dot(const mp_real a[3], const mp_real b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
void mp_cross(const mp_real a[3], const mp_real b[3], mp_real out[3]);
void mp_cross_matrix(const mp_real v[3], mp_real out[3][3]);
void mp_times(const mp_real a[3][3], const mp_real v[3], mp_real out[3]);
void mp_product(const mp_real a[3][3], const mp_real b[3][3], mp_real out[3][3]);
void mp_inverse(const mp_real a[3][3], mp_real out[3][3]);
/* The rotation by a vector, and the mean of the rotations by s times it, 0 < s < 1. */
void mp_rotations(const mp_real vector[3], mp_real whole[3][3], mp_real mean[3][3]);
void mp_tensor(const mp_real six[6], mp_real out[3][3]);
/* The part of a vector across `up`, of length one. */
void mp_level(const mp_real up[3], const mp_real v[3], mp_real out[3]);
void mp_elements(const mp_real a[3][3], mp_real six[6]);
/* Eigenvalues, ascending, and eigenvectors by columns of a symmetric matrix (Jacobi). */
void mp_eigen(const mp_real a[3][3], mp_real values[3], mp_real axes[3][3]);
/* Lower root of a symmetric positive matrix (n, n); 0 where it isn't positive. */
int mp_cholesky(mp_real *a, int n);
/* b becomes A^-1 b, of the root that mp_cholesky left in a. */
void mp_solved(const mp_real *a, int n, mp_real *b);
/* Rows (count, size), overwritten, folded into a packed triangle. */
void mp_fold(mp_real *triangle, int size, mp_real *rows, int count);
/* A (rows, columns) times an orthogonal matrix that makes it lower triangular with a positive diagonal, in place. */
void mp_lower(mp_real *a, int rows, int columns);
/* T x = b by the first n rows and columns of a packed triangle, in place; by its rows and columns from `first` on. */
void mp_back(const mp_real *triangle, int size, int first, int n, mp_real *b);
/* Lower root (6, 6), with a positive diagonal, of 1 + A^T A for an A (n, 6), which is overwritten. */
void mp_root6(mp_real (*a)[6], int n, mp_real out[6][6]);
/* x T = a for six rows a, given by columns (n, 6), in place. */
void mp_forward6(const mp_real *triangle, int size, int n, mp_real (*a)[6]);
/* Inverse (10, 10) of the block of a packed triangle that begins at row and column `first`. */
void mp_inverse10(const mp_real *triangle, int size, int first, mp_real out[10][10]);

#endif
