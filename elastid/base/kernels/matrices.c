/* Sums of products, inverses and singular values of stacks (F, n, m) for `matrices.py`: LANES lines
   side by side, real and imaginary parts apart.  Each line is computed as if it were alone.

   Products are summed over columns from the first on, block by block.  Inverses: rows are eliminated from the first
   column on, the largest number of a column being its pivot, and substituted from the last row back, as LAPACK does.
   Singular values: columns are turned in pairs (1, 2), (1, 3), ... (2, 3), ... until a sweep finds none that is not
   orthogonal to rounding (Hestenes, 1958), so that small ones are as exact as large ones. */

#include <math.h>

#include "lanes.h"

#define MAX_SWEEPS 40
#define EPSILON 2.2e-16

typedef int64_t flags __attribute__((vector_size(WIDTH)));

/* Where a stack lies: address of its first number, and numbers from line to line, row to row, column to column. */
typedef struct {
    int64_t address, lines, rows, columns;
} stack;

static stack transposed(stack A) {
    stack found = {A.address, A.lines, A.columns, A.rows};
    return found;
}

/* Matrices (rows, columns) from line f on to rows of numbers `apart`; the lanes left over are zero.  sign -1: their
   conjugates. */
static void take(int64_t rows, int64_t columns, stack A, int64_t f, int64_t used, double sign, int64_t apart,
                 number *to) {
    const double *from = (const double *)(intptr_t)A.address + 2 * f * A.lines;
    int64_t is_together = A.lines == 1 && used == LANES;
    for (int64_t i = 0; i < rows && used < LANES; i++)
        memset(to + i * apart, 0, (size_t)columns * sizeof(number));
    for (int64_t i = 0; i < rows && is_together; i++)
        for (int64_t j = 0; j < columns; j++) {
            number one = load(from + 2 * (i * A.rows + j * A.columns), 1, LANES);
            one.im *= sign;
            to[i * apart + j] = one;
        }
    for (int64_t q = 0; q < used && !is_together; q++, from += 2 * A.lines)
        for (int64_t i = 0; i < rows; i++) {
            double *lane = (double *)(to + i * apart) + q;
            const double *here = from + 2 * i * A.rows;
            for (int64_t j = 0; j < columns; j++, lane += 2 * LANES, here += 2 * A.columns) {
                lane[0] = here[0];
                lane[LANES] = sign * here[1];
            }
        }
}

/* And back, from rows of numbers. */
static void put(int64_t rows, int64_t columns, const number *from, int64_t apart, int64_t used, double *to) {
    for (int64_t q = 0; q < used; q++)
        for (int64_t i = 0; i < rows; i++) {
            const double *lane = (const double *)(from + i * apart) + q;
            for (int64_t j = 0; j < columns; j++, lane += 2 * LANES, to += 2) {
                to[0] = lane[0];
                to[1] = lane[LANES];
            }
        }
}

/* C_ij += sign sum_p left_ip conj(right_jp), C (n, m); on and above the diagonal only where both are the same. */
static void add_product(int64_t n, int64_t m, int64_t k, const number *left, const number *right, double sign,
                        number *C) {
    for (int64_t i = 0; i < n; i += TILE)
        for (int64_t j = left == right ? i : 0; j < m; j += TILE) {
            number sums[TILE][TILE] = {0};
            add_tile(k, left + i * k, right + j * k, sums);
            for (int64_t a = i; a < i + TILE && a < n; a++)
                for (int64_t b = j; b < j + TILE && b < m; b++) {
                    C[a * m + b].re += sign * sums[a - i][b - j].re;
                    C[a * m + b].im += sign * sums[a - i][b - j].im;
                }
        }
}

/* The lower half of a Hermitian C (n, n) from the upper. */
static void mirror(int64_t n, number *C) {
    for (int64_t i = 0; i < n; i++) {
        C[i * n + i].im = (lanes){0};
        for (int64_t j = i + 1; j < n; j++) {
            C[j * n + i].re = C[i * n + j].re;
            C[j * n + i].im = -C[i * n + j].im;
        }
    }
}

/* C (F, n, m) = sum over M blocks of A B^H, or of A B^T if sign is -1: A (F, n, k), B (F, m, k), k (M,) at most K.
   With G (F, n, m): C (F, n, n) = sum of D D^H, D = A - G B, B (F, m, k). */
