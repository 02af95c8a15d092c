/* Residuals and sums over lines of `line_loops.py`, BATCH lines side by side, real and imaginary parts apart. */

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#ifndef REAL
#define REAL double
#endif
/* As many columns and rows at once as the registers hold. */
#if defined(__AVX512F__)
#define WIDTH 64
#define TILE 3
#elif defined(__AVX__)
#define WIDTH 32
#define TILE 2
#else
#define WIDTH 16
#define TILE 2
#endif
#define BATCH 16
#define LANES ((int64_t)(WIDTH / sizeof(REAL)))
#define POWERS 5

typedef REAL lanes __attribute__((vector_size(WIDTH)));
typedef struct {
    lanes re, im;
} number;

static int64_t first_of_row(int64_t e, int64_t n_e, int64_t is_diagonal) {
    return is_diagonal ? e : e * n_e - e * (e - 1) / 2;
}

/* Some complex numbers of `used` lines (lines, many) to lanes; the lanes left over are zero. */
static void spread(const double *from, int64_t many, int64_t used, number *to) {
    memset(to, 0, (size_t)many * sizeof(number));
    for (int64_t q = 0; q < used; q++)
        for (int64_t i = 0; i < many; i++) {
            to[i].re[q] = (REAL)from[2 * (q * many + i)];
            to[i].im[q] = (REAL)from[2 * (q * many + i) + 1];
        }
}

/* The lanes from `lane` on of R (n_r, 2, BATCH). */
static void take(const double *R, int64_t n_r, int64_t lane, number *T) {
    for (int64_t t = 0; t < n_r; t++)
        for (int64_t q = 0; q < LANES; q++) {
            T[t].re[q] = (REAL)R[2 * BATCH * t + lane + q];
            T[t].im[q] = (REAL)R[2 * BATCH * t + BATCH + lane + q];
        }
}

static inline void add_product(number *x, number a, number b) {
    x->re = x->re + a.re * b.re - a.im * b.im;
    x->im = x->im + a.re * b.im + a.im * b.re;
}

/* conj(a) b */
static inline void add_inner(number *x, number a, number b) {
    x->re = x->re + a.re * b.re + a.im * b.im;
    x->im = x->im + a.re * b.im - a.im * b.re;
}

/* U (n_b, n_e): gain factor left right^T of each base of rank one, then the whole columns; times slope. */
static void columns(int64_t n_y, int64_t n_1, int64_t n_2, int64_t n_e, const double *factor,
                    const int64_t *outputs, const int64_t *inputs, const number *left, const number *right, const number *gain,
                    const number *whole, const number *slope, number *U) {
    for (int64_t b = 0; b < n_1; b++) {
        number scaled[n_y];
        lanes size = (lanes){0} + (REAL)factor[b];
        for (int64_t i = 0; i < n_y; i++) {
            number y = left[i * n_1 + b], none = {{0}, {0}};
            scaled[i] = none;
            add_product(&scaled[i], y, *gain);
            scaled[i].re *= size;
            scaled[i].im *= size;
        }
        for (int64_t e = 0; e < n_e; e++) {
            number u = {{0}, {0}};
            add_product(&u, scaled[outputs[e]], right[inputs[e] * n_1 + b]);
            U[b * n_e + e] = u;
        }
    }
    for (int64_t w = 0; w < n_2; w++)
        for (int64_t e = 0; e < n_e; e++) {
            lanes size = (lanes){0} + (REAL)factor[n_1 + w];
            U[(n_1 + w) * n_e + e].re = size * whole[e * n_2 + w].re;
            U[(n_1 + w) * n_e + e].im = size * whole[e * n_2 + w].im;
        }
    if (slope)
        for (int64_t b = 0; b < n_1 + n_2; b++)
            for (int64_t e = 0; e < n_e; e++) {
                number u = {{0}, {0}};
                add_product(&u, U[b * n_e + e], slope[e]);
                U[b * n_e + e] = u;
            }
}

