/* Means of memoryless friction in the cells of samples, for `nonlinear/shapes.py`, whose words and rules these are. */

#include <math.h>

#include "registers.h"

#define LANES ((int64_t)(WIDTH / sizeof(double)))
#define ROWS 16

typedef double lanes __attribute__((vector_size(WIDTH)));
typedef int64_t flags __attribute__((vector_size(WIDTH)));

/* A shape: kind 0 is a sign, 1 a Stribeck curve. */
typedef struct {
    double kind, threshold, level;
} shape;

/* e^-x of x >= 0: 2^n times Taylor's series about the nearest n log 2, to rounding. */
static lanes decay(lanes x) {
    const double shift = 0x1.8p52, log_2 = 0x1.62e42fefa0000p-1, rest = 0x1.cf79abc9e3b3ap-40;
    const double factors[] = {1.0 / 479001600.0, 1.0 / 39916800.0, 1.0 / 3628800.0, 1.0 / 362880.0, 1.0 / 40320.0,
                              1.0 / 5040.0,      1.0 / 720.0,      1.0 / 120.0,     1.0 / 24.0,     1.0 / 6.0,
                              0.5,               1.0,              1.0};
    lanes most = x * 0.0 + 700.0, sum = x * 0.0 + 1.0 / 6227020800.0;
    flags less = x < most;
    x = -(lanes)(((flags)x & less) | ((flags)most & ~less));
    lanes turned = x * 0x1.71547652b82fep0 + shift, n = turned - shift, r = x - n * log_2 - n * rest;
    for (int i = 0; i < 13; i++)
        sum = sum * r + factors[i];
    return sum * (lanes)(((flags)turned + 1023) << 52);
}

/* log(1 + e) of e from 0 to 1: 2 artanh(e / (2 + e)), by its series to rounding. */
static lanes log_of_one_more(lanes e) {
    lanes s = e / (2.0 + e), square = s * s, sum = e * 0.0 + 1.0 / 33.0;
    for (int i = 31; i > 0; i -= 2)
        sum = sum * square + 1.0 / i;
    return 2.0 * s * sum;
}

/* erf of x >= 0, and e = e^-(x^2): to 1e-15, by a polynomial of (1 + 2 x) e^(x^2) erfc(x) in (x - 3.75) / (x + 3.75).
   (Shepherd and Laframboise, Mathematics of Computation 36, 1981.) */
static lanes error_function(lanes x, lanes e) {
    const double factors[] = {
        -2.5009326630130474e-09, -1.8843060392100303e-09, 3.1334996078693015e-08, 1.8426578963942785e-08,
        -2.471041665674534e-07, -5.003878821600112e-08, 1.7400925913507834e-06, -9.80265511111476e-07,
        -1.1436533456411926e-05, 2.2388336027276567e-05, 5.16457464409295e-05, -0.00029015572908776835,
        0.00029371464024929096, 0.0017556262817144922, -0.009746579738712893, 0.028362277350234878,
        -0.05869339856966102, 0.09230432116654805, -0.1088039301429101, 0.08227673848989052,
        0.0035854154854912806, -0.1402405985855442, 1.2375126308378281};
    lanes t = (x - 3.75) / (x + 3.75), sum = t * 0.0 + factors[0];
    for (int i = 1; i < 23; i++)
        sum = sum * t + factors[i];
    return 1.0 - e * sum / (1.0 + 2.0 * x);
}

/* Gradual friction g at speeds, and its integral from 0 on. */
static void slide(lanes speed, int64_t n_f, const shape *taken, lanes *g, lanes *integral) {
    *g = *integral = speed * 0.0;
    for (const shape *s = taken; s < taken + n_f; s++) {
        lanes x = speed / s->threshold;
        if (s->threshold == 0.0)
            continue;
        if (s->kind == 0.0) {
            lanes e = decay(2.0 * x);
            *g += s->level * ((1.0 - e) / (1.0 + e));
            *integral += s->level * (speed + s->threshold * log_of_one_more(e));
        } else {
            lanes e = decay(x * x);
            *g += s->level * e;
            *integral += s->level * s->threshold * 0.88622692545275801365 /* sqrt(pi) / 2 */ * error_function(x, e);
        }
    }
}

static double second_difference(const double *v) { return v[1] - v[0] - (v[0] - v[-1]); }

