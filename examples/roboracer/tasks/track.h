/* What is known of the track before the race: made by track.py, see tables.c. */
#ifndef TRACK_H
#define TRACK_H

#include "fixed.h"

#define MAP_COLUMNS 112
#define MAP_ROWS 64
#define MAP_SHIFT 13       /* a cell is 1/8 m: 2^13 in Q16.16 */
#define MAP_OUTSIDE (-32)
#define STATIONS 128       /* of the centre line, at equal distances */

struct station {
  q16 x, y;
  q16 sine, cosine; /* of the direction of travel */
  q16 race_line;    /* offset of the race line, positive to the left */
};

extern const int8_t map[MAP_ROWS][MAP_COLUMNS]; /* distance to the nearest wall in 1/32 m, negative outside the track */
extern const struct station stations[STATIONS];
extern const q16 track_length, half_width;

/* The map at a point; what lies beyond the map is outside. */
static inline int32_t wall_distance(q16 x, q16 y) {
  uint32_t column = (uint32_t)(x >> MAP_SHIFT), row = (uint32_t)(y >> MAP_SHIFT);
  return column < MAP_COLUMNS && row < MAP_ROWS ? map[row][column] : MAP_OUTSIDE;
}

/* From the plane to the track: `s` from the start line (0 to track_length), `d` to the left of the centre line. */
static inline void locate(q16 x, q16 y, q16 *s, q16 *d) {
  int64_t best = INT64_MAX;
  int nearest = 0;
  for (int i = 0; i < STATIONS; i++) {
    int64_t a = x - stations[i].x, b = y - stations[i].y, square = a * a + b * b;
    if (square < best) {
      best = square;
      nearest = i;
    }
  }
  const struct station *at = &stations[nearest];
  int64_t a = x - at->x, b = y - at->y;
  q16 along = (q16)((a * at->cosine + b * at->sine) >> 16) + (q16)((int64_t)track_length * nearest / STATIONS);
  *d = (q16)((b * at->cosine - a * at->sine) >> 16);
  *s = along < 0 ? along + track_length : along >= track_length ? along - track_length : along;
}

/* The way from one place to another along the track, between minus and plus half a lap. */
static inline q16 ahead(q16 from, q16 to) {
  q16 way = to - from;
  return way > track_length / 2 ? way - track_length : way < -(track_length / 2) ? way + track_length : way;
}

#endif
