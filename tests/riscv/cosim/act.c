/* Commands what the smoothed track asks for. */
#include <stdint.h>

uint64_t smooth[8], command;

void act(void) {
    command = 0;
    for (int i = 0; i < 8; i++) command += smooth[i];
}
