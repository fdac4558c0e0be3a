"""The structs that the simulation in C and Python share have the same fields, in the same order."""

import re
from dataclasses import replace
from fractions import Fraction

import pytest
from split_helpers import interrupts, points, split

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.libraries import words
from halpipe.models import Split
from halpipe.pipeline.jobs import expand, natural_tick
from halpipe.pipeline.solve.codes import TOO_LARGE
from halpipe.pipeline.solve.edf import native
from halpipe.pipeline.solve.edf.fixed import fix
from halpipe.pipeline.solve.edf.plans import allowed_ways, first_plan
from halpipe.pipeline.solve.edf.trials import Simulator
from halpipe.pipeline.solve.edf.works import works_of
from support import access, after, job, model, ms, task, version

HEADER = (native.SOURCES / "system.h").read_text()


def fields_of(struct):
    """The names of the fields that the header declares."""
    [body] = re.findall(r"typedef struct \{([^}]*)\} " + struct + ";", HEADER)
    declared = re.sub(r"/\*.*?\*/", "", body, flags=re.DOTALL).replace("*", " ").split(";")
    return [name.split()[-1] for line in declared for name in line.split(",") if name.strip()]


@pytest.fixture(scope="module")
def sides():
    owner = model(task("a", 5, version("v", 1), slack=1), task("b", 20, version("w", 10), slack=1))
    expansion = expand(owner, owner.modes[0])
    mode = works_of(owner, expansion, natural_tick(expansion))
    system = native.System(mode, 8)
    told = native.Told(system, first_plan(mode, allowed_ways(mode, {})), 1)
    return {"System": system, "Plan": told, "Memory": native.Memory(system, told, native.FIRST_ROOM)}


@pytest.mark.parametrize("struct", ["System", "Plan", "Memory"])
def test_both_sides_have_the_same_fields(sides, struct):
    assert list(sides[struct].fields) == fields_of(struct)


def test_what_python_reads_is_where_it_looks(sides):
    names = list(sides["Memory"].fields)
    places = {"lack": native.LACK, "begin": native.BEGIN, "end": native.END, "part_count": native.PART_COUNT}
    assert {name: names.index(name) for name in places} == places


@pytest.mark.parametrize(
    ("struct", "size"),
    [
        ("Job", native.JOB_WORDS),
        ("Event", native.EVENT_WORDS),
        ("Part", native.PART_WORDS),
        ("Held", native.CLAIM_WORDS),
    ],
)
def test_records_are_as_long_as_python_thinks(struct, size):
    assert len(fields_of(struct)) == size


def test_what_lacks_has_a_bit_for_each_room(sides):
    [bits] = re.findall(r"enum \{ (EVENTS[^}]*) \}", HEADER)
    named = [(name.strip().lower(), int(value)) for name, value in (bit.split("=") for bit in bits.split(","))]
    assert named == [(name, 1 << place) for place, name in enumerate(native.FIRST_ROOM)]
    memory = sides["Memory"]
    memory.words[native.LACK] = 5
    assert memory.lacks_room == ("events", "parts")


def test_no_field_is_left_out_of_the_words(sides):
    for side in sides.values():
        assert len(words(side.fields.values())) == len(side.fields)


# ------------------------------------------------------------------------------------------------ what is handed over


ROOM = {"events": 5, "history": 3, "parts": 7, "claims": 11, "signature": 13, "open": 2}


@pytest.fixture(scope="module")
def written():
    """A mode with windows, phases, pieces, interrupts and a task on demand, as the library gets it."""
    wants, follows = after("h", 2, 6), after("a", 1, 9, "end")
    anywhere = Split(anywhere=True, max_gaps=1, min_part=ms(1), resume=ms(1))
    owner = model(
        task("a", 10, version("v", 3, "u1", access("r", 1, 3, "1/2"), access("r", 0, 1, "1/4"), wants), offset=1),
        task("b", 20, split(version("v", 8, "u1 u2", follows), points(3, 5)), slack=1),
        task("c", 20, split(version("v", 4, "u2"), anywhere), slack="1/4"),
        task("h", None, version("v", 1, "u2")),
        units="u1 u2",
        resources="r s",
    )
    owner = interrupts(owner, "u2", (20, 1))
    expansion = expand(owner, owner.modes[0])
    mode = works_of(owner, expansion, natural_tick(expansion))
    system = native.System(mode, 8)
    plan = replace(first_plan(mode, allowed_ways(mode, {})), holds=(0, 4, 0, 2))
    told = native.Told(system, plan, ROOM["open"])
    return system, told, native.Memory(system, told, ROOM)


def rows(fields, name, struct):
    """The rows of a table, as long as the header has the fields of their struct."""
    width = len(fields_of(struct))
    flat = fields[name].tolist()
    return [tuple(flat[at : at + width]) for at in range(0, len(flat), width)]


