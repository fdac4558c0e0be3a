/* Smooths what sense found, in as many rounds as the version has. */
#include <stdint.h>

uint64_t track[8], smooth[8];

void filter(void) {
    uint64_t value[8];
    for (int i = 0; i < 8; i++) value[i] = track[i];
    for (int round = 0; round < ROUNDS; round++) {
        for (int i = 1; i < 7; i++) value[i] = (value[i - 1] + 2 * value[i] + value[i + 1]) / 4;
    }
    for (int i = 0; i < 8; i++) smooth[i] = value[i];
}
