"""Hypothesis strategies for every value of the models, within the ranges of the schemas but not otherwise meaningful.

Names may dangle, windows may be empty and phases may exceed their WCET: who needs models that make sense
finds them in properties/verify_systems.py.
"""

from fractions import Fraction

from hypothesis import strategies as st

from halpipe.core.durations import Duration
from halpipe.models import (
    WHOLE,
    Access,
    AccessKind,
    Anchor,
    Binding,
    Chain,
    ChainLatency,
    CostTerms,
    HealthAction,
    HealthEvent,
    HealthRule,
    Interrupt,
    Job,
    Mode,
    ModeSchedule,
    Origin,
    Part,
    Precedence,
    Reaction,
    Resource,
    ResourceLoad,
    Run,
    Schedule,
    Source,
    Split,
    Status,
    Task,
    TaskModel,
    Transfer,
    Transition,
    TransitionTable,
    Unit,
    UnitLoad,
    Version,
)

NAME_CHARACTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_./:~+@$%-"
MOST_DIGITS = 30
UNIT_SIZES = {"ns": 1, "us": 10**3, "ms": 10**6, "s": 10**9}
SIZE_UNITS = {"B": 1, "kB": 10**3, "KiB": 2**10, "MB": 10**6, "MiB": 2**20, "GB": 10**9, "GiB": 2**30}

names = st.one_of(
    st.sampled_from(["a", "b", "core1", "particle_filter", "/perception/lidar", "~/out", NAME_CHARACTERS, "n" * 1000]),
    st.text(NAME_CHARACTERS, min_size=1, max_size=12),
)
some_names = st.lists(names, min_size=1, max_size=3).map(tuple)
digits = st.one_of(st.integers(0, 9), st.integers(0, 10**6), st.integers(0, 10**MOST_DIGITS - 1))


def few(element, most=2):
    """A short tuple."""
    return st.lists(element, max_size=most).map(tuple)


def maybe(element):
    """The value or None."""
    return st.none() | element


@st.composite
def rational_texts(draw, most=MOST_DIGITS):
    """A non-negative number in one of its three forms."""
    part = st.integers(0, 10**most - 1) | digits
    form = draw(st.sampled_from(["{}", "{}.{}", "{}/{}"]))
    return form.format(draw(part), draw(part.filter(bool)))


duration_texts = st.builds("{}{}".format, rational_texts(), st.sampled_from(sorted(UNIT_SIZES)))
size_texts = st.builds("{}{}".format, digits, st.sampled_from(sorted(SIZE_UNITS)))

shares = rational_texts().map(Fraction)
metrics = st.builds(lambda text, sign: sign * Fraction(text), rational_texts(most=300), st.sampled_from([1, -1]))
durations = duration_texts.map(Duration.parse)
sizes = st.builds(lambda number, unit: number * unit, st.integers(0, 10**9), st.sampled_from(list(SIZE_UNITS.values())))

# What XML can hold: no control characters but tab, line feed and carriage return, no surrogates, no U+FFFE and U+FFFF.
xml_texts = st.text(
    st.characters(codec="utf-8", exclude_categories=["Cs"], exclude_characters="\ufffe\uffff").filter(
        lambda c: c >= " " or c in "\t\n\r"
    ),
    max_size=12,
)
list_items = xml_texts.map(lambda text: "".join(c for c in text if c not in " \t\r\n")).filter(bool)
tokens = st.lists(list_items, max_size=3).map(" ".join)

