/* What instructions of LLVM IR mean where C99 has no operator for it. Whole numbers have no sign here; of those that
   are narrower than their type the upper bits are zero. Results that IR leaves open are those of x86-64. */
#ifndef FLEXMBD_KERNEL_WORDS_H
#define FLEXMBD_KERNEL_WORDS_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#if !defined(__GNUC__) || defined(__clang__) /* gcc does so with -std=c99, and does not know the words */
#pragma STDC FP_CONTRACT OFF
#endif

#if UINTPTR_MAX != UINT64_MAX
#error "A machine's kernels need addresses of 64 bits."
#endif
#if defined(__BYTE_ORDER__) && defined(__ORDER_LITTLE_ENDIAN__) && __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "A machine's memory is written with the lowest byte first, and this processor reads the highest first."
#endif

#define AT(p) ((void *)(uintptr_t)(p))
#define MEMORY(name, type) \
    static inline type load_##name(uint64_t p) { type v; memcpy(&v, AT(p), sizeof v); return v; } \
    static inline void store_##name(uint64_t p, type v) { memcpy(AT(p), &v, sizeof v); }
MEMORY(f64, double)
MEMORY(f32, float)
MEMORY(i64, uint64_t)
MEMORY(i32, uint32_t)
MEMORY(i16, uint16_t)
MEMORY(i8, uint8_t)

static inline double f64_of(uint64_t bits) { double v; memcpy(&v, &bits, sizeof v); return v; }
static inline float f32_of(uint32_t bits) { float v; memcpy(&v, &bits, sizeof v); return v; }
static inline uint64_t bits_f64(double v) { uint64_t bits; memcpy(&bits, &v, sizeof bits); return bits; }
static inline uint32_t bits_f32(float v) { uint32_t bits; memcpy(&bits, &v, sizeof bits); return bits; }

/* A number of so many bits with its sign. */
static inline int64_t sign(uint64_t v, int bits) {
    uint64_t top = (uint64_t)1 << (bits - 1);
    return (int64_t)((v ^ top) - top);
}
static inline int64_t shifted(int64_t v, int by) { return v < 0 ? ~(~v >> by) : v >> by; }

static inline int unordered(double a, double b) { return isnan(a) || isnan(b); }

/* Whether a number is of one of the classes whose bits a mask has, in LLVM's order: NaNs (two), then from -inf to inf. */
static inline uint8_t of_class(double v, unsigned mask) {
    int below = signbit(v) != 0;
    unsigned of = isnan(v) ? 3u
        : isinf(v) ? (below ? 4u : 512u)
        : v == 0.0 ? (below ? 32u : 64u)
        : fabs(v) < 0x1p-1022 ? (below ? 16u : 128u)
        : (below ? 8u : 256u);
    return (of & mask) != 0;
}

static inline uint64_t whole(double v) {
    return v >= -0x1p63 && v < 0x1p63 ? (uint64_t)(int64_t)v : (uint64_t)1 << 63;
}
static inline uint32_t whole32(double v) {
    return v > -0x1.00000002p31 && v < 0x1p31 ? (uint32_t)(int32_t)v : (uint32_t)1 << 31;
}
static inline uint64_t unsigned_whole(double v) {
    return v >= 0x1p63 ? (v < 0x1p64 ? (uint64_t)v : UINT64_MAX) : whole(v);
}

/* Whether a product with or without signs has more than so many bits. */
static inline int long_product(uint64_t a, uint64_t b, uint64_t most) { return a != 0 && b > most / a; }
static inline int long_signed_product(int64_t a, int64_t b, int bits) {
    uint64_t u = a < 0 ? 0 - (uint64_t)a : (uint64_t)a, v = b < 0 ? 0 - (uint64_t)b : (uint64_t)b;
    uint64_t top = (uint64_t)1 << (bits - 1);
    return long_product(u, v, (a < 0) != (b < 0) ? top : top - 1);
}

static inline uint64_t ones(uint64_t v) {
    uint64_t count = 0;
    for (; v; v &= v - 1)
        count++;
    return count;
}
static inline uint64_t zeros_above(uint64_t v, int bits) {
    uint64_t count = 0;
    for (int k = bits - 1; k >= 0 && !(v >> k & 1); k--)
        count++;
    return count;
}
static inline uint64_t zeros_below(uint64_t v, int bits) {
    uint64_t count = 0;
    for (int k = 0; k < bits && !(v >> k & 1); k++)
        count++;
    return count;
}

static inline double whole_power(double a, uint32_t exponent) {
    int negative = exponent >> 31 != 0;
    double found = 1.0;
    for (uint32_t n = negative ? 0 - exponent : exponent; n; n >>= 1, a *= a)
        if (n & 1)
            found *= a;
    return negative ? 1.0 / found : found;
}

static inline void copy(uint64_t to, uint64_t from, uint64_t size) {
    if (size)
        memmove(AT(to), AT(from), size);
}
static inline void fill(uint64_t to, uint8_t value, uint64_t size) {
    if (size)
        memset(AT(to), value, size);
}

#endif
