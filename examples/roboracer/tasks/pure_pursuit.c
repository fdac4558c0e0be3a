/* Control: pure pursuit. Steer on the arc that meets the path some way ahead.
 *
 * The command takes effect DELAY microseconds after the scan that the pose is based on, which the version states. The
 * car is first moved on by this time, as it was commanded, so that it steers from where it will be.
 *
 * STOP: brake along the path that was planned last, whatever speed it has.
 */
#include "checks.h"

#ifndef DELAY
#define DELAY 50000
#endif
#ifndef STOP
#define STOP 0
#endif

#define WHEELBASE Q16(0.33)
#define PERIOD Q16(0.025)
#define LOOK_AHEAD Q16(0.35)     /* and as much farther as the car drives in LOOK_TIME */
#define LOOK_TIME Q16(0.22)
#define LOOK_FARTHEST Q16(1.6)
#define BRAKING Q16(3)

struct pose pp_pose;
struct path pp_path;
struct command pp_state;         /* the last command, kept from job to job */
struct command pp_command;       /* to the car */

struct place {
  q16 x, y;
  angle heading;
};

/* The tangent of the steering angle is the wheelbase times the curvature of the arc. */
static q16 curvature_of(int32_t steering) {
  return divide(divide(sine((angle)steering), cosine((angle)steering)), WHEELBASE);
}

static struct place predicted(void) {
  q16 way = multiply(pp_pose.speed, (q16)((int64_t)DELAY * ONE / 1000000));
  q16 turn = multiply(way, curvature_of(pp_state.steering)); /* radians */
  int32_t turned = (int32_t)((int64_t)turn * 683565276 >> 16);
  angle middle = pp_pose.heading + (angle)(turned / 2);
  return (struct place){pp_pose.x + multiply(way, cosine(middle)), pp_pose.y + multiply(way, sine(middle)),
                        pp_pose.heading + (angle)turned};
}

static int nearest(const struct place *car) {
  int best = 0;
  int64_t least = INT64_MAX;
  for (int i = 0; i < PATH_POINTS; i++) {
    int64_t a = pp_path.of[i].x - car->x, b = pp_path.of[i].y - car->y, square = a * a + b * b;
    if (square < least) {
      least = square;
      best = i;
    }
  }
  return best;
}

/* The point of the path `look` ahead of the car, between two points of it; the last one if the path is too short. */
static void target(const struct place *car, int from, q16 look, q16 *x, q16 *y) {
  const struct point *p = pp_path.of;
  q16 before = length(p[from].x - car->x, p[from].y - car->y);
  for (int i = from + 1; i < PATH_POINTS; i++) {
    q16 here = length(p[i].x - car->x, p[i].y - car->y);
    if (here >= look && here > before) {
      q16 part = before >= look ? 0 : divide(look - before, here - before);
      *x = p[i - 1].x + multiply(part, p[i].x - p[i - 1].x);
      *y = p[i - 1].y + multiply(part, p[i].y - p[i - 1].y);
      return;
    }
    before = here;
  }
  *x = p[PATH_POINTS - 1].x;
  *y = p[PATH_POINTS - 1].y;
}

static int32_t steer(const struct place *car, q16 x, q16 y) {
  q16 c = cosine(car->heading), s = sine(car->heading);
  q16 forward = multiply(x - car->x, c) + multiply(y - car->y, s);
  q16 left = multiply(y - car->y, c) - multiply(x - car->x, s);
  int64_t square = ((int64_t)forward * forward + (int64_t)left * left) >> 16;
  if (square < ONE / 100) return pp_state.steering;
  q16 bend = (q16)((int64_t)2 * left * ONE / square);
  return within((int32_t)direction(multiply(WHEELBASE, bend), ONE), -STEERING_LIMIT, STEERING_LIMIT);
}

void pure_pursuit(void) {
  if (!good_command(&pp_state)) pp_state = (struct command){0};
  int pose = good_pose(&pp_pose);
  pp_command = pp_state;
  pp_command.valid = 1;
  q16 speed = pose ? smaller(pp_state.speed, pp_pose.speed) : pp_state.speed;
  q16 braked = larger(speed - multiply(BRAKING, PERIOD), 0);
  if (!pose || !good_path(&pp_path)) {
    pp_command.speed = braked;
  } else {
    struct place car = predicted();
    int at = nearest(&car);
    q16 look = smaller(LOOK_AHEAD + multiply(LOOK_TIME, pp_pose.speed), LOOK_FARTHEST), x, y;
    target(&car, at, look, &x, &y);
    pp_command.steering = steer(&car, x, y);
    pp_command.speed = STOP ? braked : pp_path.of[smaller(at + 1, PATH_POINTS - 1)].speed;
    pp_command.stamp = pp_pose.stamp;
  }
  pp_state = pp_command;
}
