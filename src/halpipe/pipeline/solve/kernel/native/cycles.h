/* Cycles of cooling: how long each is, how hot it begins, and whether it builds up the schedule anew. */

#ifndef HALPIPE_CYCLES_H
#define HALPIPE_CYCLES_H

#include "lanes.h"
#include "rules.h"

enum {
    /* Moves per entry in a cycle, times Luby's sequence. */
    CYCLE_MOVES = 300,
    /* Of many entries, cycles begin shorter and double up to CYCLE_MOVES: most sets need no more than a quench. */
    FIRST_CYCLE_MOVES = 20,
    /* Of many entries with windows, each cycle begins with an empty schedule, and after so many cycles they get longer:
     * linked tasks hold each other in place, and what has not fallen into place in one cycle seldom does in the next. */
    PATIENCE = 16,
    /* Without windows, many entries get longer and colder cycles after so many: what is still not found is full. */
    MANY_CYCLES = 16,
    LONG_CYCLE_MOVES = 3000,
    /* Without windows, one cycle in so many begins with an empty schedule: some basins are left in no other way. */
    RESTART = 4,
    /* So many cycles are made before the first restart. */
    FEW_CYCLES = 4,
    /* Of 16 + entries cycles, this many start hot: a few entries hold each other in place by their windows and must all
     * move at once; of many, a hot cycle throws away more than it frees. */
    HOT_SHARE_OF_CYCLES = 6,
    /* With more entries, the first cycles are never hot: most sets are solved in them. */
    FEW_ENTRIES = 32,
    /* Hot cycles start at T0 times 2**3. */
    HOTTER = 3,
};

/* The cost of a complete placement, from its profiles and the rules between jobs. */
static int64_t total_cost(const Arrays *p, const State *s) { return lanes_cost(p, s) + all_side_costs(p, s); }

/* The number-th term, from 1 on, of Luby's sequence 1, 1, 2, 1, 1, 2, 4, ... */
static int64_t luby(int64_t number) {
    int64_t length = 1;
    for (;;) {
        while ((length << 1) - 1 < number)
            length <<= 1;
        if (number == (length << 1) - 1)
            return length;
        number -= length - 1;
        length = 1;
    }
}

/* Take everything out that is not frozen, to construct it anew; after some cycles, without the hints. */
static void restart(const Arrays *p, State *s) {
    Registers *at = s->registers;
    for (int64_t place = at->frozen; place < at->inserted; place++) {
        int64_t entry = p->construction[place];
        if (at->cycle > FEW_CYCLES)
            s->hint[entry] = -1;
        for (int64_t job = p->entry_job[entry]; job < p->entry_job[entry + 1]; job++) {
            take(p, s, job);
            s->start[job] = -1;
        }
    }
    for (int64_t place = 0; place < at->hot; place++)
        s->hot_at[s->hot[place]] = -1;
    at->hot = 0;
    at->inserted = at->frozen;
    at->cost = total_cost(p, s);
}

/* Where a cycle starts: at T0, T0/2 or T0/4, a long one at half of that, with windows anywhere from T0/2 to T0, if hot at
 * 8 T0. */
static int64_t first_heat(State *s, int64_t number, bool is_linked, bool is_hot, bool is_long) {
    if (is_hot)
        return s->heat << HOTTER;
    if (number == 1)
        return s->heat >> 1;
    if (is_linked)
        return s->heat * (8 + draw(s, 9)) >> 4;
    return s->heat >> (draw(s, 3) + is_long);
}

/* Choose the length of the next cycle, the temperature it starts from, and whether it builds up everything anew. */
static void begin_cycle(const Arrays *p, State *s) {
    Registers *at = s->registers;
    int64_t number = ++at->cycle;
    bool is_small = p->entries < FEW_ENTRIES, is_linked = p->rows > 0;
    bool is_long = !is_small && !is_linked && number > MANY_CYCLES;
    int64_t moves = is_small ? CYCLE_MOVES : least(CYCLE_MOVES, (int64_t)FIRST_CYCLE_MOVES << least(number - 1, 8));
    bool is_drawn = draw(s, 16 + p->entries) < HOT_SHARE_OF_CYCLES;
    bool is_hot = is_drawn && is_on(s, HOT_CYCLES) && (is_small || (number > FEW_CYCLES && !is_linked && !is_long));
    bool is_anew;
    at->heat = first_heat(s, number, is_linked, is_hot, is_long);
    if (is_linked && !is_small) {
        moves *= 1 + number / PATIENCE;
        is_anew = number > 1;
    } else {
        moves = is_long ? LONG_CYCLE_MOVES * luby(number - MANY_CYCLES) : moves * luby(number);
        is_anew = number > FEW_CYCLES && draw(s, RESTART) == 0;
    }
    at->cycle_length = at->cycle_left = moves * p->entries;
    if (is_anew && is_on(s, RESTARTS))
        restart(p, s);
}

/* Cool linearly to a third within a cycle, then begin another. */
static void next_temperature(const Arrays *p, State *s) {
    Registers *at = s->registers;
    if (at->cycle_left == 0)
        begin_cycle(p, s);
    at->cycle_left--;
    int64_t low = at->heat / 3;
    at->temperature = low + ((at->heat - low) * (at->cycle_left * 1024 / at->cycle_length) >> 10);
}

#endif