/* U becomes R U, TILE columns and two rows at a time from the first row on. */
static void whiten(int64_t n_b, int64_t n_e, int64_t is_diagonal, const number *T, number *U) {
    number none = {{0}, {0}};
    for (int64_t b = 0; b < n_b; b += TILE) {
        number *u = U + b * n_e;
        for (int64_t e = 0; e < n_e; e += 2) {
            int is_pair = e + 1 < n_e;
            const number *one = T + first_of_row(e, n_e, is_diagonal) - e;
            const number *two = T + first_of_row(e + 1, n_e, is_diagonal) - e - 1;
            number x[TILE], y[TILE];
            for (int i = 0; i < TILE; i++) {
                x[i] = y[i] = none;
                add_product(&x[i], one[e], u[i * n_e + e]);
            }
            if (is_diagonal && is_pair)
                for (int i = 0; i < TILE; i++)
                    add_product(&y[i], two[e + 1], u[i * n_e + e + 1]);
            if (!is_diagonal)
                for (int64_t k = e + 1; k < n_e; k++)
                    for (int i = 0; i < TILE; i++) {
                        add_product(&x[i], one[k], u[i * n_e + k]);
                        add_product(&y[i], two[k], u[i * n_e + k]);
                    }
            for (int i = 0; i < TILE; i++) {
                u[i * n_e + e] = x[i];
                if (is_pair)
                    u[i * n_e + e + 1] = y[i];
            }
        }
    }
}

/* Adds omega^p times V_b^H V_c to sums (tiles, TILE, TILE, POWERS), tiles on and above the diagonal. */
static void add_up(int64_t n_b, int64_t n_e, const number *V, const lanes *power, lanes *sums) {
    number none = {{0}, {0}};
    for (int64_t b = 0; b < n_b; b += TILE)
        for (int64_t c = b; c < n_b; c += TILE) {
            number gram[TILE][TILE];
            for (int i = 0; i < TILE; i++)
                for (int j = 0; j < TILE; j++)
                    gram[i][j] = none;
            const number *left = V + b * n_e, *right = V + c * n_e;
            for (int64_t e = 0; e < n_e; e++)
                for (int i = 0; i < TILE; i++)
                    for (int j = 0; j < TILE; j++)
                        add_inner(&gram[i][j], left[i * n_e + e], right[j * n_e + e]);
            for (int i = 0; i < TILE; i++)
                for (int j = 0; j < TILE; j++)
                    for (int p = 0; p < POWERS; p++)
                        *sums++ += power[p] * (p % 2 ? gram[i][j].im : gram[i][j].re);
        }
}

static void sum_lanes(int64_t n_b, int64_t padded, const lanes *sums, double *found) {
    for (int64_t b = 0; b < padded; b += TILE)
        for (int64_t c = b; c < padded; c += TILE)
            for (int64_t i = b; i < b + TILE; i++)
                for (int64_t j = c; j < c + TILE; j++)
                    for (int p = 0; p < POWERS; p++, sums++)
                        if (i <= j && j < n_b) {
                            double total = 0.0;
                            for (int64_t q = 0; q < LANES; q++)
                                total += (*sums)[q];
                            found[(p * n_b + i) * n_b + j] = total;
                        }
}

/* `moments`; R (batches, n_r, 2, BATCH) from the first line on.  0, or 1 where there is no memory. */
int moments(int64_t F, int64_t n_y, int64_t n_u, int64_t n_1, int64_t n_2, int64_t n_e, int64_t is_diagonal, const double *left,
            const double *right, const double *gain, const double *factor, const double *whole, const int64_t *outputs,
            const int64_t *inputs, const double *slope, const double *R, const double *omega, double *found) {
    int64_t n_b = n_1 + n_2, padded = (n_b + TILE - 1) / TILE * TILE, tiles = padded / TILE * (padded / TILE + 1) / 2;
    int64_t n_r = is_diagonal ? n_e : n_e * (n_e + 1) / 2, n_sums = tiles * TILE * TILE * POWERS;
    int64_t needed = padded * n_e + n_r + 1 + n_y * n_1 + n_u * n_1 + n_e * n_2 + n_e + (n_sums + 1) / 2;
    number *U = aligned_alloc(WIDTH, (size_t)needed * sizeof(number));
    if (!U)
        return 1;
    memset(U, 0, (size_t)needed * sizeof(number));
    number *T = U + padded * n_e, *c = T + n_r, *y = c + 1, *u = y + n_y * n_1, *w = u + n_u * n_1;
    number *z = w + n_e * n_2;
    lanes *sums = (lanes *)(z + n_e), power[POWERS];
    for (int64_t f = 0; f < F; f += LANES) {
        int64_t used = F - f < LANES ? F - f : LANES;
        spread(gain + 2 * f, 1, used, c);
        spread(left + 2 * f * n_y * n_1, n_y * n_1, used, y);
        if (right != left)
            spread(right + 2 * f * n_u * n_1, n_u * n_1, used, u);
        spread(whole + 2 * f * n_e * n_2, n_e * n_2, used, w);
        if (slope)
            spread(slope + 2 * f * n_e, n_e, used, z);
        columns(n_y, n_1, n_2, n_e, factor, outputs, inputs, y, right == left ? y : u, c, w, slope ? z : 0, U);
        take(R + f / BATCH * n_r * 2 * BATCH, n_r, f % BATCH, T);
        whiten(padded, n_e, is_diagonal, T, U);
        power[0] = (lanes){0} + 1;
        lanes here = {0};
        for (int64_t q = 0; q < used; q++)
            here[q] = (REAL)omega[f + q];
        for (int p = 1; p < POWERS; p++)
            power[p] = power[p - 1] * here;
        add_up(padded, n_e, U, power, sums);
    }
    sum_lanes(n_b, padded, sums, found);
    free(U);
    return 0;
}

