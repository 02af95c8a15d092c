/* Steps of rigid joints under commands, for `simulation/rigid_joints.py`, which has the equations. */

#include <math.h>

#include "registers.h"

static double least(double a, double b) { return a < b ? a : b; }

static double greatest(double a, double b) { return a > b ? a : b; }

/* Positions (N, P) at the start of each of N samples of many steps; state (3, P): q, q' and w, advanced in place.
   rows (14, P): coefficients in the order of `Coefficients`.  torque (N * steps, T), of which column of[p] is p's. */
KERNEL(rigid_joints)(int64_t P, int64_t N, int64_t steps, int64_t T, const double *step_s, const double *rows,
                     const int64_t *of, const double *torque, double *state, double *positions) {
    const double *b = rows, *gain = b + P, *spring = gain + P, *stick = spring + P, *decay = stick + P,
                 *offset = decay + P, *G = offset + P, *H = G + P, *F_c = H + P, *excess = F_c + P,
                 *nu_s = excess + P, *s = nu_s + P, *lag = s + P, *lag_gain = lag + P;
    double h = *step_s, *x = state, *v = x + P, *w = v + P, *friction = allocate((size_t)((2 * P + 8) / 8 * 8) * 8);
    if (!friction)
        return 1;
    double *balance = friction + P;
    for (int64_t k = 0; k < N * steps; k++, torque += T) {
        if (k % steps == 0)
            memcpy(positions + k / steps * P, x, (size_t)P * sizeof(double));
        for (int64_t p = 0; p < P; p++) { /* functions that have no vectors */
            double middle = x[p] + h / 2 * v[p], speed = v[p] / nu_s[p];
            balance[p] = torque[of[p]] - offset[p];
            if (G[p] != 0.0 || H[p] != 0.0)
                balance[p] -= G[p] * cos(middle) + H[p] * sin(middle);
            friction[p] = excess[p] > 0.0 ? F_c[p] + excess[p] * exp(-speed * speed) : F_c[p];
        }
        for (int64_t p = 0; p < P; p++) {
            double F = friction[p], free_v = b[p] * v[p] + gain[p] * balance[p] - spring[p] * x[p];
            double limit = gain[p] * F, change = stick[p] * (free_v - decay[p] * v[p]);
            double rigid_v = free_v - greatest(least(change, limit), -limit);
            double slip = free_v - gain[p] * w[p], sign = slip > 0.0 ? 1.0 : slip < 0.0 ? -1.0 : 0.0;
            double B = F * (s[p] + gain[p] * (h + lag[p])) - h * sign * (free_v + lag_gain[p] * w[p]);
            double speed = (sqrt(B * B + 4.0 * h * F * s[p] * fabs(slip)) - B) / (2.0 * h);
            double next_w = F * (s[p] * w[p] + h * sign * speed) / greatest(F * s[p] + h * speed, 1e-300);
            double next_v = s[p] > 0.0 ? sign * speed : rigid_v;
            w[p] = s[p] > 0.0 ? next_w : w[p];
            x[p] += h / 2.0 * (v[p] + next_v);
            v[p] = next_v;
        }
    }
    release(friction);
    return 0;
}
