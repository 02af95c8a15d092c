/* L D L^T of all lines, several side by side in a vector register; arithmetic and order as `linear/response/kernel.py` says. */

#include "lanes.h"

/* Z = K + j w D - w^2 M and X = B; later[i]: the columns behind the diagonal where row i is not zero. */
static void assemble(int64_t n, int64_t m, const double *M, const double *D, const double *K, const double *B,
                     lanes w, const int64_t *later, const int64_t *many, number *Z, number *X) {
    lanes zero = {0};
    for (int64_t i = 0; i < n; i++) {
        for (int64_t a = -1; a < many[i]; a++) {
            int64_t j = a < 0 ? i : later[i * n + a], at = i * n + j;
            Z[at].re = K[at] - w * w * M[at];
            Z[at].im = w * D[at];
        }
        for (int64_t j = 0; j < m; j++) {
            X[i * m + j].re = zero + B[i * m + j];
            X[i * m + j].im = zero;
        }
    }
}

/* Row k taken from the rows behind it, and from their right sides; P: 1 / pivot. */
static void eliminate_row(int64_t n, int64_t m, int64_t k, number P, const int64_t *later, const int64_t *many,
                          const unsigned char *reached, number *Z, number *X) {
    const int64_t *of = later + k * n;
    for (int64_t a = 0; a < many[k]; a++) {
        int64_t i = of[a];
        number share = product(Z[k * n + i], P);
        for (int64_t b = a; b < many[k]; b++)
            less_product(&Z[i * n + of[b]], share, Z[k * n + of[b]]);
        for (int64_t j = 0; j < m; j++)
            if (reached[k * m + j])
                less_product(&X[i * m + j], share, X[k * m + j]);
    }
}

static void substitute(int64_t n, int64_t m, const int64_t *later, const int64_t *many, const number *Z,
                       const number *P, number *X) {
    for (int64_t k = n - 1; k >= 0; k--)
        for (int64_t j = 0; j < m; j++) {
            number x = X[k * m + j];
            for (int64_t a = 0; a < many[k]; a++) {
                int64_t i = later[k * n + a];
                less_product(&x, Z[k * n + i], X[i * m + j]);
            }
            X[k * m + j] = product(x, P[k]);
        }
}

/* Which rows of Y (n, n_d) are not zero in each column (n_d, n), and how many. */
static void sparse(int64_t n, int64_t n_d, const double *Y, int64_t *rows, int64_t *how_many) {
    for (int64_t d = 0; d < n_d; d++) {
        how_many[d] = 0;
        for (int64_t i = 0; i < n; i++)
            if (Y[i * n_d + d] != 0.0)
                rows[d * n + how_many[d]++] = i;
    }
}

/* Y^T X of `used` lines to found (n_d, m, F), from a line on. */
static void gather(int64_t n, int64_t m, int64_t n_d, const number *X, const double *Y, const int64_t *rows,
                   const int64_t *how_many, int64_t F, int64_t used, double *found) {
    for (int64_t d = 0; d < n_d; d++)
        for (int64_t j = 0; j < m; j++, found += 2 * F) {
            number sum = {{0}, {0}};
            for (int64_t a = 0; a < how_many[d]; a++) {
                int64_t i = rows[d * n + a];
                sum.re += Y[i * n_d + d] * X[i * m + j].re;
                sum.im += Y[i * n_d + d] * X[i * m + j].im;
            }
            store(sum, used, found);
        }
}

/* Where L^-1 B is not zero (n, m). */
static void reach(int64_t n, int64_t m, const double *B, const int64_t *later, const int64_t *many,
                  unsigned char *reached) {
    for (int64_t at = 0; at < n * m; at++)
        reached[at] = B[at] != 0.0;
    for (int64_t k = 0; k < n; k++)
        for (int64_t a = 0; a < many[k]; a++)
            for (int64_t j = 0; j < m; j++)
                reached[later[k * n + a] * m + j] |= reached[k * m + j];
}

/* The loops of `Elimination.products`; 0, or 1 where there is no memory. */
KERNEL(eliminate)(int64_t F, int64_t n, int64_t m, int64_t n_d, const double *M, const double *D, const double *K,
              const double *B, const double *omega, const int64_t *later, const int64_t *many, const double *Y,
              double *found, double *smallest) {
    number *Z = allocate((size_t)(n * n + 2 * n * m + n + n_d * (n + 1)) * sizeof(number));
    if (!Z)
        return 1;
    number *X = Z + n * n, *P = X + n * m;
    int64_t *rows = (int64_t *)(P + n), *how_many = rows + n_d * n;
    unsigned char *reached = (unsigned char *)(how_many + n_d);
    sparse(n, n_d, Y, rows, how_many);
    reach(n, m, B, later, many, reached);
    for (int64_t start = 0; start < F; start += LANES) {
        int64_t used = F - start < LANES ? F - start : LANES;
        lanes w;
        for (int64_t q = 0; q < LANES; q++) {
            w[q] = omega[q < used ? start + q : F - 1];
            smallest[q < used ? start + q : F - 1] = 1.0 / 0.0;
        }
        assemble(n, m, M, D, K, B, w, later, many, Z, X);
        for (int64_t k = 0; k < n; k++) {
            number pivot = Z[k * n + k];
            double stiff = __builtin_fabs(K[k * n + k]), heavy = __builtin_fabs(M[k * n + k]);
            lanes square = pivot.re * pivot.re + pivot.im * pivot.im, size = stiff + w * w * heavy;
            lanes share = square / (size * size);
            for (int64_t q = 0; q < used; q++)
                if (!(share[q] >= smallest[start + q])) /* NaN, too */
                    smallest[start + q] = share[q];
            P[k].re = pivot.re / square;
            P[k].im = -pivot.im / square;
            eliminate_row(n, m, k, P[k], later, many, reached, Z, X);
        }
        substitute(n, m, later, many, Z, P, X);
        gather(n, m, n_d, X, Y, rows, how_many, F, used, found + 2 * start);
    }
    release(Z);
    return 0;
}
