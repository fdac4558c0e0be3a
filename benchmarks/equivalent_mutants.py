"""Mutants of verify that change no verdict and no text, with the reason: see mutation_score.py.

Each is the file and the line of its statement, as `ast.unparse` prints it with the fault in it.
"""

MORE = "looks at more cycles than are needed; what lies in the others is nothing new"
BUDGET = "a limit that somebody chose: one more is as good"
TOUCH = "what ends at the instant at which another thing begins does not meet it"

GUESS = "a first guess below the least length is reached from below all the same"

EQUIVALENT = {
    ("ticks.py", "length = work * whole // (whole + taken)"): GUESS,
    ("ticks.py", "length = work // whole // (whole - taken)"): GUESS,
    ("ticks.py", "found = (self._cycle if until > self._settled else self._first).latest(until)"): "both know it",
    ("chains.py", "turns = 3 * len(chain.tasks) - 1"): MORE,
    ("chains.py", "turns = 2 * len(chain.tasks) + 1"): MORE,
    ("preemption.py", "line = [p.moved(-table.period, ' of the cycle before') for p in short if p.end >= table.period] + short"): TOUCH,
    ("tables.py", "return [p.moved(-period, where) for p in self.source.jobs if p.end >= period]"): TOUCH,
    ("tables.py", "return meeting + [p for p in self.after(self.cycles_of(meeting)) if p.start <= horizon]"): TOUCH,
    ("tables.py", "return max([3, *(-(-(p.end - self.length) // self.target.period) for p in late)])"): MORE,
    ("tables.py", "MAX_LINE = 200001"): BUDGET,
    ("ticks.py", "MAX_STEPS = 100001"): BUDGET,
    ("ticks.py", "MAX_EFFORT = 5000001"): BUDGET,
    ("ticks.py", "FEW_STEPS = 1001"): BUDGET,
    ("ticks.py", "_TURNS = 5"): MORE,
    ("transitions.py", "for placed in (*switch.before(3), *switch.jobs, *switch.after(2)):"): MORE,
    ("transitions.py", "for placed in (*switch.before(2), *switch.jobs, *switch.after(3)):"): MORE,
    (
        "precedence.py",
        "before = min(cycles, max(1, -((switch.length + cyclic.start - least) // cycle)))",
    ): "the cycle is looked at in the second range instead of the first",
}  # fmt: skip

MODEL = "only where the model has a fault, for which it is refused"
BROKEN = "only where another rule has refused the job or the schedule already"
WORDS = "chooses what a finding says, not whether there is one"
WITHIN = "the path lies within one of the modes, whose own rule judges it"
SILENT = "without a limit nothing is reported"

CONDITIONS = {
    ("jobs.py", "always: elif active.task.period is None and counts.of(name) is not None:"): MODEL,
    ("jobs.py", "always: if target != name:"): MODEL,
    ("jobs.py", "always: if placed.version is not None and 0 <= job < count:"): BROKEN,
    ("jobs.py", "always: if asked[name].keys() <= known.keys():"): MODEL,
    ("jobs.py", "if counts.of(name) is not None:"): MODEL,
    ("jobs.py", "if active.task.period is None:"): MODEL,
    ("jobs.py", "inside = [index for index in present]"): BROKEN,
    ("jobs.py", "inside = [index for index in present if 0 <= index <= count]"): BROKEN,
    ("jobs.py", "if 0 <= job < count:"): BROKEN,
    ("jobs.py", "if placed.version is not None:"): BROKEN,
    ("jobs.py", "if placed.version is not None and 0 <= job <= count:"): BROKEN,
    ("jobs.py", "return min(counted, key=lambda units: counted[units]) if counted else None"): WORDS,
    ("jobs.py", "if units != usual:"): "there is a usual set wherever there is a job",
    ("jobs.py", "if here != usual and here is not None:"): "there is a usual set wherever there is a job",
    ("chains.py", "always: if any(limit is not None for limit in limits(chain)):"): SILENT,
    ("chains.py", "if chain.name not in within:"): SILENT,
    ("chains.py", "if begin is None or end is None:"): WITHIN,
    ("chains.py", "paths = _Path(chain, line, lambda first, last: last >= 0)"): WITHIN,
    ("chains.py", "paths = _Path(chain, line, lambda first, last: first < switch.length)"): WITHIN,
    ("chains.py", "paths = _Path(chain, line, lambda first, last: first <= switch.length and last >= 0)"): WITHIN,
    ("chains.py", "paths = _Path(chain, line, lambda first, last: first < switch.length and last >= 0 - 1)"): WITHIN,
    ("figures.py", "if broken:"): BROKEN,
    ("figures.py", "if cost.total < 0 and broken:"): BROKEN,
    ("figures.py", "if cost.total <= 0 + 1 and broken:"): BROKEN,
    ("figures.py", "if cost.total > 0 and table.sound:"): BROKEN,
    ("figures.py", "if cost.total > 0 and (not broken):"): BROKEN,
    ("figures.py", "if certain & table.broken:"): BROKEN,
    ("figures.py", "if value < 0 and certain & table.broken:"): BROKEN,
    ("figures.py", "if value <= 0 + 1 and certain & table.broken:"): BROKEN,
    ("figures.py", "if value > 0 and table.sound:"): BROKEN,
    ("figures.py", "if value > 0 and (not possible & table.broken):"): BROKEN,
    ("figures.py", "for given in list(stated.elements())[:1]:"): WORDS,
    ("preemption.py", "for units, placed in list(on.items())[:1]:"): WORDS,
    ("preemption.py", "for part in list(short)[:1]:"): WORDS,
    ("preemption.py", "for outer, inner in list(_crossing(line))[:1]:"): WORDS,
    ("precedence.py", "for other in list(others)[:1]:"): f"{BROKEN}: a job that is given twice",
    ("precedence.py", "if not before.period or not placed.active.period:"): MODEL,
    ("precedence.py", "if before is None or not before.period:"): MODEL,
    ("precedence.py", "before = max(cycles, max(0, -((switch.length + reached(constraint, cyclic) - least) // cycle)))"): MORE,
    ("precedence.py", "return (range(max(before, repeat)), range(before, cycles))"): MORE,
    ("precedence.py", "if left <= 0:"): BUDGET,
    ("precedence.py", "if left < 0 - 1:"): BUDGET,
}  # fmt: skip
"""Faults of benchmarks/conditions.py that change no verdict of verify, in the same form."""
