/* Localisation: a particle filter on the map of distances to the walls (a likelihood field).
 *
 * Every particle is moved as the odometry says, with noise; then every ninth beam of the scan is drawn from it and
 * weighed by how far from a wall it ends. The pose is the weighted mean, and the particles are drawn again by weight.
 *
 * PARTICLES, of at most PARTICLES_KEPT, is stated by the version. Mutable data that is no buffer holds nothing from
 * job to job.
 */
#include "checks.h"

#ifndef PARTICLES
#define PARTICLES PARTICLES_KEPT
#endif

#define EVERY 9
#define USED ((BEAMS + EVERY - 1) / EVERY)
#define CAP 16 /* distances of more than 1/2 m weigh the same: an opponent must not disturb */

/* A beam's weight is 2^(-distance^2 / HALVING), so this is the deviation of 0.1 m, spread over neighbouring beams. */
#define HALVING_SHIFT 6

#define START_SPREAD Q16(0.1)
#define START_TURN DEGREES(4)

struct scan pf_scan;
struct odometry pf_odometry;
struct pose pf_pose;
struct particles pf_state;

static struct particle moved[PARTICLES];
static uint32_t weight[PARTICLES];
static int32_t beam_x[USED], beam_y[USED];
static uint16_t penalty[256];

extern const uint32_t halving_table[64]; /* 2^(-i/64) in Q16.16 */

/* A normal number with the given deviation. */
static int32_t noise(int32_t deviation) { return (int32_t)((int64_t)random_normal(&pf_state.random) * deviation / 148); }

/* At power-up the car stands on the start line, more or less. */
static void begin(void) {
  const struct station *start = &stations[0];
  angle heading = direction(start->sine, start->cosine);
  pf_state.random = 2463534242u;
  pf_state.count = PARTICLES;
  pf_state.distance = pf_odometry.distance;
  pf_state.heading = pf_odometry.heading;
  for (int i = 0; i < PARTICLES; i++) {
    struct particle *p = &pf_state.of[i];
    p->x = start->x + noise(START_SPREAD);
    p->y = start->y + noise(START_SPREAD);
    p->heading = heading + (angle)noise(START_TURN);
  }
}

/* By what the odometry says, but no more than a car can do from scan to scan. Another version may have kept another
 * number of particles: take or repeat them evenly. */
static void move(void) {
  q16 way = within((q16)((uint32_t)pf_odometry.distance - (uint32_t)pf_state.distance), -ONE, ONE);
  int32_t turn = within((int32_t)(pf_odometry.heading - pf_state.heading), -DEGREES(45), DEGREES(45));
  int32_t way_noise = Q16(0.008) + absolute(way) / 12;
  int32_t turn_noise = DEGREES(0.3) + absolute(turn) / 12;
  for (uint32_t i = 0; i < PARTICLES; i++) {
    struct particle p = pf_state.of[i * pf_state.count / PARTICLES];
    int32_t turned = turn + noise(turn_noise);
    q16 gone = way + noise(way_noise), aside = noise(Q16(0.006));
    q16 c = cosine(p.heading + (angle)(turned / 2)), s = sine(p.heading + (angle)(turned / 2));
    moved[i].x = p.x + multiply(gone, c) - multiply(aside, s);
    moved[i].y = p.y + multiply(gone, s) + multiply(aside, c);
    moved[i].heading = p.heading + (angle)turned;
  }
  pf_state.distance = pf_odometry.distance;
  pf_state.heading = pf_odometry.heading;
  pf_state.count = PARTICLES;
}

/* The ends of the beams that came back, as the car sees them. */
static int draw_beams(void) {
  int used = 0;
  for (int i = 0; i < BEAMS; i += EVERY) {
    if (pf_scan.range[i] == 0) continue;
    q16 range = (q16)((uint32_t)pf_scan.range[i] * ONE / 1000);
    angle bearing = (angle)BEAM_FIRST + (angle)i * BEAM_STEP;
    beam_x[used] = multiply(range, cosine(bearing));
    beam_y[used++] = multiply(range, sine(bearing));
  }
  return used;
}

