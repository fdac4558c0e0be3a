/* The buffers in main memory through which the tasks, the sensors and the actuators exchange data.
 *
 * Each is one structure of whole 8-byte words, and the overlay gives its size. At power-up all of them are 0, so a
 * message counts only where `valid` is set. `stamp` is the number of the scan on which a message is based.
 * What a task keeps from job to job is a buffer as well, since its program is loaded anew for every job.
 */
#ifndef MESSAGES_H
#define MESSAGES_H

#include "fixed.h"

#define BEAMS 181                                       /* over 270 degrees, from right to left */
#define BEAM_FIRST DEGREES(-135)
#define BEAM_STEP DEGREES(1.5)
#define PARTICLES_KEPT 300
#define OPPONENTS_KEPT 4
#define PATH_POINTS 28

/* From the lidar. Ranges in millimetres, 0 where nothing came back. */
struct scan {
  uint32_t stamp, valid;
  uint16_t range[BEAMS + 3];
};

/* From wheel encoder and gyroscope, counted since power-up. */
struct odometry {
  uint32_t stamp, valid;
  q16 distance, speed;
  angle heading;
  uint32_t unused;
};

struct pose {
  uint32_t stamp, valid;
  q16 x, y;
  angle heading;
  q16 speed;
  q16 spread; /* standard deviation of the particles */
  uint32_t unused;
};

struct particle {
  q16 x, y;
  angle heading;
};

struct particles {
  uint32_t random, count;
  q16 distance;
  angle heading;
  struct particle of[PARTICLES_KEPT];
};

/* An opponent along the track: `s` from the start line, `d` to the left of the centre line. */
struct opponent {
  uint32_t seen, missed; /* scans since it was found, and since it was last seen */
  q16 s, d, speed, drift;
};

struct opponents {
  uint32_t stamp, count;
  struct opponent of[OPPONENTS_KEPT];
};

struct point {
  q16 x, y, speed, offset;
};

/* A path over consecutive stations of the centre line, the first of which is the number `station`. */
struct path {
  uint32_t stamp, valid, station, unused;
  struct point of[PATH_POINTS];
};

/* To motor and steering. The motor control keeps the speed by itself. */
struct command {
  uint32_t stamp, valid;
  q16 speed;
  int32_t steering; /* an angle, positive to the left */
};

#endif
