/* The level of the processor at hand, and the sources that the library was built from. */

#include "registers.h"

#if defined(__x86_64__) || defined(_M_X64)
#include <cpuid.h>

#define AVX512 (1u << 16 | 1u << 17 | 1u << 28 | 1u << 30 | 1u << 31) /* f, dq, cd, bw, vl */

/* Bits of the vector registers that the operating system saves. */
static unsigned saved_registers(void) {
    unsigned low, high;
    __asm__ volatile(".byte 0x0f, 0x01, 0xd0" : "=a"(low), "=d"(high) : "c"(0)); /* xgetbv */
    return low;
}

/* Intel's manual, volume 1, sections 14.3 (AVX), 14.5.3 (FMA) and 15.2 (AVX-512). */
static const char *level(void) {
    const unsigned fma = 1u << 12, osxsave = 1u << 27, avx = 1u << 28, avx2 = 1u << 5;
    unsigned a, b, c, d;
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & (fma | osxsave | avx)) != (fma | osxsave | avx))
        return "portable";
    unsigned saved = saved_registers();
    if ((saved & 0x6) != 0x6 || !__get_cpuid_count(7, 0, &a, &b, &c, &d) || !(b & avx2))
        return "portable";
#if !defined(__APPLE__) /* whose system saves these registers from their first use on alone */
    if ((saved & 0xe6) == 0xe6 && (b & AVX512) == AVX512)
        return "avx512";
#endif
    return "avx2";
}
#else
static const char *level(void) { return "portable"; }
#endif

EXPORTED const char *processor_level(void) { return level(); }

/* SHA-256 of the C files, so that a library of other sources is noticed. */
EXPORTED const char *sources(void) { return SOURCES; }
