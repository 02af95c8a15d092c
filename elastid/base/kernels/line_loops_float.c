/* The sums over lines of `line_loops.c` with moments of half the digits. */

#define REAL float
#include "line_loops.c"
