/* Local planning on a field over the next stations of the track: the race line attracts, walls and opponents repel.
 *
 * The path is the cheapest way through the field (dynamic programming over offsets), smoothed. Its speed is what
 * curves, brakes, and opponents that block it allow. Opponents are where they will be when the car gets there.
 *
 * A version states OPPONENTS (0: nobody else on the track) and SPEED_LIMIT in cm/s.
 */
#include "checks.h"

#ifndef OPPONENTS
#define OPPONENTS 1
#endif
#ifndef SPEED_LIMIT
#define SPEED_LIMIT 340
#endif

#define LANES 15                  /* offsets of the grid, from right to left */
#define LANE Q16(0.1)
#define OFFSET(j) (((j) - LANES / 2) * LANE)
#define FASTEST ((q16)((int64_t)SPEED_LIMIT * ONE / 100))
#define SIDEWAYS Q16(4.8)         /* acceleration in curves, m/s^2 */
#define BRAKING Q16(3.0)
#define OUTDATED 4                /* scans: what was seen before another mode does not count */

/* Weights of the field, in Q16.16 for each square metre. */
#define STEERING Q16(0.03)        /* for a change of lane from station to station */
#define STEADY Q16(0.6)           /* for leaving the path planned last */
#define REPULSION Q16(6)
#define WALL Q16(4)               /* for coming nearer to a wall than NEAR_WALL */
#define NEAR_WALL Q16(0.5)
#define LONG Q16(1.5)             /* an opponent repels as far as this along the track, */
#define WIDE Q16(0.75)            /* and this far across it */
#define ROOM Q16(0.5)             /* less across from middle to middle is no way past */
#define BEHIND Q16(0.9)           /* the distance kept to an opponent that blocks the path */

struct pose lp_pose;
struct opponents lp_opponents;
struct path lp_state;             /* the path planned last, kept from job to job */
struct path lp_path;              /* for pure pursuit */

static int32_t field[PATH_POINTS][LANES], cost[PATH_POINTS][LANES];
static int8_t came_from[PATH_POINTS][LANES];
static q16 offset[PATH_POINTS];

static q16 spacing(void) { return track_length / STATIONS; }
static int wrapped(int station) { return station >= STATIONS ? station - STATIONS : station; }

/* The offset at a station of the path planned last, if it goes there. */
static int planned_before(int station, q16 *d) {
  if (!lp_state.valid) return 0;
  int i = station - (int)lp_state.station;
  if (i < 0) i += STATIONS;
  if (i >= PATH_POINTS) return 0;
  *d = lp_state.of[i].offset;
  return 1;
}

/* What a wall adds to the field. */
static q16 wall(q16 d) {
  q16 near = larger(absolute(d) + NEAR_WALL - half_width, 0);
  return multiply(WALL, multiply(near, near));
}

static void attract(int first) {
  for (int i = 0; i < PATH_POINTS; i++) {
    int station = wrapped(first + i);
    q16 before = 0;
    int steady = planned_before(station, &before);
    for (int j = 0; j < LANES; j++) {
      q16 away = OFFSET(j) - stations[station].race_line, changed = OFFSET(j) - before;
      field[i][j] = multiply(away, away) + wall(OFFSET(j));
      if (steady) field[i][j] += multiply(STEADY, multiply(changed, changed));
    }
  }
}

#if OPPONENTS
/* Where an opponent is when the car reaches the station i: the way to it, and its offset. */
static q16 meeting(const struct opponent *o, q16 gap, int i, q16 *d) {
  q16 time = divide(i * spacing(), FASTEST);
  *d = o->d;
  return gap + multiply(larger(o->speed, 0), time) - i * spacing();
}

static void repel(q16 s) {
  for (uint32_t k = 0; k < lp_opponents.count; k++) {
    const struct opponent *o = &lp_opponents.of[k];
    q16 gap = ahead(s, o->s);
    for (int i = 0; i < PATH_POINTS; i++) {
      q16 d, way = absolute(meeting(o, gap, i, &d));
      if (way >= LONG) continue;
      q16 near = ONE - divide(way, LONG);
      for (int j = 0; j < LANES; j++) {
        q16 across = absolute(OFFSET(j) - d);
        if (across >= WIDE) continue;
        q16 beside = ONE - divide(across, WIDE);
        field[i][j] += multiply(REPULSION, multiply(near, multiply(beside, beside)));
      }
    }
  }
}

/* Whoever blocks the path is followed. */
static void follow(q16 s) {
  for (uint32_t k = 0; k < lp_opponents.count; k++) {
    const struct opponent *o = &lp_opponents.of[k];
    q16 gap = ahead(s, o->s);
    if (gap < 0) continue;
    int blocked = 0;
    for (int i = 0; i < PATH_POINTS; i++) {
      q16 d, way = absolute(meeting(o, gap, i, &d));
      blocked |= way < LONG / 2 && absolute(offset[i] - d) < ROOM;
    }
    q16 speed = larger(o->speed, 0);
    for (int i = 0; blocked && i < PATH_POINTS; i++) {
      q16 free = larger(gap - BEHIND - i * spacing(), 0);
      q16 limit = square_root_q16(multiply(speed, speed) + multiply(2 * BRAKING, free));
      lp_path.of[i].speed = smaller(lp_path.of[i].speed, limit);
    }
  }
}
#endif

