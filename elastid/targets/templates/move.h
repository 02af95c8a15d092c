${comment}#ifndef MOVE_H
#define MOVE_H
#define MOVE_JOINTS ${m}
#define MOVE_DURATION ${duration}
int move_at(double t, double q[${m}], double v[${m}], double u[${m}]);
#endif
