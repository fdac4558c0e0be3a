/* What is taken for a message must look like one: numbers that no car can have are not computed with.
 * So whatever lies in a buffer, a task stays within its arrays and its numbers within 32 bits.
 */
#ifndef CHECKS_H
#define CHECKS_H

#include "messages.h"
#include "track.h"

#define GROUND (64 * ONE)  /* farther away is nothing */
#define FAST (20 * ONE)    /* faster is nobody */
#define STEERING_LIMIT DEGREES(24)

static inline int between(int32_t a, int32_t low, int32_t high) { return a >= low && a <= high; }
static inline int on_ground(q16 x, q16 y) { return between(x, -GROUND, GROUND) && between(y, -GROUND, GROUND); }

static inline int good_scan(const struct scan *m) { return m->valid == 1; }

static inline int good_odometry(const struct odometry *m) { return m->valid == 1 && between(m->speed, -FAST, FAST); }

static inline int good_pose(const struct pose *m) {
  return m->valid == 1 && on_ground(m->x, m->y) && between(m->speed, -FAST, FAST);
}

static inline int good_particles(const struct particles *m) {
  if (m->count == 0 || m->count > PARTICLES_KEPT || m->random == 0) return 0;
  for (uint32_t i = 0; i < m->count; i++)
    if (!on_ground(m->of[i].x, m->of[i].y)) return 0;
  return 1;
}

static inline int good_opponents(const struct opponents *m) {
  if (m->count > OPPONENTS_KEPT) return 0;
  for (uint32_t i = 0; i < m->count; i++) {
    const struct opponent *o = &m->of[i];
    if (!between(o->s, 0, track_length - 1) || !between(o->d, -half_width, half_width)) return 0;
    if (!between(o->speed, -FAST, FAST) || !between(o->drift, -FAST, FAST)) return 0;
  }
  return 1;
}

static inline int good_path(const struct path *m) {
  if (m->valid != 1 || m->station >= STATIONS) return 0;
  for (int i = 0; i < PATH_POINTS; i++) {
    const struct point *p = &m->of[i];
    if (!on_ground(p->x, p->y) || !between(p->speed, 0, FAST) || !between(p->offset, -GROUND, GROUND)) return 0;
  }
  return 1;
}

static inline int good_command(const struct command *m) {
  return between(m->speed, 0, FAST) && between(m->steering, -STEERING_LIMIT, STEERING_LIMIT);
}

#endif