/* r = q - R g and r^H R of F lines, all (F, n_e); without q: r is given. */
int residuals(int64_t F, int64_t n_e, int64_t is_diagonal, const double *R, const double *q, const double *G, double *r,
              double *returned) {
    int64_t n_r = is_diagonal ? n_e : n_e * (n_e + 1) / 2, needed = n_r + 3 * n_e;
    number *T = aligned_alloc(WIDTH, (size_t)needed * sizeof(number)), *g = T + n_r, *x = g + n_e, *back = x + n_e;
    if (!T)
        return 1;
    for (int64_t f = 0; f < F; f += LANES) {
        int64_t used = F - f < LANES ? F - f : LANES;
        take(R + f / BATCH * n_r * 2 * BATCH, n_r, f % BATCH, T);
        spread((q ? q : r) + 2 * f * n_e, n_e, used, x);
        memset(back, 0, (size_t)n_e * sizeof(number));
        if (q)
            spread(G + 2 * f * n_e, n_e, used, g);
        for (int64_t e = 0, t = 0; e < n_e; e++) {
            int64_t end = is_diagonal ? e + 1 : n_e, row = t;
            number sum = {{0}, {0}};
            if (q)
                for (int64_t k = e; k < end; k++)
                    add_product(&sum, T[t++], g[k]);
            x[e].re -= sum.re;
            x[e].im -= sum.im;
            t = row;
            for (int64_t k = e; k < end; k++)
                add_inner(&back[k], x[e], T[t++]);
        }
        for (int64_t l = 0; l < used; l++)
            for (int64_t e = 0; e < n_e; e++) {
                int64_t at = 2 * ((f + l) * n_e + e);
                r[at] = x[e].re[l];
                r[at + 1] = x[e].im[l];
                returned[at] = back[e].re[l];
                returned[at + 1] = back[e].im[l];
            }
    }
    free(T);
    return 0;
}

/* sum_e weight_e left_e right_e of F lines (F, n_1); row: memory for 2 n_1 numbers. */
int pulled(int64_t F, int64_t n_y, int64_t n_u, int64_t n_1, int64_t n_e, const double *left, const double *right,
            const int64_t *outputs, const int64_t *inputs, const double *weight, double *row, double *found) {
    memset(found, 0, (size_t)(2 * F * n_1) * sizeof(double));
    for (int64_t f = 0; f < F; f++, left += 2 * n_y * n_1, right += 2 * n_u * n_1, weight += 2 * n_e, found += 2 * n_1)
        for (int64_t i = 0; i < n_y; i++) {
            const double *y = left + 2 * i * n_1;
            memset(row, 0, (size_t)(2 * n_1) * sizeof(double));
            for (int64_t e = 0; e < n_e; e++)
                if (outputs[e] == i) {
                    const double *u = right + 2 * inputs[e] * n_1, re = weight[2 * e], im = weight[2 * e + 1];
                    for (int64_t d = 0; d < n_1; d++) {
                        row[2 * d] += re * u[2 * d] - im * u[2 * d + 1];
                        row[2 * d + 1] += re * u[2 * d + 1] + im * u[2 * d];
                    }
                }
            for (int64_t d = 0; d < n_1; d++) {
                found[2 * d] += y[2 * d] * row[2 * d] - y[2 * d + 1] * row[2 * d + 1];
                found[2 * d + 1] += y[2 * d] * row[2 * d + 1] + y[2 * d + 1] * row[2 * d];
            }
        }
    return 0;
}
