/* Health rules: what follows from overruns and faults. Only counted here; the management core acts. */
#include "halpipe.h"

typedef struct {
    uint32_t place;   /* of the next event in the history */
    uint32_t is_full; /* as many events as it counts have been seen */
} memory;

static uint32_t history[HP_HISTORY]; /* the tables, by their number in the run, of the last events of each rule */
static memory memories[HP_RULES];
static uint32_t wanted;   /* mode + 1 */
static uint32_t priority; /* of the rule that wants it */
static uint32_t is_stopping;

static void want(const hp_rule *rule) {
    if ((wanted == 0U) || (rule->priority < priority)) {
        wanted = rule->mode + 1U;
        priority = rule->priority;
    }
}

uint32_t health_fires(uint32_t index, uint64_t flags, uint32_t table, uint32_t cycle) {
    const hp_rule *rule = &hp_rules[index];
    uint32_t fires = 0U;
    if ((CONTROL->unhealthy == 0U) && ((flags & rule->flags) != 0U) && (table != rule->mode)) {
        memory *m = &memories[index];
        history[rule->first + m->place] = cycle;
        m->place++;
        if (m->place == rule->count) {
            m->place = 0U;
            m->is_full = 1U;
        }
        if ((m->is_full != 0U) && ((cycle - history[rule->first + m->place]) < rule->cycles)) {
            fires = 1U;
            if (rule->action == HEALTH_SWITCH) {
                want(rule);
            } else if (rule->action == HEALTH_STOP) {
                is_stopping = 1U;
            } else {
                /* the cores are restarted at once, by the management core */
            }
        }
    }
    return fires;
}

uint32_t health_mode(void) {
    uint32_t mode = wanted;
    wanted = 0U;
    return mode;
}

uint32_t health_stops(void) { return is_stopping; }
