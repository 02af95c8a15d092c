/* Complex numbers of several lines, side by side in the lanes of a register: real and imaginary parts apart. */

#include "registers.h"

#define LANES ((int64_t)(WIDTH / sizeof(double)))
#define AHEAD 64

typedef double lanes __attribute__((vector_size(WIDTH)));
typedef struct {
    lanes re, im;
} number;

/* Load `used` lines that are `apart` complex numbers from each other; unused lanes are zero.  Adjacent lines are
   prefetched AHEAD numbers early: rows and columns are more streams than the hardware prefetcher follows. */
static inline number load(const double *from, int64_t apart, int64_t used) {
    double re[LANES] = {0}, im[LANES] = {0};
    number found;
    if (apart == 1 && used == LANES) {
        __builtin_prefetch(from + AHEAD);
        __builtin_prefetch(from + AHEAD + 8);
        for (int64_t q = 0; q < LANES; q++) {
            re[q] = from[2 * q];
            im[q] = from[2 * q + 1];
        }
    } else
        for (int64_t q = 0; q < used; q++) {
            re[q] = from[2 * apart * q];
            im[q] = from[2 * apart * q + 1];
        }
    memcpy(&found.re, re, sizeof re);
    memcpy(&found.im, im, sizeof im);
    return found;
}

static inline number product(number a, number b) {
    number c = {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
    return c;
}

static inline void less_product(number *x, number a, number b) {
    x->re = x->re - a.re * b.re + a.im * b.im;
    x->im = x->im - a.re * b.im - a.im * b.re;
}

static inline void store(number from, int64_t used, double *to) {
    const double *re = (const double *)&from.re, *im = (const double *)&from.im;
    for (int64_t q = 0; q < used; q++) {
        to[2 * q] = re[q];
        to[2 * q + 1] = im[q];
    }
}

static inline number *zeros(int64_t many) {
    number *found = allocate((size_t)(many ? many : 1) * sizeof(number));
    if (found)
        memset(found, 0, (size_t)many * sizeof(number));
    return found;
}

/* sums_ab += sum_p left_ap conj(right_bp), rows of P numbers. */
static inline void add_tile(int64_t P, const number *left, const number *right, number sums[TILE][TILE]) {
    for (int64_t p = 0; p < P; p++)
        for (int a = 0; a < TILE; a++)
            for (int b = 0; b < TILE; b++) {
                number *sum = &sums[a][b], v = left[a * P + p], w = right[b * P + p];
                sum->re = sum->re + v.re * w.re + v.im * w.im;
                sum->im = sum->im + v.im * w.re - v.re * w.im;
            }
}
