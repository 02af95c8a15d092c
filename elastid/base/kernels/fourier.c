/* DFT of real signals for `fourier.py`: LANES signals side by side, two samples of each as a complex number.  The first
   sample is subtracted, so that the DFT of a constant is exactly zero at all lines except 0. */

#include "lanes.h"

#define MOST 16 /* above all factors */

static inline number sum(number a, double sign, number b) {
    number c = {a.re + sign * b.re, a.im + sign * b.im};
    return c;
}

static inline number turned(number a, const double *w) {
    number c = {a.re * w[0] - a.im * w[1], a.re * w[1] + a.im * w[0]};
    return c;
}

/* Replace each column j of Z (r, m) by its DFT, row p times exp(-2 pi i p j / (r m)).  roots: exp(-2 pi i k / N);
   of_r: exp(-2 pi i k / r).  Rows q and r - q are combined to halve the multiplications. */
static inline __attribute__((always_inline)) void stage(int64_t r, int64_t m, int64_t N, const double *roots,
                                                        const double *of_r, number *Z) {
    for (int64_t j = 0; j < m; j++, Z++) {
        number first = Z[0], half = Z[r / 2 * m], even[MOST], odd[MOST];
        for (int64_t q = 1; 2 * q < r; q++) {
            even[q] = sum(Z[q * m], 1.0, Z[(r - q) * m]);
            odd[q] = sum(Z[q * m], -1.0, Z[(r - q) * m]);
        }
        for (int64_t p = 0; 2 * p <= r; p++) {
            number a = r % 2 ? first : sum(first, p % 2 ? -1.0 : 1.0, half), b = {{0}, {0}};
            for (int64_t q = 1; 2 * q < r; q++) {
                const double *w = of_r + 2 * (p * q % r);
                a = sum(a, w[0], even[q]);
                b.re -= w[1] * odd[q].im;
                b.im += w[1] * odd[q].re;
            }
            Z[p * m] = turned(sum(a, 1.0, b), roots + 2 * (p * j * (N / (r * m))));
            if (p && 2 * p < r)
                Z[(r - p) * m] = turned(sum(a, -1.0, b), roots + 2 * ((r - p) * j * (N / (r * m))));
        }
    }
}

/* Compute the DFT of Z (n,) in place by decimation in frequency; the lines end in digit-reversed order. */
static void transform(int64_t n, int64_t N, const int64_t *factors, const double *roots, const double *of_r,
                      number *Z) {
    int64_t r = *factors, m = n / r;
#define CASE(factor)                                                                                                   \
    if (r == factor)                                                                                                   \
        stage(factor, m, N, roots, of_r, Z);                                                                           \
    else
    CASE(8) CASE(4) CASE(2) CASE(3) CASE(5) stage(r, m, N, roots, of_r, Z);
    for (int64_t p = 0; m > 1 && p < r; p++)
        transform(m, N, factors + 1, roots, of_r + 2 * r, Z + p * m);
}

/* Write the DFT of n signals at lines (F,) to addresses `to` (n,).  A signal has N samples at address `from` (n,), each
   `apart` numbers after the one before.  place (N / 2 + 1,): digit-reversed position of each line. */
KERNEL(real_dft)(int64_t N, int64_t n, int64_t F, int64_t apart, const int64_t *from, const int64_t *to,
             const int64_t *lines, const int64_t *factors, const int64_t *place, const double *roots) {
    int64_t H = N / 2;
    number *Z = zeros(H);
    if (!Z)
        return 1;
    for (int64_t first = 0; first < n; first += LANES) {
        const double *x[LANES];
        double *X[LANES];
        lanes start;
        for (int64_t q = 0; q < LANES; q++) { /* unused lanes repeat the first signal of the group */
            int64_t signal = first + q < n ? first + q : first;
            x[q] = (const double *)(intptr_t)from[signal];
            X[q] = (double *)(intptr_t)to[signal];
        }
        for (int64_t q = 0; q < LANES; q++)
            start[q] = *x[q];
        for (int64_t i = 0; i < H; i++) {
            lanes re, im;
            for (int64_t q = 0; q < LANES; q++) {
                re[q] = x[q][2 * i * apart];
                im[q] = x[q][(2 * i + 1) * apart];
            }
            Z[i] = (number){re - start, im - start};
        }
        transform(H, N, factors, roots, roots + 2 * N, Z);
        for (int64_t f = 0; f < F; f++) {
            number a = Z[place[lines[f]]], b = Z[place[H - lines[f]]];
            b.im = -b.im;
            number odd = turned(sum(a, -1.0, b), roots + 2 * lines[f]);
            a = sum(a, 1.0, b);
            a.re = 0.5 * (a.re + odd.im) + (lines[f] ? 0 : (double)N) * start;
            a.im = 0.5 * (a.im - odd.re);
            for (int64_t q = 0; q < LANES; q++)
                X[q][2 * f] = a.re[q], X[q][2 * f + 1] = a.im[q];
        }
    }
    release(Z);
    return 0;
}