origins = st.builds(Origin, xml_texts, st.integers(0, 10**20), xml_texts)
interrupts = st.builds(Interrupt, name=names, distance=durations, wcet=durations, origin=maybe(origins))
units = st.builds(Unit, name=names, type=names | st.just(""), interrupts=few(interrupts), origin=maybe(origins))
resources = st.builds(Resource, name=names, bandwidth=maybe(sizes.filter(bool)), origin=maybe(origins))
transfers = st.builds(Transfer, buffer=names, symbol=names, size=sizes)
accesses = st.builds(
    Access,
    resource=names,
    start=durations,
    end=durations,
    bound=shares,
    kind=maybe(st.sampled_from(AccessKind)),
    transfers=few(transfers),
)
precedences = st.builds(
    Precedence,
    task=names,
    min=durations,
    max=durations,
    anchor=st.sampled_from(Anchor),
    origin=maybe(origins),
)
sources = st.builds(
    Source, files=st.lists(list_items, min_size=1, max_size=2).map(tuple), entry=tokens, defines=few(list_items)
)
# A list of split points, or anywhere, never both: the file has one attribute for the two.
splits = st.builds(
    lambda allowed, **rest: Split(points=() if allowed is None else allowed, anywhere=allowed is None, **rest),
    allowed=maybe(few(durations, most=3)),
    resume=durations,
    max_gaps=maybe(st.integers(0, 1_000_000)),
    min_part=maybe(durations),
)
versions = st.builds(
    Version,
    name=names,
    wcet=maybe(durations),
    units=few(names),
    gang=st.integers(0, 3) | st.just(1_000_000),
    accesses=few(accesses),
    precedences=few(precedences),
    source=maybe(sources),
    split=st.just(WHOLE) | splits,
    origin=maybe(origins),
)
tasks = st.builds(
    Task,
    name=names,
    period=maybe(durations),
    slack=shares,
    offset=maybe(durations),
    deadline=maybe(durations),
    distance=maybe(durations),
    binding=st.sampled_from(Binding),
    versions=few(versions),
    origin=maybe(origins),
)
chains = st.builds(
    Chain,
    name=names,
    tasks=some_names,
    max_reaction=maybe(durations),
    max_age=maybe(durations),
    weight=shares,
    origin=maybe(origins),
)
runs = st.builds(Run, task=names, versions=some_names)
modes = st.builds(Mode, name=names, runs=few(runs), origin=maybe(origins))
transitions = st.builds(Transition, source=names, target=names, max_length=maybe(durations), origin=maybe(origins))
rules = st.builds(
    HealthRule,
    task=names,
    event=st.sampled_from(HealthEvent),
    count=st.integers(1, 255),
    cycles=st.integers(1, 255),
    action=st.sampled_from(HealthAction),
    mode=st.just("") | names,
    origin=maybe(origins),
)
task_models = st.builds(
    TaskModel,
    name=names,
    units=few(units),
    resources=few(resources),
    tasks=few(tasks),
    chains=few(chains),
    modes=few(modes),
    transitions=few(transitions),
    health=few(rules),
    origin=maybe(origins),
)

parts = st.builds(Part, start=durations, end=durations, executed_from=durations, executed_to=durations)
jobs = st.builds(
    Job,
    task=names,
    index=st.integers(0, 10**20),
    start=durations,
    end=durations,
    version=names,
    units=some_names,
    parts=few(parts),
)
cost_terms = st.builds(
    CostTerms,
    total=metrics,
    overlap=metrics,
    access=metrics,
    precedence=metrics,
    unit=metrics,
    occupancy=metrics,
    timeliness=metrics,
)
mode_schedules = st.builds(
    ModeSchedule,
    name=names,
    hyperperiod=durations,
    status=st.sampled_from(Status),
    jobs=few(jobs),
    cost=maybe(cost_terms),
    unit_loads=few(st.builds(UnitLoad, unit=names, busy=durations, share=metrics)),
    resource_loads=few(st.builds(ResourceLoad, resource=names, peak=metrics, mean=metrics)),
    chains=few(st.builds(ChainLatency, name=names, reaction=maybe(durations), age=maybe(durations))),
)
transition_tables = st.builds(
    TransitionTable,
    source=names,
    target=names,
    length=durations,
    worst_latency=durations,
    status=st.sampled_from(Status),
    jobs=few(jobs),
)
reactions = st.builds(
    Reaction,
    mode=names,
    task=names,
    event=st.sampled_from(HealthEvent),
    count=st.integers(1, 255),
    cycles=st.integers(1, 255),
    action=st.sampled_from(HealthAction),
    target=st.just("") | names,
    within=maybe(durations),
)
schedules = st.builds(
    Schedule,
    model=names,
    model_sha256=st.just("") | st.text("0123456789abcdef", min_size=64, max_size=64),
    generator=xml_texts,
    solver=xml_texts,
    seed=maybe(st.integers(0, 2**64)),
    tick=maybe(durations),
    modes=few(mode_schedules),
    transitions=few(transition_tables),
    reactions=few(reactions),
)
