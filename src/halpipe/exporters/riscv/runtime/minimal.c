/* The functions that compilers call without being asked; a task may bring its own. */
#include <stddef.h>
#include <stdint.h>

#define WEAK __attribute__((weak))

int __clzdi2(uint64_t value);
int __ctzdi2(uint64_t value);
int __popcountdi2(uint64_t value);

WEAK void *memcpy(void *restrict target, const void *restrict source, size_t size) {
    char *to = target;
    const char *from = source;
    while (size--) *to++ = *from++;
    return target;
}

WEAK void *memmove(void *target, const void *source, size_t size) {
    char *to = target;
    const char *from = source;
    if (to < from) {
        while (size--) *to++ = *from++;
    } else {
        while (size--) to[size] = from[size];
    }
    return target;
}

WEAK void *memset(void *target, int value, size_t size) {
    char *to = target;
    while (size--) *to++ = (char)value;
    return target;
}

WEAK int memcmp(const void *left, const void *right, size_t size) {
    const unsigned char *a = left, *b = right;
    for (; size--; a++, b++) {
        if (*a != *b) return *a - *b;
    }
    return 0;
}

WEAK int __clzdi2(uint64_t value) {
    int zeros = 64;
    for (; value; value >>= 1) zeros--;
    return zeros;
}

WEAK int __ctzdi2(uint64_t value) {
    int zeros = 0;
    for (; zeros < 64 && !(value & 1); value >>= 1) zeros++;
    return zeros;
}

WEAK int __popcountdi2(uint64_t value) {
    int ones = 0;
    for (; value; value &= value - 1) ones++;
    return ones;
}
