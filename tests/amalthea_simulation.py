"""Random AMALTHEA systems, and a simulator of what AMALTHEA requires of them.

The simulator is written from the meaning of the elements (activations, responses, chains, semaphores, timed accesses),
and knows nothing of the importer: it plays the starts of jobs, and lists the requirements that they break. All times
are whole milliseconds; jobs run in one piece.
"""

from dataclasses import dataclass, field
from itertools import pairwise

NAMESPACES = (
    'xmlns:am="http://app4mc.eclipse.org/amalthea/3.3.0" xmlns:xmi="http://www.omg.org/XMI" '
    'xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmi:version="2.0"'
)
CYCLES = 14
FIRST, LAST = 5, 8  # the cycles of which requirements are checked


@dataclass
class Process:
    """A task: what it does (`run` n, `request`, `release`, `trigger` of a stimulus), and what activates it."""

    name: str
    core: int
    steps: list
    periodic: list = field(default_factory=list)  # (period, offset)
    trigger: tuple = ()  # (stimulus, prescaler, offset)
    is_timed: bool = False
    response: int | None = None

    @property
    def wcet(self):
        return sum(step[1] for step in self.steps if step[0] == "run")

    def position(self, index):
        return sum(step[1] for step in self.steps[:index] if step[0] == "run")


@dataclass
class System:
    processes: list
    chains: list  # (names, first event, last event, kind, limit)
    delays: list  # ((process, event), (process, event), low, high)

    def process(self, name):
        return next(p for p in self.processes if p.name == name)


# ------------------------------------------------------------------------------------------------- models


def random_system(rng):
    """A system of few tasks on two cores."""
    processes = []
    for index in range(rng.randint(2, 4)):
        processes.append(_process(rng, f"P{index}", processes))
    chains = [_chain(rng, processes) for _ in range(rng.randint(0, 2))]
    delays = [_delay(rng, processes)] if rng.random() < 0.3 else []
    return System(processes, chains, delays)


def _process(rng, name, before):
    steps = [("run", rng.randint(1, 2))]
    if rng.random() < 0.3:
        steps = [("request",), *steps, ("release",)]
    if rng.random() < 0.3:
        steps = [("run", 1), *steps]
    made = Process(name, rng.randint(0, 1), steps)
    sources = [p for p in before if p.periodic and len(p.periodic) == 1]
    if sources and rng.random() < 0.5:
        source = rng.choice(sources)
        stimulus = f"go{name}"
        for _ in range(2 if rng.random() < 0.15 else 1):
            source.steps.insert(rng.randrange(len(source.steps) + 1), ("trigger", stimulus))
        each = 2 if rng.random() < 0.2 else 1
        made.trigger = (stimulus, each, 2 * rng.randrange(each))
    else:
        period = rng.choice([10, 20])
        made.periodic = [(period, rng.randrange(period))]
        if rng.random() < 0.15:
            made.periodic.append(made.periodic[0] if rng.random() < 0.5 else (20, rng.randrange(20)))
        made.is_timed = len(made.periodic) == 1 and rng.random() < 0.25
    if rng.random() < 0.6:
        made.response = rng.randint(3, 12)
    return made


def _chain(rng, processes):
    names = rng.sample([p.name for p in processes], 2 if len(processes) < 3 or rng.random() < 0.7 else 3)
    triggered = any(p.name == names[0] and p.trigger for p in processes)  # those of a trigger are not imported
    events = ["start", "terminate", *(["activate"] if not triggered else [])]
    first, last = rng.choice(events), rng.choice(["start", "terminate", "terminate"])
    return tuple(names), first, last, rng.choice(["Age", "Reaction"]), rng.randint(8, 60)


def _delay(rng, processes):
    source, target = rng.sample(processes, 2)
    low = rng.randint(0, 3)
    return (
        (source.name, rng.choice(["start", "terminate"])),
        (target.name, rng.choice(["start", "terminate"])),
        low,
        (low + rng.randint(4, 15)),
    )


