/* The sums over lines of `fit/problem/compressed_residuals.py`, numbers of type REAL. */

#include "line_residuals.h"

/* gain left (S[0] - omega^2 S[1]) right^T of a base of a higher rank, its elements times factor; P (r, n_u): to work in.
   TILE elements at a time; those that fill up the last TILE are its last one again. */
static void between(const sizes *of, int64_t b, REAL factor, const real_number *left, const real_number *right,
                    const real_number *gain, real_lanes omega, real_number *P, real_number *u) {
    int64_t r = of->n_v, n_y = of->n_y, n_u = of->n_u, n_e = of->n_e;
    const double *fixed = of->S + b * r * r, *moved = fixed + of->n_2 * r * r;
    real_lanes square = omega * omega * factor;
    real_number none = {{0}, {0}};
    for (int64_t a = 0; a < r; a++)
        for (int64_t first = 0; first < n_u; first += TILE) {
            real_number x[TILE];
            int64_t at[TILE];
            for (int i = 0; i < TILE; i++) {
                at[i] = first + i < n_u ? first + i : n_u - 1;
                x[i] = none;
            }
            for (int64_t k = 0; k < r; k++)
                if (fixed[a * r + k] != 0.0 || moved[a * r + k] != 0.0) {
                    real_lanes S = factor * (REAL)fixed[a * r + k] - square * (REAL)moved[a * r + k];
                    for (int i = 0; i < TILE; i++) {
                        x[i].re += S * right[k * n_u + at[i]].re;
                        x[i].im += S * right[k * n_u + at[i]].im;
                    }
                }
            for (int i = 0; i < TILE; i++) {
                P[a * n_u + at[i]] = none;
                ADD_PRODUCT(P[a * n_u + at[i]], x[i], *gain);
            }
        }
    for (int64_t e = 0; e < n_e; e += TILE) {
        real_number x[TILE];
        const real_number *one[TILE], *other[TILE];
        for (int i = 0; i < TILE; i++) {
            int64_t at = e + i < n_e ? e + i : n_e - 1;
            one[i] = left + of->outputs[at];
            other[i] = P + of->inputs[at];
            x[i] = none;
        }
        for (int64_t a = 0; a < r; a++)
            for (int i = 0; i < TILE; i++)
                ADD_PRODUCT(x[i], one[i][a * n_y], other[i][a * n_u]);
        for (int i = 0; i < TILE && e + i < n_e; i++)
            u[e + i] = x[i];
    }
}

/* U (n_b, n_e): gain factor left right^T of each base of rank one, those of a higher rank, the whole columns; times
   slope.  P (r, n_u): to work in. */
static void columns(const sizes *of, const double *factor, const real_number *left, const real_number *right, const real_number *gain,
                    const real_number *whole, const real_number *slope, real_lanes omega, real_number *P, real_number *U) {
    int64_t n_e = of->n_e, n_1 = of->n_1, n_12 = n_1 + of->n_2;
    real_number none = {{0}, {0}};
    for (int64_t b = 0; b < n_1; b++) {
        real_number scaled[of->n_y];
        real_lanes size = (real_lanes){0} + (REAL)factor[b];
        real_number turned = {gain->re * size, gain->im * size};
        for (int64_t i = 0; i < of->n_y; i++) {
            scaled[i] = none;
            ADD_PRODUCT(scaled[i], left[b * of->n_y + i], turned);
        }
        for (int64_t e = 0; e < n_e; e++) {
            real_number u = none;
            ADD_PRODUCT(u, scaled[of->outputs[e]], right[b * of->n_u + of->inputs[e]]);
            U[b * n_e + e] = u;
        }
    }
    for (int64_t b = n_1; b < n_12; b++)
        between(of, b - n_1, (REAL)factor[b], left + n_1 * of->n_y, right + n_1 * of->n_u, gain, omega, P, U + b * n_e);
    for (int64_t w = 0; w < of->n_3; w++)
        for (int64_t e = 0; e < n_e; e++) {
            real_lanes size = (real_lanes){0} + (REAL)factor[n_12 + w];
            U[(n_12 + w) * n_e + e].re = size * whole[w * n_e + e].re;
            U[(n_12 + w) * n_e + e].im = size * whole[w * n_e + e].im;
        }
    if (slope)
        for (int64_t b = 0; b < n_12 + of->n_3; b++)
            for (int64_t e = 0; e < n_e; e++) {
                real_number u = none;
                ADD_PRODUCT(u, U[b * n_e + e], slope[e]);
                U[b * n_e + e] = u;
            }
}

