/* Registers of the processor level that a file is compiled for: bytes of a vector, rows and columns of numbers that fit
   at once, names of the exported functions. Each kernel is compiled once for each LEVEL (`scripts/kernels_hook.py`). */

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

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif
#define JOIN_WORDS(name, level) name##_##level
#define JOIN(name, level) JOIN_WORDS(name, level)
#define KERNEL(name) EXPORTED int JOIN(name, LEVEL)

#if defined(_WIN32)
#include <malloc.h>
#define allocate(bytes) _aligned_malloc(bytes, WIDTH)
#define release _aligned_free
#else
#define allocate(bytes) aligned_alloc(WIDTH, bytes)
#define release free
#endif