def document(system):
    """The system as AMALTHEA."""
    semaphore = 'semaphore="lock?type=Semaphore"'
    steps = {
        "run": lambda n: (
            f'<items xsi:type="am:Ticks"><default xsi:type="am:DiscreteValueConstant" value="{n}"/></items>'
        ),
        "request": lambda: f'<items xsi:type="am:SemaphoreAccess" {semaphore} access="request"/>',
        "release": lambda: f'<items xsi:type="am:SemaphoreAccess" {semaphore} access="release"/>',
        "trigger": lambda s: f'<items xsi:type="am:InterProcessTrigger" stimulus="{s}?type=InterProcessStimulus"/>',
    }
    tasks, stimuli, mapping, requirements = [], [], [], []
    for p in system.processes:
        refs = [f"s{p.name}{i}?type=PeriodicStimulus" for i, _ in enumerate(p.periodic)]
        refs += [f"{p.trigger[0]}?type=InterProcessStimulus"] if p.trigger else []
        body = "".join(steps[kind](*rest) for kind, *rest in p.steps)
        if p.is_timed:
            body += '<items xsi:type="am:LabelAccess" data="data?type=Label" access="read" implementation="timed"/>'
        tasks.append(f'<tasks name="{p.name}" stimuli="{" ".join(refs)}"><activityGraph>{body}</activityGraph></tasks>')
        for i, (period, offset) in enumerate(p.periodic):
            times = f'<recurrence value="{period}" unit="ms"/><offset value="{offset}" unit="ms"/>'
            stimuli.append(f'<stimuli xsi:type="am:PeriodicStimulus" name="s{p.name}{i}">{times}</stimuli>')
        if p.trigger:
            name, each, first = p.trigger
            counter = f'<counter prescaler="{each}" offset="{first}"/>' if each > 1 else ""
            stimuli.append(f'<stimuli xsi:type="am:InterProcessStimulus" name="{name}">{counter}</stimuli>')
        mapping.append(f'<taskAllocation task="{p.name}?type=Task" scheduler="S{p.core}?type=TaskScheduler"/>')
        if p.response is not None:
            requirements.append(_requirement(p))
    events = [
        f'<events xsi:type="am:ProcessEvent" name="{p.name}{kind}" eventType="{kind}" entity="{p.name}?type=Task"/>'
        for p in system.processes
        for kind in ("activate", "start", "terminate")
    ]
    chains, limits = [], []
    for index, (names, first, last, kind, limit) in enumerate(system.chains):
        ends = [f"{names[0]}{first}", *(f"{name}start" for name in names[1:-1]), f"{names[-1]}{last}"]
        ends = [f"{end}?type=ProcessEvent" for end in ends]
        items = "".join(
            f'<items xsi:type="am:EventChainContainer"><eventChain stimulus="{a}" response="{b}"/></items>'
            for a, b in pairwise(ends)
        )
        chains.append(f'<eventChains name="c{index}" stimulus="{ends[0]}" response="{ends[-1]}">{items}</eventChains>')
        limits.append(
            f'<timingConstraints xsi:type="am:EventChainLatencyConstraint" name="l{index}" type="{kind}" '
            f'scope="c{index}?type=EventChain"><maximum value="{limit}" unit="ms"/></timingConstraints>'
        )
    for index, ((a, one), (b, other), low, high) in enumerate(system.delays):
        limits.append(
            f'<timingConstraints xsi:type="am:DelayConstraint" name="d{index}" source="{a}{one}?type=ProcessEvent" '
            f'target="{b}{other}?type=ProcessEvent"><upper value="{high}" unit="ms"/><lower value="{low}" unit="ms"/>'
            "</timingConstraints>"
        )
    cores = "".join(
        f'<modules xsi:type="am:ProcessingUnit" name="core{i}" definition="D?type=ProcessingUnitDefinition" '
        'frequencyDomain="F?type=FrequencyDomain"/>'
        for i in range(2)
    )
    allocations = "".join(
        f'<schedulerAllocation scheduler="S{i}?type=TaskScheduler" responsibility="core{i}?type=ProcessingUnit"/>'
        for i in range(2)
    )
    return f"""<am:Amalthea {NAMESPACES}>
<swModel>{"".join(tasks)}<labels name="data"/></swModel>
<hwModel><definitions xsi:type="am:ProcessingUnitDefinition" name="D"/><structures name="S">{cores}</structures>
<domains xsi:type="am:FrequencyDomain" name="F"><defaultValue value="1.0" unit="kHz"/></domains></hwModel>
<osModel><semaphores name="lock" maxValue="1"/><operatingSystems name="O"><taskSchedulers name="S0"/>
<taskSchedulers name="S1"/></operatingSystems></osModel>
<stimuliModel>{"".join(stimuli)}</stimuliModel><eventModel>{"".join(events)}</eventModel>
<constraintsModel>{"".join(chains + limits + requirements)}</constraintsModel>
<mappingModel>{allocations}{"".join(mapping)}</mappingModel>
</am:Amalthea>"""


def _requirement(p):
    return (
        f'<requirements xsi:type="am:ProcessRequirement" name="r{p.name}" process="{p.name}?type=Task">'
        '<limit xsi:type="am:TimeRequirementLimit" limitType="UpperLimit" metric="ResponseTime">'
        f'<limitValue value="{p.response}" unit="ms"/></limit></requirements>'
    )


# ---------------------------------------------------------------------------------------------- simulation


@dataclass
class Run:
    """A job: when it was activated, starts and ends, reads and writes."""

    activate: int
    start: int
    terminate: int
    read: int
    write: int