KERNEL(sum_of_products)(int64_t F, int64_t n, int64_t m, int64_t M, int64_t K, const int64_t *k, const stack *A,
                    const stack *B, const stack *G, int64_t sign, double *C) {
    int64_t is_square = G || (sign == 1 && n == m && !memcmp(A, B, (size_t)M * sizeof(stack))), w = G ? n : m;
    number *left = zeros((n + TILE) * (K + m) + (m + K + TILE) * (K + m) + n * w);
    if (!left)
        return 1;
    number *gain = left + (n + TILE) * K, *right = gain + (n + TILE) * m, *sum = right + (m + K + TILE) * (K + m);
    for (int64_t f = 0; f < F; f += LANES, C += 2 * n * w * LANES) {
        int64_t used = F - f < LANES ? F - f : LANES;
        memset(sum, 0, (size_t)(n * w) * sizeof(number));
        if (G)
            take(n, m, *G, f, used, 1.0, m, gain);
        for (int64_t b = 0; b < M; b++) {
            take(n, k[b], A[b], f, used, 1.0, k[b], left);
            if (G) {
                take(k[b], m, transposed(B[b]), f, used, -1.0, m, right);
                add_product(n, k[b], m, gain, right, -1.0, left);
            } else if (!is_square)
                take(m, k[b], B[b], f, used, (double)sign, k[b], right);
            add_product(n, w, k[b], left, is_square ? left : right, 1.0, sum);
        }
        if (is_square)
            mirror(n, sum);
        put(n, w, sum, w, used, C);
    }
    release(left);
    return 0;
}

static inline lanes chosen(flags which, lanes yes, lanes no) {
    return (lanes)((which & (flags)yes) | (~which & (flags)no));
}

static inline int any(flags which) {
    int64_t found = 0;
    for (int64_t q = 0; q < LANES; q++)
        found |= which[q];
    return found != 0;
}

static inline lanes power(number a) { return a.re * a.re + a.im * a.im; }

static void swap_rows(flags which, int64_t many, number *one, number *other) {
    for (int64_t j = 0; j < many; j++) {
        number a = one[j], b = other[j];
        one[j].re = chosen(which, b.re, a.re);
        one[j].im = chosen(which, b.im, a.im);
        other[j].re = chosen(which, a.re, b.re);
        other[j].im = chosen(which, a.im, b.im);
    }
}

/* The row of the largest number in column k, from row k on, becomes row k of Z (n, 2 n); its power, line by line. */
static lanes pivot(int64_t n, int64_t k, number *Z) {
    lanes best = power(Z[k * 2 * n + k]), row = best * 0 + (double)k;
    for (int64_t i = k + 1; i < n; i++) {
        lanes here = power(Z[i * 2 * n + k]);
        flags larger = here > best;
        best = chosen(larger, here, best);
        row = chosen(larger, here * 0 + (double)i, row);
    }
    for (int64_t i = k + 1; i < n; i++) {
        flags which = row == (double)i;
        if (any(which))
            swap_rows(which, 2 * n - k, Z + k * 2 * n + k, Z + i * 2 * n + k);
    }
    return best;
}

/* Z = [A, 1] (n, 2 n) to [R, L^-1], and its right half to A^-1; which lines have no inverse. */
static flags invert(int64_t n, number *Z) {
    int64_t w = 2 * n;
    flags singular = {0};
    for (int64_t k = 0; k < n; k++) {
        lanes size = pivot(n, k, Z);
        number share, *row = Z + k * w, one = {row[k].re / size, -row[k].im / size};
        singular |= size == 0.0;
        row[k] = one;
        for (int64_t i = k + 1; i < n; i++) {
            share = product(Z[i * w + k], one);
            for (int64_t j = k + 1; j < w; j++)
                less_product(&Z[i * w + j], share, row[j]);
        }
    }
    for (int64_t k = n - 1; k >= 0; k--)
        for (int64_t j = n; j < w; j++) {
            number x = Z[k * w + j];
            for (int64_t i = k + 1; i < n; i++)
                less_product(&x, Z[k * w + i], Z[i * w + j]);
            Z[k * w + j] = product(x, Z[k * w + k]);
        }
    return singular;
}