/* That of a row (points,) in its k-th cell, the mean of that at both ends. */
static double bend(const double *v, int64_t k, int64_t points) {
    if (k == 0)
        return second_difference(v + 1);
    if (k == points - 2)
        return second_difference(v + k);
    return (second_difference(v + k) + second_difference(v + k + 1)) / 2.0;
}

/* The part of the k-th cell after which v turns. */
static double reversal(const double *v, int64_t k, int64_t points) {
    double begin = v[k], end = v[k + 1], straight = begin / (begin == end ? 1.0 : begin - end), ratio = 1.0;
    if (k > 0 && k < points - 2) {
        double before = begin - v[k - 1], after = v[k + 2] - end;
        if (before * after > 0.0 && before * end > 0.0)
            ratio = fmin(fmax(after / before, 0.1), 10.0);
    }
    return straight * ratio / (straight * ratio + 1.0 - straight);
}

static double sign(double x) { return (double)((x > 0.0) - (x < 0.0)); }

/* Speeds at the ends of the cells of some rows in which friction is not steady, one after the other: how many. */
static int64_t slow_points(int64_t rows, int64_t points, double limit, const double *v, double *speeds, char *near) {
    int64_t count = 0;
    for (; rows > 0; rows--, v += points)
        for (int64_t k = 0, known = 0; k < points - 1; k++, near++) {
            *near = fabs(v[k]) <= limit || fabs(v[k + 1]) <= limit || !signbit(v[k]) != !signbit(v[k + 1]);
            if (*near && !known)
                speeds[count++] = fabs(v[k]);
            if (*near)
                speeds[count++] = fabs(v[k + 1]);
            known = *near;
        }
    return count;
}

/* means (m, points - 1) of friction by `taken` (n_f,) between the points of velocity (m, points). */
KERNEL(sliding_means)(int64_t m, int64_t points, int64_t n_f, const double *velocity, const shape *taken,
                      double *means) {
    double limit = 0.0, steady = 0.0, jump = 0.0;
    int64_t gradual = 0, most = (ROWS * points + LANES - 1) / LANES * LANES;
    for (const shape *s = taken; s < taken + n_f; s++) {
        limit = fmax(limit, (s->kind == 0.0 ? 5.0 : 3.5) * s->threshold);
        steady += s->kind == 0.0 ? s->level : 0.0;
        jump += s->threshold == 0.0 ? s->level : 0.0;
        gradual += s->threshold > 0.0;
    }
    double *speeds = allocate((size_t)(4 * most) * sizeof(double)), *g = speeds + most, *integral = g + most;
    char *nears = (char *)(integral + most);
    if (!speeds)
        return 1;
    memset(speeds, 0, (size_t)most * sizeof(double));
    for (int64_t i = 0; i < m; i += ROWS) {
        int64_t rows = m - i < ROWS ? m - i : ROWS, p = -1;
        const double *v = velocity + i * points;
        const char *near = nears;
        int64_t count = slow_points(rows, points, limit, v, speeds, nears);
        for (int64_t q = 0; gradual && q < count; q += LANES)
            slide(*(lanes *)(speeds + q), n_f, taken, (lanes *)(g + q), (lanes *)(integral + q));
        for (; rows > 0; rows--, v += points)
            for (int64_t k = 0, known = 0; k < points - 1; k++, means++, near++) {
                *means = copysign(steady, v[k]);
                if (*near) {
                    p += known ? 0 : 1;
                    double step = v[k + 1] - v[k], begin = v[k] == 0.0 ? 0.0 : copysign(g[p], v[k]);
                    double end = v[k + 1] == 0.0 ? 0.0 : copysign(g[p + 1], v[k + 1]);
                    *means = 0.0;
                    if (gradual)
                        *means = fabs(step) <= 2e-6 * fabs(v[k]) ? begin
                                                                 : (integral[p + 1] - integral[p] -
                                                                    bend(v, k, points) / 12.0 * (end - begin)) /
                                                                       step;
                    if (jump != 0.0)
                        *means += jump * (!signbit(v[k]) != !signbit(v[k + 1])
                                              ? sign(v[k]) * (2.0 * reversal(v, k, points) - 1.0)
                                              : sign(v[k] + v[k + 1]));
                    p++;
                }
                known = *near;
            }
    }
    release(speeds);
    return 0;
}
