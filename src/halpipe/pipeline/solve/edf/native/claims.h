/* Access phases on the line of time: what of each resource is taken, and when there is room again. */

#ifndef CLAIMS_H
#define CLAIMS_H

#include "pieces.h"

/* Claims of a resource that are remembered before any are forgotten. */
enum { FEW = 64 };

/* Write down what a piece up to `target` asks of resources, beyond what the job has taken; return how many claims. */
static int64_t ask(const Simulation *s, const Piece *piece, int64_t executed, int64_t target) {
    int64_t count = 0;
    for (int64_t n = piece->way->phases; n < piece->way[1].phases; n++) {
        const Phase *phase = &s->system->phases[n];
        if (executed <= phase->begin && phase->end <= target) {
            int64_t begin = piece->start + piece->lost + phase->begin - piece->first;
            int64_t end = end_of(s->system, piece, phase->end);
            s->memory->asked[count++] = (Claim){phase->resource, begin, end, phase->height};
        }
    }
    return count;
}

static int64_t add_near(const Simulation *s, int64_t count, const Claim *claim, int64_t begin, int64_t end, int64_t height) {
    if (begin >= claim->end || claim->begin >= end)
        return count;
    if (count == s->memory->near_room) {
        s->memory->lack |= CLAIMS;
        return count;
    }
    s->memory->near[count] = (Claim){claim->resource, begin, end, height};
    return count + 1;
}

/* Add what stays and lies over a claim, in each turn of the hyperperiod that it touches. */
static int64_t gather_standing(const Simulation *s, const Claim *claim, int64_t count) {
    const System *system = s->system;
    const Claim *standing = system->standing;
    int64_t first = system->standing_at[claim->resource], end = system->standing_at[claim->resource + 1];
    int64_t earliest = claim->begin - system->longest[claim->resource], cycle = system->cycle;
    if (first == end)
        return count;
    for (int64_t turn = floor_of(earliest, cycle); turn <= floor_of(claim->end, cycle); turn++) {
        int64_t shift = turn * cycle, low = first, high = end;
        while (low < high) { /* the first that may reach the claim */
            int64_t middle = low + (high - low) / 2;
            if (standing[middle].begin + shift < earliest)
                low = middle + 1;
            else
                high = middle;
        }
        for (; low < end && standing[low].begin + shift < claim->end; low++)
            count = add_near(s, count, claim, standing[low].begin + shift, standing[low].end + shift, standing[low].height);
    }
    return count;
}

/* Gather what lies over a claim: what is taken, the `others` asked for before it, and what stays. */
static int64_t gather(const Simulation *s, const Claim *claim, int64_t others) {
    const Memory *m = s->memory;
    int64_t count = 0;
    for (int64_t n = m->claims_of[claim->resource]; n >= 0; n = m->claims[n].next)
        count = add_near(s, count, claim, m->claims[n].begin, m->claims[n].end, m->claims[n].height);
    for (int64_t n = 0; n < others; n++)
        if (m->asked[n].resource == claim->resource)
            count = add_near(s, count, claim, m->asked[n].begin, m->asked[n].end, m->asked[n].height);
    return gather_standing(s, claim, count);
}

/* An instant up to which a claim does not fit beside `others` and all that is taken; -1 if it fits. */
static int64_t first_free(const Simulation *s, const Claim *claim, int64_t others) {
    int64_t count = gather(s, claim, others);
    const Claim *near = s->memory->near;
    int64_t room = s->system->capacity[claim->resource] - claim->height;
    int64_t instant = claim->begin - 1;
    for (;;) {
        int64_t next = claim->end;
        for (int64_t n = 0; n < count; n++) {
            int64_t begin = greatest(claim->begin, near[n].begin);
            if (begin > instant)
                next = least(next, begin);
        }
        if (next >= claim->end)
            return -1;
        instant = next;
        int64_t height = 0, end = INT64_MAX;
        for (int64_t n = 0; n < count; n++) {
            if (near[n].begin <= instant && instant < near[n].end) {
                height += near[n].height;
                end = least(end, near[n].end);
            }
        }
        if (height > room)
            return end;
    }
}

/* The same for all that is asked: those of one piece may lie over each other where interrupts stretch its phases. */
static int64_t collision(const Simulation *s, int64_t count) {
    for (int64_t n = 0; n < count; n++) {
        int64_t until = first_free(s, &s->memory->asked[n], n);
        if (until >= 0)
            return until;
    }
    return -1;
}

static void take(const Simulation *s, int64_t count) {
    Memory *m = s->memory;
    for (int64_t n = 0; n < count; n++) {
        const Claim *claim = &m->asked[n];
        int64_t place = m->free_claim;
        if (place < 0) {
            m->lack |= CLAIMS;
            return;
        }
        m->free_claim = m->claims[place].next;
        m->claims[place] = (Held){claim->begin, claim->end, claim->height, m->claims_of[claim->resource]};
        m->claims_of[claim->resource] = place;
        m->claim_count[claim->resource]++;
    }
}

static void drop(Memory *m, int64_t resource, int64_t *link) {
    int64_t place = *link;
    *link = m->claims[place].next;
    m->claims[place].next = m->free_claim;
    m->free_claim = place;
    m->claim_count[resource]--;
}

/* Give back a claim that was taken and is not needed now. */
static void give_back(const Simulation *s, const Claim *claim) {
    Memory *m = s->memory;
    for (int64_t *link = &m->claims_of[claim->resource]; *link >= 0; link = &m->claims[*link].next) {
        const Held *held = &m->claims[*link];
        if (held->begin == claim->begin && held->end == claim->end && held->height == claim->height) {
            drop(m, claim->resource, link);
            return;
        }
    }
}

/* Forget what ended at or before an instant. */
static void forget(const Simulation *s, int64_t before) {
    Memory *m = s->memory;
    for (int64_t resource = 0; resource < s->system->resources; resource++) {
        int64_t *link = &m->claims_of[resource];
        while (*link >= 0) {
            if (m->claims[*link].end <= before)
                drop(m, resource, link);
            else
                link = &m->claims[*link].next;
        }
        m->claim_most[resource] = greatest(FEW, 2 * m->claim_count[resource]);
    }
}

static bool is_crowded(const Simulation *s) {
    for (int64_t resource = 0; resource < s->system->resources; resource++)
        if (s->memory->claim_count[resource] > s->memory->claim_most[resource])
            return true;
    return false;
}

#endif
