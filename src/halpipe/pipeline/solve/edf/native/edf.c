/* Earliest deadline first over parts, on unrolled time (MODEL 8.3).
 *
 * On each unit the job with the earliest deadline runs to its next split point. A piece that would keep a job which is
 * still to come from its latest start is not begun: idle time is inserted instead. A job that can wait no longer comes
 * before all others. Jobs that have begun are a stack on each unit, so that spans are nested.
 *
 * All is deterministic, in integers, and nothing is allocated: where some room is too small, that is said, and Python
 * begins again with more of it. */

#include "decisions.h"
#include "handlers.h"

#if defined(_WIN32)
#define EXPORTED __declspec(dllexport)
#else
#define EXPORTED __attribute__((visibility("default")))
#endif

/* Put down the first release of every task, and the jobs that stay. */
EXPORTED void halpipe_edf_begin(const System *system, const Plan *plan, Memory *memory) {
    const Simulation s = {system, plan, memory};
    for (int64_t task = 0; task < system->tasks; task++) {
        memory->jobs[task].next_release = memory->jobs[task].next_number = -1;
        if (plan->releases_at[task] < plan->releases_at[task + 1])
            announce(&s, task, 0);
    }
    for (int64_t unit = 0; unit < system->units; unit++)
        memory->running[unit] = -1;
}

/* Put down when a job that stays comes by. */
EXPORTED void halpipe_edf_fix(const System *system, const Plan *plan, Memory *memory, int64_t time, int64_t number) {
    const Simulation s = {system, plan, memory};
    put(&s, time, FIXED, -1, number);
}

/* Go on to `end`, or for so many instants; return whether it is reached. */
EXPORTED int64_t halpipe_edf_run(const System *system, const Plan *plan, Memory *memory, int64_t end, int64_t instants) {
    const Simulation s = {system, plan, memory};
    while (memory->event_count && memory->events[0].time < end && !memory->lack) {
        if (instants-- == 0)
            return false;
        int64_t now = memory->events[0].time;
        while (memory->event_count && memory->events[0].time == now) {
            Event event = pop(&s);
            switch (kind_of(&event)) {
            case RELEASE:
                release(&s, event.number);
                break;
            case STOP:
                if (memory->jobs[event.task].ticket == event.number)
                    stop(&s, event.task, now);
                break;
            case WAKE:
                touch(&s, event.number);
                break;
            case FIXED:
                pass(&s, event.number, now);
                break;
            }
        }
        for (int64_t unit = 0; unit < system->units && !memory->lack; unit++) {
            if (memory->is_touched[unit]) {
                memory->is_touched[unit] = false;
                dispatch(&s, unit, now);
            }
        }
    }
    return true;
}

/* When the next event comes that what began before `end` still waits for; -1 if all that has ended. */
EXPORTED int64_t halpipe_edf_unended(const System *system, const Plan *plan, Memory *memory, int64_t end) {
    const Simulation s = {system, plan, memory};
    for (int64_t unit = 0; unit < system->units; unit++) {
        for (int64_t n = 0; n < memory->stack_count[unit]; n++) {
            int64_t task = stack_of(&s, unit)[n];
            if (memory->jobs[task].parts && parts_of(&s, task)[0].start < end)
                return memory->event_count ? memory->events[0].time : -1;
        }
    }
    return -1;
}

/* Whether nothing is under way, so that the next hyperperiod repeats the first. */
EXPORTED int64_t halpipe_edf_is_quiescent(const System *system, const Plan *plan, Memory *memory, int64_t now) {
    for (int64_t task = 0; task < system->tasks; task++) {
        int64_t first = plan->releases_at[task];
        if (memory->jobs[task].is_there)
            return false;
        if (first < plan->releases_at[task + 1] &&
            memory->jobs[task].next_release - system->cycle != plan->releases[first])
            return false;
    }
    for (int64_t resource = 0; resource < system->resources; resource++)
        for (int64_t n = memory->claims_of[resource]; n >= 0; n = memory->claims[n].next)
            if (memory->claims[n].end > now)
                return false;
    return true;
}

static void sign(Memory *m, int64_t *signature, int64_t value) {
    if (m->signed_count == m->signature_room)
        m->lack |= SIGNATURE;
    else
        signature[m->signed_count++] = value;
}