/* U becomes R U, TILE columns and two rows at a time from the first row on. */
static void whiten(const sizes *of, int64_t n_b, const real_number *T, real_number *U) {
    int64_t n_e = of->n_e;
    real_number none = {{0}, {0}};
    for (int64_t b = 0; b < n_b; b += TILE) {
        real_number *u = U + b * n_e;
        for (int64_t e = 0; e < n_e; e += 2) {
            int is_pair = e + 1 < n_e;
            const real_number *one = T + first_of_row(e, of) - e;
            const real_number *two = T + first_of_row(e + 1, of) - e - 1;
            real_number x[TILE], y[TILE];
            for (int i = 0; i < TILE; i++) {
                x[i] = y[i] = none;
                ADD_PRODUCT(x[i], one[e], u[i * n_e + e]);
            }
            if (of->is_diagonal && is_pair)
                for (int i = 0; i < TILE; i++)
                    ADD_PRODUCT(y[i], two[e + 1], u[i * n_e + e + 1]);
            if (!of->is_diagonal)
                for (int64_t k = e + 1; k < n_e; k++)
                    for (int i = 0; i < TILE; i++) {
                        ADD_PRODUCT(x[i], one[k], u[i * n_e + k]);
                        ADD_PRODUCT(y[i], two[k], u[i * n_e + k]);
                    }
            for (int i = 0; i < TILE; i++) {
                u[i * n_e + e] = x[i];
                if (is_pair)
                    u[i * n_e + e + 1] = y[i];
            }
        }
    }
}

/* Adds omega^p times V_b^H V_c to sums (tiles, TILE, TILE, POWERS), tiles on and above the diagonal; on the way `bytes`
   at `next` come into the cache. */
static void add_up(int64_t n_b, int64_t n_e, const real_number *V, real_lanes omega, const char *next, int64_t bytes,
                   real_lanes *sums) {
    int64_t tiles = (n_b + TILE - 1) / TILE, share = bytes / (tiles * (tiles + 1) / 2) + 1;
    real_lanes power[POWERS] = {(real_lanes){0} + 1};
    for (int p = 1; p < POWERS; p++)
        power[p] = power[p - 1] * omega;
    for (int64_t b = 0; b < n_b; b += TILE)
        for (int64_t c = b; c < n_b; c += TILE) {
            real_number gram[TILE][TILE] = {0};
            for (int64_t at = 0; at < share; at += CACHE_LINE)
                __builtin_prefetch(next + at);
            next += share;
            const real_number *left = V + b * n_e, *right = V + c * n_e;
            for (int64_t e = 0; e < n_e; e++)
                for (int i = 0; i < TILE; i++)
                    for (int j = 0; j < TILE; j++)
                        ADD_INNER(gram[i][j], left[i * n_e + e], right[j * n_e + e]);
            for (int i = 0; i < TILE; i++)
                for (int j = 0; j < TILE; j++)
                    for (int p = 0; p < POWERS; p++)
                        *sums++ += power[p] * (p % 2 ? gram[i][j].im : gram[i][j].re);
        }
}

static void sum_moments(int64_t n_b, int64_t padded, const real_lanes *sums, double *found) {
    for (int64_t b = 0; b < padded; b += TILE)
        for (int64_t c = b; c < padded; c += TILE)
            for (int64_t i = b; i < b + TILE; i++)
                for (int64_t j = c; j < c + TILE; j++)
                    for (int p = 0; p < POWERS; p++, sums++)
                        if (i <= j && j < n_b) {
                            double total = 0.0;
                            for (int64_t q = 0; q < REAL_LANES; q++)
                                total += (*sums)[q];
                            found[(p * n_b + i) * n_b + j] = total;
                        }
}

/* The sums over lanes of (3, many) numbers, each with its sign where there is one. */
static void sum_pulls(int64_t many, const number *sums, const double *sign, double *found) {
    for (int64_t t = 0; t < 3 * many; t++) {
        double re = 0.0, im = 0.0, factor = sign ? sign[t % many] : 1.0;
        for (int64_t q = 0; q < LANES; q++) {
            re += sums[t].re[q];
            im += sums[t].im[q];
        }
        found[2 * t] = factor * re;
        found[2 * t + 1] = factor * im;
    }
}

/* `Packed.sums`; arrays over lines have these last, R (batches, n_r, 2, BATCH) begins at the first.  Without G, q is r;
   without right, it is left.  0, or 1 where there is no memory. */
