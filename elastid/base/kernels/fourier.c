/* DFT of real signals for `fourier.py`: LANES signals side by side, two samples of each as one complex number.  The first
   sample is subtracted, so that a constant has zeros at all lines but 0. */

#include "lanes.h"

#define MOST 16 /* factors are smaller */

static inline number sum(number a, double sign, number b) {
    number c = {a.re + sign * b.re, a.im + sign * b.im};
    return c;
}

static inline number turned(number a, const double *w) {
    number c = {a.re * w[0] - a.im * w[1], a.re * w[1] + a.im * w[0]};
    return c;
}

/* Rows of Z (r, m) become the DFT of r numbers, row p times exp(-2 pi i p j / (r m)); roots: exp(-2 pi i k / N), then
   those of r.  Numbers q and r - q are taken together. */
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

/* The DFT of Z (n,) by decimation in frequency, in the order of its factors. */
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

/* DFT at lines (F,) of n signals of N samples `apart` at addresses `from` (n,) to F numbers at `to` (n,); place (N / 2 + 1,):
   of each number in the order of factors. */
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
        for (int64_t q = 0; q < LANES; q++) { /* lanes left over do the work of the first once more */
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
