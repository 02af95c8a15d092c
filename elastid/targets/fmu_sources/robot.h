/* An elastic robot with friction under a sampled controller: what both versions of the interface call. */
#ifndef ROBOT_H
#define ROBOT_H

#include "sizes.h" /* N_* and OF_*: sizes of the robot, and the places of its variables */

typedef struct {
  double time;
  double value[N_VALUES]; /* all variables of type real by their value reference; value[0] stands for the time */
  int configuration;      /* from 1: the posture in which it starts, at rest */
  double q[N_Q], v[N_Q], z[N_Z + 1];
  double integral[N_U], last[N_U], held[N_U]; /* of the controller: integral, last reading, torque until its next sample */
  double sampled_at;   /* time of the controller's first sample, and number of those taken */
  long long samples;
  int started;
} Robot;

void robot_reset(Robot *robot);
int robot_may_set(int reference, int started);
/* 0, or 1 where the configuration does not exist or a state is not finite. */
int robot_start(Robot *robot);
int robot_advance(Robot *robot, double step);
void robot_outputs(Robot *robot);

#endif