def test_a_mode_is_written_down_in_ticks_with_where_rows_begin(written):
    fields = written[0].fields
    sizes = {name: fields[name] for name in ("tasks", "units", "resources", "cycle", "most_cycles")}
    assert sizes == {"tasks": 4, "units": 2, "resources": 2, "cycle": 20, "most_cycles": 8}
    assert rows(fields, "task", "Task") == [(0, 10, 1, 0), (19, 20, 1, 0), (5, 20, 1, 0), (0, 20, 0, 0)]
    ways = rows(fields, "ways", "Way")
    assert [way[:5] for way in ways] == [
        (0, 0, 0, 0, 0),
        (1, 0, 1, 2, 1),
        (2, 0, 4, 2, 2),
        (3, 1, 7, 2, 3),
        (4, 2, 8, 2, 3),
        (5, 3, 9, 2, 3),
    ]
    assert [way[5:] for way in ways[:5]] == [
        (3, 3, 0, 0, 0, 1),
        (8, 8, 0, 0, 10**9, 1),
        (8, 9, 0, 0, 10**9, 1),
        (4, 5, 1, 1, 1, 1),
        (1, 2, 0, 0, 0, 1),
    ]
    assert fields["way_units"].tolist() == [0, 0, 1, 1, 1]
    assert rows(fields, "services", "Service") == [(20, 1)] * 3
    assert fields["ends"].tolist() == [3, 3, 5, 8, 3, 5, 8, 4, 1]
    assert rows(fields, "phases", "Phase") == [(0, 1, 3, 2), (0, 0, 1, 1)]
    assert rows(fields, "by_begin", "Stretch") == [(0, 1), (1, 3)]
    assert rows(fields, "by_end", "Stretch") == [(1, 3), (0, 1)]
    assert rows(fields, "windows", "Window") == [(3, 2, 6, 0), (0, 1, 9, 1), (0, 1, 9, 1)]
    assert fields["capacity"].tolist() == [4, 1]


def test_a_plan_is_written_down_with_who_looks_back_at_whom(written):
    """Jobs of `h` are released with those of `a`, which demand them, and held; `b` looks back at ends of `a`."""
    fields = {name: field if name == "fresh" else field.tolist() for name, field in written[1].fields.items()}
    assert fields == {
        "fresh": 1,
        "way": [0, 1, 3, 4],
        "holds": [0, 4, 0, 2],
        "urgency": [3, 20, 10, 0],
        "releases": [1, 11, 4, 0, 3, 13],
        "releases_at": [0, 2, 3, 4, 6],
        "on_unit": [0, 1, 2, 3],
        "on_unit_at": [0, 2, 4],
        "followers": [0, 0],
        "followers_at": [0, 1, 1, 1, 2],
        "reach": [9, 0, 0, 6],
        "history": [0, -1, -1, 1],
        "parts_at": [0, 1, 3, 5, 6],
    }
    assert [written[1].first_release(task) for task in range(4)] == [1, 4, 0, 3]


def test_memory_has_the_room_that_it_says(written):
    """Sizes in records of the header; the library writes to the last of them and asks for nothing else."""
    memory = written[2]
    words_of = {"jobs": "Job", "events": "Event", "open": "Part", "claims": "Held", "asked": "Claim", "near": "Claim"}
    words_of["parts"] = "Part"
    sizes = {name: len(field) for name, field in memory.fields.items() if not isinstance(field, int)}
    records = {
        name: size / len(fields_of(words_of[name])) if name in words_of else size for name, size in sizes.items()
    }
    rooms = {name: value for name, value in memory.fields.items() if name.endswith("_room")}
    tasks, units, resources, jobs, claims = 4, 2, 2, 6, ROOM["claims"]
    assert rooms == {
        "event_room": ROOM["events"] + 4 * tasks,
        "history_room": ROOM["history"],
        "part_room": ROOM["parts"] + 2 * jobs,
        "claim_room": claims,
        "near_room": claims,
        "signature_room": ROOM["signature"] + 16 * tasks,
    }
    seats = {"pending": tasks, "stacks": tasks, "candidates": tasks, "late": tasks, "jobs": tasks, "open": 6}
    each_unit = dict.fromkeys(("pending_count", "stack_count", "running", "is_touched"), units)
    each_resource = dict.fromkeys(("claims_of", "claim_count", "claim_most"), resources)
    each_job = dict.fromkeys(("first", "count", "release", "start", "finish"), jobs)
    looked_back_at = {"past": 2 * 2 * ROOM["history"], "past_count": 2 * 2}
    asked = {"claims": claims, "near": claims, "asked": 2, "events": rooms["event_room"], "parts": rooms["part_room"]}
    signed = {"signatures": 2 * rooms["signature_room"]}
    assert records == seats | each_unit | each_resource | each_job | looked_back_at | asked | signed


def test_memory_begins_with_nothing_in_progress(written):
    memory = written[2]
    full = {
        name: set(field) for name, field in memory.fields.items() if not isinstance(field, int) and set(field) != {0}
    }
    ends = set(full.pop("claims"))
    assert full == {"running": {-1}, "claims_of": {-1}, "claim_most": {64}}
    assert ends == {*range(1, ROOM["claims"]), -1, 0}
    assert [held[-1] for held in rows(memory.fields, "claims", "Held")] == [*range(1, ROOM["claims"]), -1]
    counts = {name: value for name, value in memory.fields.items() if isinstance(value, int) and "room" not in name}
    assert {name for name, value in counts.items() if value} == {"signed_before"}
    assert counts["signed_before"] == -1


