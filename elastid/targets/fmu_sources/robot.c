/* Runge-Kutta steps of the robot between the samples of its controller; equations.c has the robot itself. */
#include "robot.h"

#include <math.h>
#include <string.h>

#include "equations.h"
#include "start.h" /* START_VALUES, START_POSTURES, START_TORQUES */
#if HAS_MOVE
#include "move.h"
#endif

/* A sample that is nearer than this part of its period is due now. */
#define DUE 1e-9

typedef double Coordinates[N_Q];

static void call(int (*function)(const double **, double **, casadi_int *, double *, int), const double **arg,
                 double **res) {
  casadi_int iw[N_IW + 1];
  double w[N_W + 1];
  function(arg, res, iw, w, 0);
}

static void accelerate(const Robot *robot, const double *q, const double *v, const double *z, const double *u,
                       double *a) {
  const double *arg[N_ARG + 1] = {q,
                                  v,
                                  z,
                                  u,
                                  robot->value + OF_FORCE,
                                  robot->value + OF_THETA,
                                  robot->value + OF_FRICTION};
  double *res[N_RES + 1] = {a};
  call(acceleration, arg, res);
}

static void bend(const Robot *robot, const double *z, const double *v, double step, double *bent) {
  const double *arg[N_ARG + 1] = {z, v, robot->value + OF_FRICTION, &step};
  double *res[N_RES + 1] = {bent};
  call(bristles, arg, res);
}

static void moved(const double *x, double step, const double *rate, double *to) {
  for (int i = 0; i < N_Q; i++) to[i] = x[i] + step * rate[i];
}

/* One classical Runge-Kutta step; states of friction advance exactly with the velocity of each stage. */
static void take(Robot *robot, const double *u, double step) {
  Coordinates a1, a2, a3, a4, v2, v3, v4, q2, mean, sum;
  double bent[N_Z + 1];
  accelerate(robot, robot->q, robot->v, robot->z, u, a1);
  moved(robot->v, step / 2, a1, v2);
  moved(robot->q, step / 2, robot->v, q2);
  bend(robot, robot->z, robot->v, step / 2, bent);
  accelerate(robot, q2, v2, bent, u, a2);
  moved(robot->v, step / 2, a2, v3);
  moved(robot->q, step / 2, v2, q2);
  bend(robot, robot->z, v2, step / 2, bent);
  accelerate(robot, q2, v3, bent, u, a3);
  moved(robot->v, step, a3, v4);
  moved(robot->q, step, v3, q2);
  bend(robot, robot->z, v3, step, bent);
  accelerate(robot, q2, v4, bent, u, a4);
  for (int i = 0; i < N_Q; i++) {
    mean[i] = (robot->v[i] + 2 * v2[i] + 2 * v3[i] + v4[i]) / 6;
    sum[i] = a1[i] + 2 * a2[i] + 2 * a3[i] + a4[i];
  }
  bend(robot, robot->z, mean, step, bent);
  moved(robot->q, step, mean, robot->q);
  moved(robot->v, step / 6, sum, robot->v);
  memcpy(robot->z, bent, sizeof(double) * N_Z);
}

static void close_loops(Robot *robot) {
#if HAS_LOOPS
  Coordinates q, v;
  const double *arg[N_ARG + 1] = {robot->q, robot->v, robot->value + OF_THETA};
  double *res[N_RES + 1] = {q, v};
  call(closing, arg, res);
  memcpy(robot->q, q, sizeof q);
  memcpy(robot->v, v, sizeof v);
#else
  (void)robot;
#endif
}

static void read_angles(const Robot *robot, double *angle, double *speed, double *joint, double *place) {
  const double *arg[N_ARG + 1] = {robot->q, robot->v};
  double *res[N_RES + 1] = {angle, speed, joint, place};
  call(readings, arg, res);
}

/* Angles, speeds and torques of the move inside at a sample, from the first on; zero where there is none. The speed is
   the difference of angles, as the feedback takes that of its readings. */
