/* Residuals of several lines side by side, and their products with the columns of the Jacobian: sums for cost and
   gradient in double precision (`number`), moments in the precision REAL (`real_number`). */

#include "lanes.h"

#ifndef REAL
#define REAL double
#endif
#define BATCH 16
#define REAL_LANES ((int64_t)(WIDTH / sizeof(REAL)))
#define PARTS (REAL_LANES / LANES)
#define POWERS 5
#define CACHE_LINE 64

typedef REAL real_lanes __attribute__((vector_size(WIDTH)));
typedef struct {
    real_lanes re, im;
} real_number;

#define ADD_PRODUCT(x, a, b)                                                                                           \
    do {                                                                                                               \
        (x).re = (x).re + (a).re * (b).re - (a).im * (b).im;                                                           \
        (x).im = (x).im + (a).re * (b).im + (a).im * (b).re;                                                           \
    } while (0)
/* conj(a) b */
#define ADD_INNER(x, a, b)                                                                                             \
    do {                                                                                                               \
        (x).re = (x).re + (a).re * (b).re + (a).im * (b).im;                                                           \
        (x).im = (x).im + (a).re * (b).im - (a).im * (b).re;                                                           \
    } while (0)

typedef struct {
    int64_t F, n_y, n_u, n_1, n_2, n_v, n_3, n_e, is_diagonal;
    const int64_t *outputs, *inputs;
    const double *S; /* (2, n_2, n_v, n_v) */
} sizes;

static int64_t first_of_row(int64_t e, const sizes *of) {
    return of->is_diagonal ? e : e * of->n_e - e * (e - 1) / 2;
}

/* `many` complex numbers of `used` lines from line f on; the lanes left over are zero. */
static void load_all(const double *from, int64_t many, int64_t F, int64_t f, int64_t used, number *to) {
    for (int64_t t = 0; t < many; t++)
        to[t] = load(from + 2 * (t * F + f), 1, used);
}

static void store_all(const number *from, int64_t many, int64_t F, int64_t f, int64_t used, double *to) {
    for (int64_t t = 0; t < many; t++)
        store(from[t], used, to + 2 * (t * F + f));
}

/* PARTS times `many` numbers side by side in as many lanes. */
static void join(const number *from, int64_t many, real_number *to) {
    for (int64_t t = 0; t < many; t++) {
        REAL *re = (REAL *)&to[t].re, *im = (REAL *)&to[t].im;
        for (int64_t p = 0; p < PARTS; p++) {
            const double *one = (const double *)&from[p * many + t].re, *two = (const double *)&from[p * many + t].im;
            for (int64_t q = 0; q < LANES; q++) {
                re[p * LANES + q] = (REAL)one[q];
                im[p * LANES + q] = (REAL)two[q];
            }
        }
    }
}

/* The lanes from `lane` on of R (n_r, 2, BATCH). */
static void take(const double *R, int64_t n_r, int64_t lane, real_number *T) {
    for (int64_t t = 0; t < n_r; t++) {
        REAL *re = (REAL *)&T[t].re, *im = (REAL *)&T[t].im;
        for (int64_t q = 0; q < REAL_LANES; q++) {
            re[q] = (REAL)R[2 * BATCH * t + lane + q];
            im[q] = (REAL)R[2 * BATCH * t + BATCH + lane + q];
        }
    }
}

static inline number element(const double *R, int64_t t, int64_t lane) {
    number found;
    memcpy(&found.re, R + 2 * BATCH * t + lane, sizeof found.re);
    memcpy(&found.im, R + 2 * BATCH * t + BATCH + lane, sizeof found.im);
    return found;
}

/* q becomes r = q - R g, and back r^H R; without g: q is r.  Returns |r|^2 of each line. */
static lanes residual(const sizes *of, const double *R, int64_t lane, const number *g, number *q, number *back) {
    lanes cost = {0};
    memset(back, 0, (size_t)of->n_e * sizeof(number));
    for (int64_t e = 0; e < of->n_e; e++) {
        int64_t end = of->is_diagonal ? e + 1 : of->n_e, row = first_of_row(e, of) - e;
        lanes sums[4] = {0}; /* four independent sums, so that additions overlap */
        for (int64_t k = e; g && k < end; k++) {
            number one = element(R, row + k, lane);
            sums[0] += one.re * g[k].re;
            sums[1] += one.im * g[k].im;
            sums[2] += one.re * g[k].im;
            sums[3] += one.im * g[k].re;
        }
        q[e].re -= sums[0] - sums[1];
        q[e].im -= sums[2] + sums[3];
        cost += q[e].re * q[e].re + q[e].im * q[e].im;
        for (int64_t k = e; k < end; k++) {
            number one = element(R, row + k, lane);
            ADD_INNER(back[k], q[e], one);
        }
    }
    return cost;
}

/* Adds s^p x to sums[p * apart], p = 0, 1, 2. */
static inline void add_powers(number x, lanes omega, int64_t apart, number *sums) {
    sums[0].re += x.re;
    sums[0].im += x.im;
    sums[apart].re -= omega * x.im;
    sums[apart].im += omega * x.re;
    sums[2 * apart].re -= omega * omega * x.re;
    sums[2 * apart].im -= omega * omega * x.im;
}

/* Adds s^p times the sum of weight and column, elements of equal output together, to sums (3, n_b). */
static void pull(const sizes *of, const number *left, const number *right, const number *gain, const number *whole,
                 const number *weight, lanes omega, number *sums) {
    int64_t n_1 = of->n_1, n_12 = n_1 + of->n_2, n_b = n_12 + of->n_3, n_e = of->n_e;
    number none = {{0}, {0}};
    for (int64_t b = 0; b < n_1; b++) {
        number total = none, sum = none;
        for (int64_t e = 0; e < n_e;) {
            int64_t i = of->outputs[e];
            number row = none;
            for (; e < n_e && of->outputs[e] == i; e++)
                ADD_PRODUCT(row, weight[e], right[b * of->n_u + of->inputs[e]]);
            ADD_PRODUCT(sum, row, left[b * of->n_y + i]);
        }
        ADD_PRODUCT(total, sum, *gain);
        add_powers(total, omega, n_b, sums + b);
    }
    for (int64_t b = n_12; b < n_b; b++) {
        number total = none;
        for (int64_t e = 0; e < n_e; e++)
            ADD_PRODUCT(total, weight[e], whole[(b - n_12) * n_e + e]);
        add_powers(total, omega, n_b, sums + b);
    }
}

/* Adds s^p gain left^T weight right of the directions of the bases of a higher rank to sums (3, r, r). */
static void pull_between(const sizes *of, const number *left, const number *right, const number *gain,
                         const number *weight, lanes omega, number *sums) {
    int64_t r = of->n_v, n_e = of->n_e, n_y = of->n_y, n_u = of->n_u;
    number none = {{0}, {0}}, row[n_y];
    for (int64_t b = 0; b < r; b++) {
        memset(row, 0, sizeof row);
        for (int64_t e = 0; e < n_e; e++)
            ADD_PRODUCT(row[of->outputs[e]], weight[e], right[b * n_u + of->inputs[e]]);
        for (int64_t i = 0; i < n_y; i++) {
            number turned = none;
            ADD_PRODUCT(turned, row[i], *gain);
            row[i] = turned;
        }
        for (int64_t a = 0; a < r; a++) {
            number sum = none;
            for (int64_t i = 0; i < n_y; i++)
                ADD_PRODUCT(sum, left[a * n_y + i], row[i]);
            add_powers(sum, omega, r * r, sums + a * r + b);
        }
    }
}