/* The cheapest way from lane to lane, at most one to the side at each station. */
static void search(int start) {
  for (int j = 0; j < LANES; j++) cost[0][j] = j == start ? 0 : INT32_MAX / 2;
  for (int i = 1; i < PATH_POINTS; i++) {
    for (int j = 0; j < LANES; j++) {
      int32_t best = cost[i - 1][j];
      int8_t from = (int8_t)j;
      if (j > 0 && cost[i - 1][j - 1] + STEERING < best) {
        best = cost[i - 1][j - 1] + STEERING;
        from = (int8_t)(j - 1);
      }
      if (j < LANES - 1 && cost[i - 1][j + 1] + STEERING < best) {
        best = cost[i - 1][j + 1] + STEERING;
        from = (int8_t)(j + 1);
      }
      cost[i][j] = smaller(best + field[i][j], INT32_MAX / 2);
      came_from[i][j] = from;
    }
  }
  int lane = 0;
  for (int j = 1; j < LANES; j++)
    if (cost[PATH_POINTS - 1][j] < cost[PATH_POINTS - 1][lane]) lane = j;
  for (int i = PATH_POINTS - 1; i > 0; i--) {
    offset[i] = OFFSET(lane);
    lane = came_from[i][lane];
  }
}

static void smooth(void) {
  for (int pass = 0; pass < 6; pass++) {
    q16 last = offset[0];
    for (int i = 1; i < PATH_POINTS - 1; i++) {
      q16 own = offset[i];
      offset[i] = (last + 2 * own + offset[i + 1]) / 4;
      last = own;
    }
  }
}

static void place(int first) {
  for (int i = 0; i < PATH_POINTS; i++) {
    const struct station *at = &stations[wrapped(first + i)];
    lp_path.of[i].x = at->x - multiply(offset[i], at->sine);
    lp_path.of[i].y = at->y + multiply(offset[i], at->cosine);
    lp_path.of[i].offset = offset[i];
  }
}

/* The curvature of the circle through three points of the path. */
static q16 curvature(const struct point *a, const struct point *b, const struct point *c) {
  q16 ux = b->x - a->x, uy = b->y - a->y, vx = c->x - b->x, vy = c->y - b->y;
  q16 area = (q16)(((int64_t)ux * vy - (int64_t)uy * vx) >> 16);
  q16 sides = multiply(multiply(length(ux, uy), length(vx, vy)), length(ux + vx, uy + vy));
  return sides > 0 ? divide(2 * absolute(area), sides) : 0;
}

static void limit_speed(void) {
  for (int i = 0; i < PATH_POINTS; i++) {
    int middle = within(i, 2, PATH_POINTS - 3);
    q16 bend = curvature(&lp_path.of[middle - 2], &lp_path.of[middle], &lp_path.of[middle + 2]);
    q16 limit = bend > ONE / 64 ? square_root_q16(divide(SIDEWAYS, bend)) : FASTEST;
    lp_path.of[i].speed = smaller(limit, FASTEST);
  }
}

static void brake_in_time(void) {
  for (int i = PATH_POINTS - 2; i >= 0; i--) {
    q16 next = lp_path.of[i + 1].speed;
    q16 limit = square_root_q16(multiply(next, next) + multiply(2 * BRAKING, spacing()));
    lp_path.of[i].speed = smaller(lp_path.of[i].speed, limit);
  }
}

void local_planner(void) {
  lp_path = (struct path){0}; /* all of it leaves the core */
  if (!good_pose(&lp_pose)) return;
  if (!good_path(&lp_state)) lp_state.valid = 0;
  q16 s, d, before;
  locate(lp_pose.x, lp_pose.y, &s, &d);
  int first = wrapped((int)((int64_t)s * STATIONS / track_length));
  /* Go on from the last path rather than from a pose that trembles, unless the car has left it. */
  offset[0] = planned_before(first, &before) && absolute(before - d) < Q16(0.3) ? before : d;
  attract(first);
#if OPPONENTS
  if (!good_opponents(&lp_opponents) || lp_pose.stamp - lp_opponents.stamp > OUTDATED) lp_opponents.count = 0;
  repel(s);
#endif
  search(within((offset[0] + LANES * LANE / 2) / LANE, 0, LANES - 1));
  smooth();
  place(first);
  limit_speed();
#if OPPONENTS
  follow(s);
#endif
  brake_in_time();
  lp_path.station = (uint32_t)first;
  lp_path.stamp = lp_pose.stamp;
  lp_path.valid = 1;
  lp_state = lp_path;
}