/* The sum of the penalties of each particle's beams, in `weight`; returns the least of them. */
static uint32_t weigh(int used) {
  for (int i = 0; i < 256; i++) {
    int32_t distance = smaller(absolute((int8_t)i), CAP);
    penalty[i] = (uint16_t)(distance * distance);
  }
  uint32_t least = UINT32_MAX;
  for (int i = 0; i < PARTICLES; i++) {
    const struct particle *p = &moved[i];
    int64_t c = cosine(p->heading), s = sine(p->heading), x = (int64_t)p->x * ONE, y = (int64_t)p->y * ONE;
    uint32_t sum = 0;
    for (int k = 0; k < used; k++) {
      uint64_t column = (uint64_t)((x + beam_x[k] * c - beam_y[k] * s) >> (16 + MAP_SHIFT));
      uint64_t row = (uint64_t)((y + beam_x[k] * s + beam_y[k] * c) >> (16 + MAP_SHIFT));
      sum += column < MAP_COLUMNS && row < MAP_ROWS ? penalty[(uint8_t)map[row][column]] : CAP * CAP;
    }
    weight[i] = sum;
    if (sum < least) least = sum;
  }
  return least;
}

/* From penalties to weights; returns their sum. */
static uint64_t normalise(uint32_t least) {
  uint64_t total = 0;
  for (int i = 0; i < PARTICLES; i++) {
    uint32_t excess = weight[i] - least, halvings = excess >> HALVING_SHIFT;
    weight[i] = halvings < 16 ? halving_table[excess & 63] >> halvings : 0;
    total += weight[i];
  }
  return total;
}

/* The weighted mean; headings as differences to a first one, since they wrap. */
static void estimate(uint64_t total) {
  int64_t x = 0, y = 0, turn = 0, spread = 0;
  const struct particle *first = &moved[0];
  for (int i = 0; i < PARTICLES; i++) {
    x += (int64_t)weight[i] * (moved[i].x - first->x);
    y += (int64_t)weight[i] * (moved[i].y - first->y);
    turn += (int64_t)weight[i] * ((int32_t)(moved[i].heading - first->heading) >> 8);
  }
  pf_pose.x = first->x + (q16)(x / (int64_t)total);
  pf_pose.y = first->y + (q16)(y / (int64_t)total);
  pf_pose.heading = first->heading + (angle)(turn / (int64_t)total) * 256;
  for (int i = 0; i < PARTICLES; i++) {
    int64_t a = moved[i].x - pf_pose.x, b = moved[i].y - pf_pose.y;
    spread += (int64_t)weight[i] * ((a * a + b * b) >> 16);
  }
  pf_pose.spread = square_root_q16((q16)smaller((int32_t)(spread / (int64_t)total), 100 * ONE));
}

/* Systematic resampling: equal steps through the sum of weights, from a random beginning. */
static void resample(uint64_t total) {
  uint64_t step = (total << 16) / PARTICLES, at = (random_next(&pf_state.random) & 0xffff) * step >> 16;
  uint64_t sum = 0;
  int from = -1;
  for (int i = 0; i < PARTICLES; i++, at += step) {
    while (sum <= at && from < PARTICLES - 1) sum += (uint64_t)weight[++from] << 16;
    pf_state.of[i] = moved[from];
  }
}

void particle_filter(void) {
  pf_pose = (struct pose){0}; /* all of it leaves the core */
  if (!good_scan(&pf_scan) || !good_odometry(&pf_odometry)) return;
  if (!good_particles(&pf_state)) begin();
  move();
  int used = draw_beams();
  uint64_t total = normalise(weigh(used));
  estimate(total);
  resample(total);
  pf_pose.stamp = pf_scan.stamp;
  pf_pose.speed = pf_odometry.speed;
  pf_pose.valid = 1;
}
