/* Friction of one element with memory along a motion, for `friction/operators.py`, whose words and rules these are. */

#include <math.h>

#include "registers.h"

static double clipped(double s, double D) { return s < -D ? -D : s > D ? D : s; }

/* From a state on, over a way without turning points. */
static double slid(double s, double way, double D) {
    double end = copysign(D, way);
    return end + (s - end) * exp(-fabs(way) / D);
}

/* States at the turning points (turns + 1,), then s (n,): of a stop operator, or of a bristle. */
KERNEL(element)(int64_t turns, int64_t n, int64_t is_bristle, const double *threshold, const double *steps,
                const int64_t *last, const double *moved, double *states, double *s) {
    double D = *threshold;
    states[0] = 0.0;
    for (int64_t i = 0; i < turns; i++)
        states[i + 1] = is_bristle ? slid(states[i], steps[i], D) : clipped(states[i] + steps[i], D);
    for (int64_t i = 0; i < n; i++)
        s[i] = is_bristle ? slid(states[last[i]], moved[i], D) : clipped(states[last[i]] + moved[i], D);
    return 0;
}
