/* Keeps a running mean of eight samples, and counts its jobs. */
#include <stdint.h>

uint64_t sample[8], state[4], track[8];
static uint64_t scratch[64]; /* has to be zero in every job */

void sense(void) {
    state[0]++;
    for (int i = 0; i < 64; i++) scratch[i] += state[0];
    for (int i = 0; i < 8; i++) {
        state[1] = (7 * state[1] + 8 * sample[i]) / 8;
        track[i] = state[1] + scratch[i] - state[0];
    }
}