static void sign_job(const Simulation *s, int64_t *signature, int64_t task, int64_t now) {
    Memory *m = s->memory;
    const Job *job = &m->jobs[task];
    const int64_t facts[] = {task, job->release - now, job->executed, job->target, job->is_running, job->parts};
    for (int64_t n = 0; n < 6; n++)
        sign(m, signature, facts[n]);
    for (int64_t n = 0; n < job->parts; n++) {
        const Part *part = &parts_of(s, task)[n];
        sign(m, signature, part->start - now);
        sign(m, signature, part->end - now);
        sign(m, signature, part->first);
        sign(m, signature, part->last);
    }
}

static bool is_lower(const Claim *a, const Claim *b) {
    if (a->begin != b->begin)
        return a->begin < b->begin;
    return a->end != b->end ? a->end < b->end : a->height < b->height;
}

/* The claims of a resource that end after `now`, in an order of their own. */
static void sign_claims(const Simulation *s, int64_t *signature, int64_t resource, int64_t now) {
    Memory *m = s->memory;
    int64_t count = 0;
    for (int64_t n = m->claims_of[resource]; n >= 0; n = m->claims[n].next) {
        if (m->claims[n].end <= now)
            continue;
        if (count == m->near_room) {
            m->lack |= CLAIMS;
            return;
        }
        Claim claim = {resource, m->claims[n].begin - now, m->claims[n].end - now, m->claims[n].height};
        int64_t place = count++;
        for (; place > 0 && is_lower(&claim, &m->near[place - 1]); place--)
            m->near[place] = m->near[place - 1];
        m->near[place] = claim;
    }
    sign(m, signature, count);
    for (int64_t n = 0; n < count; n++) {
        sign(m, signature, m->near[n].begin);
        sign(m, signature, m->near[n].end);
        sign(m, signature, m->near[n].height);
    }
}

/* Write down all that the future depends on, relative to `now`; return whether it is what was written `before`. */
EXPORTED int64_t halpipe_edf_sign(const System *system, const Plan *plan, Memory *m, int64_t now, int64_t turn) {
    const Simulation s = {system, plan, m};
    int64_t *signature = &m->signatures[turn % 2 * m->signature_room];
    const int64_t *other = &m->signatures[(turn + 1) % 2 * m->signature_room];
    m->signed_count = 0;
    forget(&s, now - system->cycle);
    for (int64_t unit = 0; unit < system->units; unit++) {
        sign(m, signature, m->stack_count[unit]);
        for (int64_t n = 0; n < m->stack_count[unit]; n++)
            sign_job(&s, signature, stack_of(&s, unit)[n], now);
        for (int64_t n = 0; n < m->pending_count[unit]; n++)
            sign_job(&s, signature, pending_of(&s, unit)[n], now);
    }
    for (int64_t task = 0; task < system->tasks; task++) {
        const Job *job = &m->jobs[task];
        if (plan->releases_at[task] < plan->releases_at[task + 1]) {
            sign(m, signature, job->next_release - now);
            sign(m, signature, job->is_there ? job->next_number - job->number : 0);
        }
        for (int64_t list = 2 * plan->history[task]; list >= 0 && list <= 2 * plan->history[task] + 1; list++) {
            const int64_t *times = &m->past[list * m->history_room];
            int64_t count = m->past_count[list], old = count_up_to(times, count, now - plan->reach[task] - 1);
            sign(m, signature, count - old);
            for (int64_t n = old; n < count; n++)
                sign(m, signature, times[n] - now);
        }
    }
    for (int64_t resource = 0; resource < system->resources; resource++)
        sign_claims(&s, signature, resource, now);
    bool is_same = m->signed_count == m->signed_before;
    for (int64_t n = 0; is_same && n < m->signed_count; n++)
        is_same = signature[n] == other[n];
    m->signed_before = m->signed_count;
    return is_same;
}

/* Reaction time and data age of a chain of tasks, each of which has jobs. */
EXPORTED void halpipe_edf_latency(const Member *members, int64_t count, int64_t cycle, int64_t *reaction, int64_t *age) {
    *reaction = worst_reaction(members, count, cycle);
    *age = worst_age(members, count, cycle);
}

/* What the sources hashed to when this was built: a library left over from other sources is refused. */
#ifndef FINGERPRINT
#define FINGERPRINT ""
#endif
EXPORTED const char halpipe_fingerprint[] = FINGERPRINT;