def test_jobs_that_stay_are_written_down_with_their_claims_within_the_hyperperiod():
    """Of 20 ms. The first job ends after it, so that its second claim is one at its beginning, seen from there."""
    wants = access("r", 0, 1, "1/2"), access("s", 1, 4), access("r", 3, 4, "1/4")
    owner = model(
        task("free", 10, version("v", 1, "u3")),
        task("late", 20, version("v", 4, "u1", *wants), slack=1),
        task("gang", 20, version("v", 3, "u2 u3", access("r", 1, 3, "1/4"), gang=2), slack=1),
        units="u1 u2 u3",
        resources="r s",
    )
    expansion = expand(owner, owner.modes[0])
    mode = works_of(owner, expansion, ms(1))
    shipped = {(j.task, j.index): j for j in (job(owner, "late", 0, 17, "u1"), job(owner, "gang", 0, 5, "u2 u3"))}
    mode = replace(mode, fixed=fix(mode, shipped)[0])
    system = native.System(mode, 8)
    assert [task[-1] for task in rows(system.fields, "task", "Task")] == [0, 1, 1]
    assert rows(system.fields, "fixed", "Fixed") == [(1, 17, 21, 0), (2, 5, 8, 1), (0, 0, 0, 3)]
    assert system.fields["fixed_units"].tolist() == [0, 1, 2]
    assert rows(system.fields, "standing", "Claim") == [(0, 0, 1, 1), (0, 6, 8, 1), (0, 17, 18, 2), (1, 18, 21, 1)]
    assert system.fields["standing_at"].tolist() == [0, 3, 4]
    assert system.fields["longest"].tolist() == [2, 3]
    assert system.fields["places_at"].tolist()[0] == 0
    assert rows(system.fields, "places", "Place") == [row for unit in range(3) for row in mode.fixed.walls[unit].rows()]
    assert system.fields["walls_at"].tolist() == [0, 4, 7, 10]
    assert system.fields["walls"].tolist() == [-23, -3, 17, 37, -15, 5, 25, -15, 5, 25]
    told = native.Told(system, first_plan(mode, allowed_ways(mode, {})), 1)
    assert [told.first_release(task) for task in range(3)] == [0, None, None]
    assert told.fields["on_unit"].tolist() == [0]
    assert told.fields["on_unit_at"].tolist() == [0, 0, 0, 1]
    memory = native.Memory(system, told, ROOM)
    assert memory.fields["event_room"] == ROOM["events"] + 4 * 3 + 4 * 2


@pytest.mark.parametrize(("length", "is_simulated"), [(2**61 // 9, True), (2**61 // 9 + 1, False)])
def test_times_of_eight_hyperperiods_and_the_next_have_to_stay_below_the_limit(length, is_simulated):
    period = f"{length}ns"
    owner = model(task("a", period, split(version("v", "2ns"), Split(points=(ms("1ns"),))), slack=1))
    expansion = expand(owner, owner.modes[0])
    mode = works_of(owner, expansion, ms("1ns"))
    simulator, plan = Simulator(mode), first_plan(mode, allowed_ways(mode, {}))
    if is_simulated:
        assert list(simulator.table(plan).jobs(0)) == [(0, ((0, 2, 0, 2),))]
    else:
        with pytest.raises(HalpipeError) as refused:
            simulator.table(plan)
        assert [found.code for found in refused.value.diagnostics] == [TOO_LARGE.id]


@pytest.mark.parametrize(
    ("anywhere", "gaps", "shortest", "parts"),
    [
        (False, None, None, 3),
        (False, 1, None, 2),
        (False, 0, None, 1),
        (True, 9, 2, 4),
        (True, 1, 2, 2),
        (True, 9, 9, 1),
    ],
)
def test_a_job_has_as_many_parts_as_its_points_its_gaps_and_the_shortest_allow(anywhere, gaps, shortest, parts):
    """Of 8 ms with points at 3 and 5 ms; anywhere, in parts of at least so many milliseconds, of which one is left."""
    how = Split(points=() if anywhere else (ms(3), ms(5)), anywhere=anywhere, max_gaps=gaps, min_part=ms(shortest))
    owner = model(task("a", 20, split(version("v", 8), how), slack=1))
    expansion = expand(owner, owner.modes[0])
    [work] = works_of(owner, expansion, ms(1), Fraction(1)).works
    assert native.most_parts(work.ways[0]) == parts


def test_turning_to_another_hyperperiod_forgets_the_jobs_of_the_last(written):
    system, told, _ = written
    memory = native.Memory(system, told, ROOM)
    memory.counts[:], memory.late[:] = memory.starts[:], native.ints([7, 7, 7, 7])
    memory.counts[2], memory.words[native.PART_COUNT] = 3, 5
    memory.turn(20, 40)
    assert (memory.words[native.BEGIN], memory.words[native.END], memory.words[native.PART_COUNT]) == (20, 40, 0)
    assert set(memory.counts) == set(memory.late) == {0}
    assert (len(memory.counts), len(memory.late)) == (6, 4)