def broken(system, starts, hyperperiod):
    """Play the starts of each task in one cycle over many; list what is broken."""
    runs, found = {}, []
    for p in _in_order(system):
        begins = sorted(s + c * hyperperiod for s in starts[p.name] for c in range(CYCLES))
        activations = sorted(_activations(system, p, runs, hyperperiod))
        rate = _rate(system, p, hyperperiod)
        if rate != len(starts[p.name]):
            return [*found, f"{p.name}: {rate} activations in a cycle, {len(starts[p.name])} jobs"]
        runs[p.name] = _matched(p, activations, begins)
        if runs[p.name] is None:
            return [*found, f"{p.name}: no order of its jobs serves its activations"]
    window = range(FIRST * hyperperiod, LAST * hyperperiod)
    found += _responses(system, runs, window)
    found += _exclusions(system, starts, hyperperiod)
    for chain in system.chains:
        found += _chain_breaks(chain, runs, window)
    for delay in system.delays:
        found += _delay_breaks(delay, runs, window)
    return found


def _in_order(system):
    return [p for p in system.processes if p.periodic] + [p for p in system.processes if p.trigger]


def _activations(system, p, runs, hyperperiod):
    end = CYCLES * hyperperiod
    if p.periodic:
        return [t for period, offset in p.periodic for t in range(offset, end, period)]
    stimulus, each, first = p.trigger
    source, positions = _source(system, stimulus)
    [(period, offset)] = source.periodic
    found = []
    for run in runs[source.name]:
        job = (run.activate - offset) // period
        for index, position in enumerate(positions, job * len(positions)):
            if index >= first and (index - first) % each == 0:
                found.append(run.start + position)
    return found


def _source(system, stimulus):
    """The task that triggers a stimulus, and the positions of its triggers."""
    [source] = [q for q in system.processes if ("trigger", stimulus) in q.steps]
    return source, [source.position(i) for i, step in enumerate(source.steps) if step == ("trigger", stimulus)]


def _rate(system, p, hyperperiod):
    """How often a task is activated in a cycle."""
    if p.periodic:
        return sum(hyperperiod // period for period, _ in p.periodic)
    source, positions = _source(system, p.trigger[0])
    return _rate(system, source, hyperperiod) * len(positions) / p.trigger[1]


def _matched(p, activations, begins):
    """Serve activations in their order, with as few of them waiting as can be in the long run."""
    period, limit = (p.periodic[0][0] if p.periodic else 0), p.response
    for shift in range(-len(begins), len(begins)):
        pairs = [(a, begins[i + shift]) for i, a in enumerate(activations) if 0 <= i + shift < len(begins)]
        if len(pairs) > len(begins) // 2 and all(start >= a for a, start in pairs):
            let = min(period, limit if limit is not None else period)
            return [
                Run(a, start, start + p.wcet, *((a, a + let) if p.is_timed else (start, start + p.wcet)))
                for a, start in pairs
            ]
    return None


def _responses(system, runs, window):
    for p in system.processes:
        for run in runs[p.name]:
            if p.response is not None and run.activate in window and run.terminate - run.activate > p.response:
                yield f"{p.name}: activated at {run.activate}, ends at {run.terminate}, limit {p.response}"
            if p.is_timed and run.activate in window and (run.terminate > run.write or run.start < run.read):
                yield f"{p.name}: runs outside of its logical execution time"


def _exclusions(system, starts, hyperperiod):
    cores, held = {0: [], 1: []}, []
    for p in system.processes:
        kinds = [step[0] for step in p.steps]
        for start in (s + c * hyperperiod for s in starts[p.name] for c in range(3)):
            cores[p.core].append((start, start + p.wcet, p.name))
            if "request" in kinds:
                at = start + p.position(kinds.index("request"))
                held.append((at, start + p.position(kinds.index("release")), p.name))
    for what, spans in (("core 0", cores[0]), ("core 1", cores[1]), ("lock", held)):
        spans.sort()
        for one, other in pairwise(spans):
            if other[0] < one[1]:
                yield f"{what}: {one} and {other}"


def _chain_breaks(chain, runs, window):
    names, first, last, kind, limit = chain
    jobs = [runs[name] for name in names]
    for run in jobs[0] if kind == "Reaction" else jobs[-1]:
        reached = run
        for following in jobs[1:] if kind == "Reaction" else reversed(jobs[:-1]):
            if reached is None:
                break
            if kind == "Reaction":
                reached = next((job for job in following if job.read >= reached.write), None)
            else:
                reached = next((job for job in reversed(following) if job.write <= reached.read), None)
        if reached is None:
            continue
        begin, end = (run, reached) if kind == "Reaction" else (reached, run)
        if run.start in window and getattr(end, last) - getattr(begin, first) > limit:
            yield f"{kind} of {names}: {getattr(end, last) - getattr(begin, first)}, limit {limit}"


def _delay_breaks(delay, runs, window):
    (source, one), (target, other), low, high = delay
    for run in runs[target]:
        if run.start not in window:
            continue
        at = getattr(run, other)
        if not any(low <= at - getattr(before, one) <= high for before in runs[source]):
            yield f"delay: {target} at {at} comes {low} to {high} after no {one} of {source}"
