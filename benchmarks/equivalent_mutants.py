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

CONDITIONS: dict[tuple[str, str], str] = {}
"""Faults of benchmarks/conditions.py that change no verdict of verify or of the second checker, in the same form."""