static void move_inside(long long samples, double rate, double *angle, double *speed, double *torque) {
#if HAS_MOVE
  double before[N_U], unused[N_U];
  move_at((double)(samples - 1) / rate, before, speed, unused);
  move_at((double)samples / rate, angle, speed, torque);
  for (int i = 0; i < N_U; i++) speed[i] = (angle[i] - before[i]) * rate;
#else
  (void)samples;
  (void)rate;
  for (int i = 0; i < N_U; i++) angle[i] = speed[i] = torque[i] = 0;
#endif
}

/* The torque of a sample, held until the next: feedback, and that of the move inside. */
static void sample(Robot *robot) {
  const double *value = robot->value, rate = value[OF_RATE];
  double angle[N_U], speed[N_U], joint[N_L], place[N_P], move[N_U], moving[N_U], torque[N_U];
  read_angles(robot, angle, speed, joint, place);
  move_inside(robot->samples, rate, move, moving, torque);
  for (int i = 0; i < N_U; i++) {
    const double aim = value[OF_POSITION + i] + move[i], aim_speed = value[OF_VELOCITY + i] + moving[i];
    const double error = value[OF_KP + i] * (aim - angle[i]) +
                         value[OF_KD + i] * (aim_speed - (angle[i] - robot->last[i]) * rate);
    robot->held[i] = torque[i] + error + value[OF_KI + i] * robot->integral[i];
    robot->integral[i] += error / rate;
    robot->last[i] = angle[i];
  }
}

int robot_may_set(int reference, int started) {
  if (reference >= OF_TORQUE && reference < OF_OUTPUTS) return 1;
  if (reference == OF_RATE || reference == OF_STEP) return !started;
  return reference >= OF_THETA && reference < N_VALUES;
}

void robot_reset(Robot *robot) {
  memset(robot, 0, sizeof *robot);
  memcpy(robot->value, START_VALUES, sizeof START_VALUES);
  robot->configuration = 1;
  robot_start(robot);
  robot->started = 0;
}

int robot_start(Robot *robot) {
  if (robot->configuration < 1 || robot->configuration > N_POSTURES) return 1;
  if (!(robot->value[OF_RATE] > 0) || !(robot->value[OF_STEP] > 0)) return 1;
  memcpy(robot->q, START_POSTURES[robot->configuration - 1], sizeof robot->q);
  memset(robot->v, 0, sizeof robot->v);
  memset(robot->z, 0, sizeof robot->z);
  memset(robot->integral, 0, sizeof robot->integral);
  memset(robot->held, 0, sizeof robot->held);
  double speed[N_U], joint[N_L], place[N_P];
  read_angles(robot, robot->last, speed, joint, place);
  robot->samples = 0;
  robot->sampled_at = robot->time;
  robot->started = 1;
  robot_outputs(robot);
  return 0;
}

void robot_outputs(Robot *robot) {
  double *value = robot->value;
  value[0] = robot->time;
  read_angles(robot, value + OF_ANGLE, value + OF_SPEED, value + OF_JOINT, value + OF_PLACE);
  for (int i = 0; i < N_U; i++) {
    value[OF_APPLIED + i] = value[OF_TORQUE + i] + robot->held[i];
    value[OF_HOLDING + i] = START_TORQUES[robot->configuration - 1][i];
  }
}

static int is_finite(const Robot *robot) {
  for (int i = 0; i < N_Q; i++)
    if (!isfinite(robot->q[i]) || !isfinite(robot->v[i])) return 0;
  return 1;
}

int robot_advance(Robot *robot, double step) {
  const double end = robot->time + step, period = 1 / robot->value[OF_RATE];
  while (robot->time < end - DUE * period) {
    double due = robot->sampled_at + (double)robot->samples * period;
    if (due <= robot->time + DUE * period) {
      sample(robot);
      robot->samples++;
      due = robot->sampled_at + (double)robot->samples * period;
    }
    const double stop = due < end - DUE * period ? due : end, length = stop - robot->time;
    const int count = (int)ceil(length / robot->value[OF_STEP] - 1e-6);
    const int steps = count > 1 ? count : 1;
    double u[N_U];
    for (int i = 0; i < N_U; i++) u[i] = robot->value[OF_TORQUE + i] + robot->held[i];
    for (int i = 0; i < steps; i++) take(robot, u, length / steps);
    close_loops(robot);
    robot->time = stop;
    if (!is_finite(robot)) return 1;
  }
  robot_outputs(robot);
  return 0;
}