/* A^-1 by elimination with the largest number of a column as its pivot; n_singular: how many have none. */
KERNEL(inverse)(int64_t F, int64_t n, const stack *A, double *found, int64_t *n_singular) {
    size_t size = (size_t)(2 * n * n) * sizeof(number);
    number *Z = zeros(2 * n * n);
    if (!Z)
        return 1;
    for (int64_t f = 0; f < F; f += LANES, found += 2 * n * n * LANES) {
        int64_t used = F - f < LANES ? F - f : LANES;
        memset(Z, 0, size);
        take(n, n, *A, f, used, 1.0, 2 * n, Z);
        for (int64_t i = 0; i < n; i++)
            Z[i * 2 * n + n + i].re += 1.0;
        flags singular = invert(n, Z);
        for (int64_t q = 0; q < used; q++)
            *n_singular += singular[q] != 0;
        put(n, n, Z + n, 2 * n, used, found);
    }
    release(Z);
    return 0;
}

static inline lanes root(lanes x) {
    lanes found;
    for (int64_t q = 0; q < LANES; q++)
        found[q] = sqrt(x[q]);
    return found;
}

/* Turns columns x and y (n,) of X (n, m) to be orthogonal; returns where they were not, to rounding. */
static flags turn(int64_t n, int64_t m, number *x, number *y) {
    lanes a = {0}, b = {0}, zero = {0}, one = zero + 1.0;
    number g = {{0}, {0}};
    for (int64_t i = 0; i < n * m; i += m) {
        a += power(x[i]);
        b += power(y[i]);
        g.re = g.re + x[i].re * y[i].re + x[i].im * y[i].im;
        g.im = g.im + x[i].re * y[i].im - x[i].im * y[i].re;
    }
    lanes both = power(g);
    flags turned = both > (double)(n * n) * EPSILON * EPSILON * a * b;
    if (!any(turned))
        return turned;
    lanes size = root(chosen(turned, both, one)), z = (b - a) / (2 * size), distance = chosen(z < 0, -z, z);
    lanes tangent = one / (distance + root(one + z * z));
    tangent = chosen(turned, chosen(z < 0, -tangent, tangent), zero);
    lanes c = one / root(one + tangent * tangent), s = c * tangent;
    number phase = {chosen(turned, g.re / size, one), chosen(turned, -g.im / size, zero)};
    for (int64_t i = 0; i < n * m; i += m) {
        number p = x[i], q = product(y[i], phase);
        x[i].re = c * p.re - s * q.re;
        x[i].im = c * p.im - s * q.im;
        y[i].re = s * p.re + c * q.re;
        y[i].im = s * p.im + c * q.im;
    }
    return turned;
}

/* X (many,) over its size, so that fourth powers neither overflow nor vanish; returns the size. */
static lanes scaled(int64_t many, number *X) {
    lanes size = {0};
    for (int64_t i = 0; i < many; i++)
        size += power(X[i]);
    size = root(size);
    size = chosen(size > 0, size, size * 0 + 1.0);
    for (int64_t i = 0; i < many; i++) {
        X[i].re /= size;
        X[i].im /= size;
    }
    return size;
}

/* Pairs of the columns of X (n, m) are turned until all are orthogonal. */
static void turn_all(int64_t n, int64_t m, number *X) {
    int turned = 1;
    for (int64_t sweep = 0; turned && sweep < MAX_SWEEPS; sweep++) {
        turned = 0;
        for (int64_t i = 0; i < m; i++)
            for (int64_t j = i + 1; j < m; j++)
                turned |= any(turn(n, m, X + i, X + j));
    }
}

/* Lengths (F, m) of the orthogonal columns of A V, A (F, n, m), V unitary: where m <= n, A's singular values. */
KERNEL(singular_values)(int64_t F, int64_t n, int64_t m, const stack *A, double *found) {
    number *X = zeros(n * m);
    if (!X)
        return 1;
    for (int64_t f = 0; f < F; f += LANES) {
        int64_t used = F - f < LANES ? F - f : LANES;
        take(n, m, *A, f, used, 1.0, m, X);
        lanes size = scaled(n * m, X);
        turn_all(n, m, X);
        for (int64_t j = 0; j < m; j++) {
            lanes value = {0};
            for (int64_t i = 0; i < n; i++)
                value += power(X[i * m + j]);
            value = size * root(value);
            for (int64_t q = 0; q < used; q++)
                found[(f + q) * m + j] = value[q];
        }
    }
    release(X);
    return 0;
}
