${comment}#include "move.h"

static const double position[${n}][${m}] = {
${position}};

static const double velocity[${n}][${m}] = {
${velocity}};

static const double torque[${n}][${m}] = {
${torque}};

int move_at(double t, double q[${m}], double v[${m}], double u[${m}]) {
  const double step = ${step};
  double x = t / step;
  int over = t >= ${last} * step, k, held;
  if (!(x > 0)) x = 0;
  if (over) x = ${last};
  k = (int)x;
  held = (int)(x + 1e-6); /* the time of a sample may round to just below it */
  if (k > ${cells} - 1) k = ${cells} - 1;
  x -= k;
  for (int j = 0; j < ${m}; j++) {
    const double a = position[k][j], b = position[k + 1][j], c = step * velocity[k][j], d = step * velocity[k + 1][j];
    const double e = b - a;
    q[j] = a + x * (c + x * (3 * e - 2 * c - d + x * (c + d - 2 * e)));
    v[j] = (c + x * (2 * (3 * e - 2 * c - d) + 3 * x * (c + d - 2 * e))) / step;
    u[j] = torque[held][j];
  }
  return over;
}
