/* In front of every file of loops: bytes of a vector register, and how many rows and columns of numbers fit at once. */

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(__AVX512F__)
#define WIDTH 64
#define TILE 3
#elif defined(__AVX__)
#define WIDTH 32
#define TILE 2
#else
#define WIDTH 16
#define TILE 2
#endif