KERNEL(JOIN(sums, REAL))(int64_t F, int64_t n_y, int64_t n_u, int64_t n_1, int64_t n_2, int64_t n_v, int64_t n_3, int64_t n_e,
         int64_t is_diagonal, const double *left, const double *right, const double *gain, const double *S,
         const double *whole, const int64_t *outputs, const int64_t *inputs, const double *q, const double *G, const double *slope, const double *R,
         const double *omega, const double *sign, const double *factor, double *cost, double *weight, double *pulled,
         double *pulled_between, double *moments) {
    sizes of = {F, n_y, n_u, n_1, n_2, n_v, n_3, n_e, is_diagonal, outputs, inputs, S};
    int64_t n_b = n_1 + n_2 + n_3, n_d = n_1 + n_v;
    int64_t padded = (n_b + TILE - 1) / TILE * TILE, tiles = padded / TILE * (padded / TILE + 1) / 2;
    int64_t n_r = is_diagonal ? n_e : n_e * (n_e + 1) / 2, n_sums = tiles * TILE * TILE * POWERS;
    int64_t many[] = {n_d * n_y, right ? n_d * n_u : 0, 1, n_3 * n_e, slope ? n_e : 0};
    const double *given[] = {left, right, gain, whole, slope};
    int64_t n_given = many[0] + many[1] + many[2] + many[3] + many[4];
    int64_t n_numbers = padded * n_e + n_r + n_given + n_v * n_u, n_precise = PARTS * n_given + 3 * (n_e + n_b + n_v * n_v);
    size_t needed = (size_t)(n_numbers + n_precise) * sizeof(real_number) + (size_t)n_sums * sizeof(real_lanes);
    real_number *U = allocate(needed);
    if (!U)
        return 1;
    memset(U, 0, needed);
    real_number *T = U + padded * n_e, *P = T + n_r, *single[5] = {P + n_v * n_u};
    number *twice[5] = {(number *)(single[0] + n_given)}, *g = twice[0] + PARTS * n_given, *r = g + n_e;
    number *back = r + n_e, *pulls = back + n_e, *pulls_between = pulls + 3 * n_b;
    for (int i = 1; i < 5; i++) {
        single[i] = single[i - 1] + many[i - 1];
        twice[i] = twice[i - 1] + PARTS * many[i - 1];
    }
    int64_t R_bytes = n_r * 2 * BATCH * (int64_t)sizeof(double);
    real_lanes *gram = (real_lanes *)(pulls_between + 3 * n_v * n_v);
    lanes total = {0};
    for (int64_t f = 0; f < F; f += REAL_LANES) {
        const double *R_here = R + f / BATCH * n_r * 2 * BATCH;
        real_lanes w = {0};
        for (int64_t p = 0; p < PARTS; p++) {
            int64_t start = f + p * LANES, used = F - start < LANES ? F - start : LANES;
            number *one[5];
            lanes here = {0};
            if (used < 0)
                used = 0;
            for (int64_t l = 0; l < used; l++)
                w[p * LANES + l] = (REAL)(here[l] = omega[start + l]);
            for (int i = 0; i < 5; i++)
                load_all(given[i], many[i], F, start, used, one[i] = twice[i] + p * many[i]);
            load_all(q, n_e, F, start, used, r);
            if (G)
                load_all(G, n_e, F, start, used, g);
            total += residual(&of, R_here, f % BATCH + p * LANES, G ? g : 0, r, back);
            for (int64_t e = 0; slope && e < n_e; e++) {
                number turned = {{0}, {0}};
                ADD_PRODUCT(turned, back[e], one[4][e]);
                back[e] = turned;
            }
            store_all(back, n_e, F, start, used, weight);
            number *at_right = one[right ? 1 : 0];
            pull(&of, one[0], at_right, one[2], one[3], back, here, pulls);
            pull_between(&of, one[0] + n_1 * n_y, at_right + n_1 * n_u, one[2], back, here, pulls_between);
        }
        for (int i = 0; i < 5; i++)
            join(twice[i], many[i], single[i]);
        columns(&of, factor, single[0], single[right ? 1 : 0], single[2], single[3], slope ? single[4] : 0, w,
                P, U);
        take(R_here, n_r, f % BATCH, T);
        whiten(&of, padded, T, U);
        add_up(padded, n_e, U, w, (const char *)(R + (f + REAL_LANES) / BATCH * n_r * 2 * BATCH), R_bytes, gram);
    }
    for (int64_t l = 0; l < LANES; l++)
        *cost += total[l];
    sum_pulls(n_b, pulls, sign, pulled);
    sum_pulls(n_v * n_v, pulls_between, 0, pulled_between);
    sum_moments(n_b, padded, gram, moments);
    release(U);
    return 0;
}
