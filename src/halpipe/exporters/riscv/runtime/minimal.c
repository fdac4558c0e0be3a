/* The functions that compilers call without being asked; a task may bring its own. */
#include <stddef.h>
#include <stdint.h>

#define WEAK __attribute__((weak))
#define BITS 64

WEAK void *memcpy(void *restrict target, const void *restrict source, size_t size);
WEAK void *memmove(void *target, const void *source, size_t size);
WEAK void *memset(void *target, int value, size_t size);
WEAK int memcmp(const void *left, const void *right, size_t size);
WEAK int __clzdi2(uint64_t value);
WEAK int __ctzdi2(uint64_t value);
WEAK int __popcountdi2(uint64_t value);

WEAK void *memcpy(void *restrict target, const void *restrict source, size_t size) {
    uint8_t *to = target;
    const uint8_t *from = source;
    for (size_t i = 0U; i < size; i++) {
        to[i] = from[i];
    }
    return target;
}

WEAK void *memmove(void *target, const void *source, size_t size) {
    uint8_t *to = target;
    const uint8_t *from = source;
    if ((uintptr_t)target < (uintptr_t)source) {
        for (size_t i = 0U; i < size; i++) {
            to[i] = from[i];
        }
    } else {
        for (size_t left = size; left > 0U; left--) {
            to[left - 1U] = from[left - 1U];
        }
    }
    return target;
}

WEAK void *memset(void *target, int value, size_t size) {
    uint8_t *to = target;
    for (size_t i = 0U; i < size; i++) {
        to[i] = (uint8_t)value;
    }
    return target;
}

WEAK int memcmp(const void *left, const void *right, size_t size) {
    const uint8_t *a = left;
    const uint8_t *b = right;
    int result = 0;
    for (size_t i = 0U; (i < size) && (result == 0); i++) {
        result = (int)a[i] - (int)b[i];
    }
    return result;
}

WEAK int __clzdi2(uint64_t value) {
    int zeros = BITS;
    for (uint64_t rest = value; rest != 0U; rest >>= 1U) {
        zeros--;
    }
    return zeros;
}

WEAK int __ctzdi2(uint64_t value) {
    int zeros = 0;
    for (uint64_t rest = value; (zeros < BITS) && ((rest & 1U) == 0U); rest >>= 1U) {
        zeros++;
    }
    return zeros;
}

WEAK int __popcountdi2(uint64_t value) {
    int ones = 0;
    for (uint64_t rest = value; rest != 0U; rest &= rest - 1U) {
        ones++;
    }
    return ones;
}
