/* The scatter of periods of `frf/experiment_blocks.py`: BATCH lines side by side. */

#include "lanes.h"

#define BATCH 8

typedef double loose __attribute__((vector_size(WIDTH), aligned(8))); /* in arrays of NumPy */

/* Adds sum_p V_i conj(V_j), V (channels, P), to the pairs of S (n (n + 1) / 2, 2, BATCH) from a lane on. */
static void add_products(int64_t P, int64_t n, const number *V, double *S) {
    for (int64_t i = 0; i < n; i += TILE)
        for (int64_t j = i; j < n; j += TILE) {
            number sums[TILE][TILE] = {0};
            add_tile(P, V + i * P, V + j * P, sums);
            for (int a = 0; a < TILE; a++)
                for (int b = 0; b < TILE; b++) {
                    int64_t row = i + a, column = j + b;
                    if (row <= column && column < n) {
                        double *pair = S + 2 * BATCH * (row * n - row * (row - 1) / 2 + column - row);
                        __builtin_prefetch(pair + n * (n + 1) * BATCH, 1); /* of the next lines */
                        __builtin_prefetch(pair + n * (n + 1) * BATCH + BATCH, 1);
                        *(loose *)pair += sums[a][b].re;
                        *(loose *)(pair + BATCH) += sums[a][b].im;
                    }
                }
        }
}

/* The mean of z over P periods, and its scatter about it added to S; distances in complex numbers. */
KERNEL(add_scatter)(int64_t P, int64_t F, int64_t n, const double *z, double *mean, int64_t periods_apart,
                int64_t lines_apart, int64_t channels_apart, int64_t means_apart, double *S) {
    int64_t n_pairs = n * (n + 1) / 2;
    number *V = zeros((n + TILE) * P);
    if (!V)
        return 1;
    for (int64_t f = 0; f < F; f += LANES) {
        int64_t used = F - f < LANES ? F - f : LANES;
        for (int64_t c = 0; c < n; c++) {
            number *v = V + c * P, sum = {{0}, {0}};
            for (int64_t p = 0; p < P; p++) {
                const double *here = z + 2 * (p * periods_apart + f * lines_apart + c * channels_apart);
                v[p] = load(here, lines_apart, used);
                sum.re += v[p].re;
                sum.im += v[p].im;
            }
            sum.re /= (double)P;
            sum.im /= (double)P;
            store(sum, used, mean + 2 * (c * means_apart + f));
            for (int64_t p = 0; p < P; p++) {
                v[p].re -= sum.re;
                v[p].im -= sum.im;
            }
        }
        add_products(P, n, V, S + f / BATCH * n_pairs * 2 * BATCH + f % BATCH);
    }
    release(V);
    return 0;
}

/* scale_i conj(scale_j) S_ij of every line (F, n, n), scale (F, n). */
KERNEL(collect)(int64_t F, int64_t n, const double *S, const double *scale, double *found) {
    for (int64_t f = 0; f < F; f++, scale += 2 * n, found += 2 * n * n) {
        const double *pair = S + f / BATCH * n * (n + 1) * BATCH + f % BATCH;
        for (int64_t i = 0; i < n; i++)
            for (int64_t j = i; j < n; j++, pair += 2 * BATCH) {
                double re = scale[2 * i] * scale[2 * j] + scale[2 * i + 1] * scale[2 * j + 1];
                double im = scale[2 * i + 1] * scale[2 * j] - scale[2 * i] * scale[2 * j + 1];
                double *upper = found + 2 * (i * n + j), *lower = found + 2 * (j * n + i);
                upper[0] = lower[0] = re * pair[0] - im * pair[BATCH];
                upper[1] = re * pair[BATCH] + im * pair[0];
                lower[1] = -upper[1];
            }
    }
    return 0;
}
