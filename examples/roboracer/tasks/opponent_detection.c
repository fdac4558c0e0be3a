/* Opponents: what the lidar sees on the track and the map does not explain, clustered and tracked.
 *
 * Neighbouring beams that end well away from every wall form a cluster. Clusters are matched to the known opponents,
 * whose place and speed along the track follow by an alpha-beta filter.
 */
#include "checks.h"

#define CLEAR 10                 /* 1/32 m from a wall, and more: not the wall */
#define GAP Q16(0.35)            /* between beams of one cluster */
#define WIDEST Q16(0.9)          /* more is no car */
#define HALF_CAR Q16(0.15)       /* from the face that is seen to the middle */
#define GATE Q16(1.0)            /* from where an opponent is expected to where it is found */
#define CLUSTERS 12
#define FORGET 20                /* scans */
#define PERIOD Q16(0.025)
#define FRESH 3                  /* scans until a track is told to others */
#define FASTEST Q16(6)

struct pose od_pose;
struct scan od_scan;
struct opponents od_state;       /* kept from job to job */
struct opponents od_opponents;   /* for the planner */

struct cluster {
  q16 x, y, first_x, first_y, last_x, last_y, s, d;
  int32_t beams;
};

static struct cluster clusters[CLUSTERS];

/* Where a beam ends on the map; 0 if nothing came back. */
static int end_of_beam(int i, q16 *x, q16 *y) {
  if (od_scan.range[i] == 0) return 0;
  q16 range = (q16)((uint32_t)od_scan.range[i] * ONE / 1000);
  angle bearing = od_pose.heading + (angle)BEAM_FIRST + (angle)i * BEAM_STEP;
  *x = od_pose.x + multiply(range, cosine(bearing));
  *y = od_pose.y + multiply(range, sine(bearing));
  return 1;
}

static void add(struct cluster *c, q16 x, q16 y) {
  if (c->beams == 0) {
    c->x = c->y = 0;
    c->first_x = x;
    c->first_y = y;
  }
  c->beams++;
  c->x += (x - c->first_x);
  c->y += (y - c->first_y);
  c->last_x = x;
  c->last_y = y;
}

/* Clusters of at least two beams; the middle is put half a car behind the face that is seen. */
static int cluster(void) {
  int found = 0;
  clusters[0].beams = 0;
  for (int i = 0; i <= BEAMS; i++) {
    q16 x = 0, y = 0;
    int here = i < BEAMS && end_of_beam(i, &x, &y) && wall_distance(x, y) >= CLEAR;
    struct cluster *c = &clusters[found];
    if (c->beams > 0 && (i == BEAMS || (here && length(x - c->last_x, y - c->last_y) > GAP))) {
      if (c->beams >= 2 && length(c->last_x - c->first_x, c->last_y - c->first_y) < WIDEST && found < CLUSTERS - 1)
        found++;
      clusters[found].beams = 0;
    }
    if (here) add(&clusters[found], x, y);
  }
  for (int i = 0; i < found; i++) {
    struct cluster *c = &clusters[i];
    c->x = c->first_x + c->x / c->beams;
    c->y = c->first_y + c->y / c->beams;
    q16 far = larger(length(c->x - od_pose.x, c->y - od_pose.y), ONE / 8);
    c->x += (q16)((int64_t)(c->x - od_pose.x) * HALF_CAR / far);
    c->y += (q16)((int64_t)(c->y - od_pose.y) * HALF_CAR / far);
    locate(c->x, c->y, &c->s, &c->d);
  }
  return found;
}

static q16 wrapped(q16 s) { return s < 0 ? s + track_length : s >= track_length ? s - track_length : s; }

/* Alpha-beta filter: believe a part of what is found, and change the speed by a smaller part of the surprise. */
static void correct(struct opponent *o, const struct cluster *c) {
  q16 along = ahead(o->s, c->s), aside = c->d - o->d;
  o->s = wrapped(o->s + along * 3 / 8);
  o->d += aside * 3 / 8;
  o->speed = within(o->speed + along * 2, -FASTEST, FASTEST); /* 0.05 of the surprise in each period of 1/40 s */
  o->drift = within(o->drift + aside / 2, -ONE, ONE);
  o->missed = 0;
  o->seen++;
}

/* The nearest cluster within the gate, -1 if there is none; it is taken. */
static int match(const struct opponent *o, int found) {
  int best = -1;
  q16 nearest = GATE;
  for (int i = 0; i < found; i++) {
    if (clusters[i].beams == 0) continue;
    q16 away = length(ahead(o->s, clusters[i].s), clusters[i].d - o->d);
    if (away < nearest) {
      nearest = away;
      best = i;
    }
  }
  return best;
}

/* Move every known opponent on by one period, correct it by what is found, forget those long unseen. */
static void track(int found) {
  uint32_t kept = 0;
  for (uint32_t i = 0; i < od_state.count; i++) {
    struct opponent o = od_state.of[i];
    o.s = wrapped(o.s + multiply(o.speed, PERIOD));
    o.d = within(o.d + multiply(o.drift, PERIOD), -half_width, half_width);
    int best = match(&o, found);
    if (best >= 0) {
      correct(&o, &clusters[best]);
      clusters[best].beams = 0;
    } else {
      o.missed++;
      o.drift /= 2;
    }
    if (o.missed < (o.seen > FRESH ? FORGET : FRESH)) od_state.of[kept++] = o;
  }
  for (int i = 0; i < found && kept < OPPONENTS_KEPT; i++) {
    if (clusters[i].beams == 0) continue;
    od_state.of[kept++] = (struct opponent){.seen = 1, .s = clusters[i].s, .d = clusters[i].d, .speed = ONE};
  }
  od_state.count = kept;
}

void opponent_detection(void) {
  od_opponents = (struct opponents){0}; /* all of it leaves the core */
  od_opponents.stamp = od_pose.stamp;
  if (!good_scan(&od_scan) || !good_pose(&od_pose)) return;
  if (!good_opponents(&od_state) || od_pose.stamp - od_state.stamp > FORGET) od_state.count = 0;
  track(cluster());
  od_state.stamp = od_pose.stamp;
  for (uint32_t i = 0; i < od_state.count; i++)
    if (od_state.of[i].seen >= FRESH) od_opponents.of[od_opponents.count++] = od_state.of[i];
}
