/* Rectangles that are to fill a board: jobs of some length that take some height of what they share, in any order.
 *
 * The board is filled from its begin on. At each instant at which something ends, what is idle is given to rectangles
 * that are left, in any combination; idle area may be wasted as long as there is any to spare. What is left at the end
 * has to end with the board, up to what may be wasted: from the last few rectangles on, sums of their lengths show
 * whether that is possible at all (meet in the middle; E. Horowitz and S. Sahni, 1974). Rectangles of one kind are
 * tried once. A filling that has tried enough ends; the next one takes the rectangles in another order.
 *
 * All is deterministic, in integers, and nothing is allocated. */

#include <stdbool.h>
#include <stdint.h>

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

/* Rectangles of a board: they are bits of a word. */
enum { MAX_RECTANGLES = 64 };

/* Rectangles left from which on their sums are looked at, in two halves; all sums together fill less than a page of the
 * stack, beyond which Windows asks for a function of the C library. */
enum { FEW = 14, HALF_OF_SUMS = 1 << (FEW / 2) };

/* What Python hands over (boards.py), field by field in the same order. */
typedef struct {
    int64_t height;
    int64_t length;
    int64_t count;
    int64_t spare; /* area that may be wasted: what the rectangles leave of the board */
    const int64_t *lengths;
    const int64_t *heights;
    const int64_t *kinds; /* of rectangles that are alike, the same one */
    const int64_t *order; /* in which they are tried */
    int64_t *starts;
} Board;

typedef struct {
    const Board *board;
    uint64_t left; /* the rectangles that are not placed, a bit each */
    int64_t spare;
    int64_t tries;
} Filling;

/* Sums of some of the rectangles, in ascending order. */
typedef struct {
    int64_t sums[HALF_OF_SUMS];
    int64_t count;
} Sums;

static bool is_left(const Filling *f, int64_t number) { return f->left >> number & 1; }

static int64_t end_of(const Board *b, int64_t number) { return b->starts[number] + b->lengths[number]; }

/* Add a length: every sum there is, with it and without it. The largest come first, so that none is overwritten. */
static void extend(Sums *s, int64_t length) {
    int64_t without = s->count - 1, with = s->count - 1;
    s->count *= 2;
    for (int64_t place = s->count - 1; with >= 0; place--) {
        int64_t longer = s->sums[with] + length;
        bool is_longest = longer >= s->sums[without];
        s->sums[place] = is_longest ? longer : s->sums[without];
        with -= is_longest;
        without -= !is_longest;
    }
}

/* Whether a sum of one half and one of the other add up to at least `low` and at most `high`. */
static bool reaches(const Sums *one, const Sums *other, int64_t low, int64_t high) {
    int64_t second = other->count - 1;
    for (int64_t first = 0; first < one->count && one->sums[first] <= high; first++) {
        while (second >= 0 && one->sums[first] + other->sums[second] > high)
            second--;
        if (second < 0)
            return false;
        if (one->sums[first] + other->sums[second] >= low)
            return true;
    }
    return false;
}

/* Whether what ends at `time` or later can be followed, up to the end of the board, by some of what is left. */
static bool can_end(const Filling *f, int64_t time) {
    const Board *b = f->board;
    Sums halves[2];
    int64_t seen = 0;
    for (int half = 0; half < 2; half++) {
        halves[half].sums[0] = 0;
        halves[half].count = 1;
    }
    for (int64_t number = 0; number < b->count; number++) {
        if (is_left(f, number)) {
            if (++seen > FEW)
                return true;
            extend(&halves[seen & 1], b->lengths[number]);
        }
    }
    for (int64_t number = 0; number < b->count; number++) {
        if (is_left(f, number) || end_of(b, number) < time)
            continue;
        int64_t rest = b->length - end_of(b, number);
        int64_t low = rest - f->spare / b->heights[number];
        if (low > 0 && !reaches(&halves[0], &halves[1], low, rest))
            return false;
    }
    return true;
}

static bool choose(Filling *f, int64_t time, int64_t idle, int64_t from);

/* Give what is idle at `time` to rectangles that are left. */
static bool fill_at(Filling *f, int64_t time) {
    const Board *b = f->board;
    int64_t idle = b->height;
    for (int64_t number = 0; number < b->count; number++)
        if (!is_left(f, number) && end_of(b, number) > time)
            idle -= b->heights[number];
    return choose(f, time, idle, 0);
}

/* Leave so much idle, and go on at the next instant at which something ends. */
static bool go_on(Filling *f, int64_t time, int64_t idle) {
    const Board *b = f->board;
    if (f->left == 0)
        return true;
    int64_t next = b->length;
    for (int64_t number = 0; number < b->count; number++)
        if (!is_left(f, number) && end_of(b, number) > time && end_of(b, number) < next)
            next = end_of(b, number);
    int64_t waste = idle * (next - time);
    if (next == b->length || waste > f->spare)
        return false;
    f->spare -= waste;
    bool is_filled = can_end(f, next) && fill_at(f, next);
    f->spare += waste;
    return is_filled;
}

/* Begin one more rectangle at `time`, of those from place `from` of the order on, or none. */
static bool choose(Filling *f, int64_t time, int64_t idle, int64_t from) {
    const Board *b = f->board;
    uint64_t tried = 0;
    for (int64_t place = from; idle > 0 && place < b->count; place++) {
        int64_t number = b->order[place];
        bool fits = b->heights[number] <= idle && time + b->lengths[number] <= b->length;
        if (!is_left(f, number) || !fits || tried >> b->kinds[number] & 1)
            continue;
        if (f->tries-- <= 0)
            return false;
        tried |= (uint64_t)1 << b->kinds[number];
        f->left ^= (uint64_t)1 << number;
        b->starts[number] = time;
        if (choose(f, time, idle - b->heights[number], place + 1))
            return true;
        f->left ^= (uint64_t)1 << number;
    }
    return f->tries >= 0 && go_on(f, time, idle);
}

/* Fill the board in at most so many tries; return 1 if `starts` says how, else 0. */
EXPORTED int64_t halpipe_fill_board(const Board *board, int64_t tries) {
    if (board->count < 1 || board->count > MAX_RECTANGLES)
        return 0;
    uint64_t all = board->count == MAX_RECTANGLES ? ~(uint64_t)0 : ((uint64_t)1 << board->count) - 1;
    Filling filling = {board, all, board->spare, tries};
    return fill_at(&filling, 0);
}

/* What the sources hashed to when this was built: a library left over from other sources is refused. */
#ifndef FINGERPRINT
#define FINGERPRINT ""
#endif
EXPORTED const char halpipe_fingerprint[] = FINGERPRINT;
