"""Linux bundles at the edges of their options, texts and tables: what is written, and what is refused just beyond."""

from dataclasses import replace
from pathlib import Path

import pytest
from test_linux_bundle import planned, refused, sourced, system, two_modes, with_phase, without_programs, write

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.exporters.linux import FORMAT, LinuxOptions, codes
from halpipe.exporters.linux.bundle import Program, _rendered, check_texts, rendered_tables, sentences
from halpipe.exporters.linux.copies import copies_of
from halpipe.exporters.linux.tables import MOST, Part, Table, Tables, _refuge, _refuse_large, thread_levels
from halpipe.models import HealthEvent, HealthRule, Interrupt, Source, Split, Transfer
from stated_options import stated
from support import access, job, model, ms, schedule, task, version

GOLDEN = Path(__file__).parents[1] / "golden" / "exporters" / "linux-two-modes.c"


def test_options_have_their_defaults_and_bounds():
    assert (LinuxOptions().priority, LinuxOptions().busy, LinuxOptions().cpus) == (50, 0, None)
    within = [stated(FORMAT, f"{{{text}}}")[1] for text in ("priority: 1", "priority: 98", "busy: 0", "busy: 100")]
    beyond = [stated(FORMAT, f"{{{text}}}")[1] for text in ("priority: 0", "priority: 99", "busy: 101")]
    assert within == [[]] * 4
    assert all(len(found) == 1 for found in beyond)
    assert stated(FORMAT, "{sources: src}", "/base")[0].sources == "/base/src"


@pytest.mark.parametrize(("entry", "named"), [("both", "1 function"), ("first second", "2 functions")])
def test_the_refusal_counts_pieces_and_functions(tmp_path, entry, named):
    points = (ms(2),) if entry == "both" else (ms(2), ms(5))
    owner = system(Split(points=points), entry)
    with pytest.raises(HalpipeError) as caught:
        write(tmp_path, owner, planned(owner))
    text = f"{len(points)} split points make {len(points) + 1} pieces, the entry names {named}"
    assert [d.message for d in caught.value.diagnostics] == [text]


def test_a_made_up_program_of_two_pieces_has_two_functions(tmp_path):
    owner = without_programs(Split(points=(ms(2),)))
    _, files = write(tmp_path, owner, planned(owner), busy=50)
    assert '"piece_0", "piece_1", }' in files["tables.c"]
    assert '"piece_2"' not in files["tables.c"]
    assert "BUSY_NS=1000000,2000000 " in files["Makefile"]
    assert "int64_t times[2]" in files["src/dummy.c"]


def test_data_are_moved_into_readers_and_out_of_writers(tmp_path):
    """The sizes in bytes differ, so that neither direction nor buffer can be mistaken."""
    owner = with_phase(system(Split(points=(ms(2),)), "first second"), 2, 3)
    long = owner.tasks[1]
    into = replace(access("memory", 2, 3, "1/2"), transfers=(Transfer(buffer="x", symbol="seen", size=4),))
    out = replace(access("memory", 3, 4, "1/2", kind="write"), transfers=(Transfer(buffer="y", symbol="made", size=8),))
    moved = replace(long, versions=(replace(long.versions[0], accesses=(into, out)),))
    owner = replace(owner, tasks=(owner.tasks[0], moved))
    tables = replace(schedule(owner, 20, job(owner, "long", 0, 1, "u1")))
    programs = sourced_programs(tmp_path, owner, tables)
    assert '[] = { {"seen", 0, 4}, };' in programs["in"]
    assert '[] = { {"made", 1, 8}, };' in programs["out"]


def sourced_programs(folder, owner, tables):
    owner = replace(owner, tasks=tuple(sourced(t, "first second both both") for t in owner.tasks))
    owner = replace(owner, tasks=tuple(replace(t, versions=tuple(whole(v) for v in t.versions)) for t in owner.tasks))
    _, files = write(folder, owner, tables)
    lines = files["tables.c"].splitlines()
    return {kind: next(x for x in lines if f"dispatch_move {kind}_" in x) for kind in ("in", "out")}


def whole(one):
    return replace(one, split=Split(points=(ms(2), ms(3), ms(4)))) if one.accesses else one


@pytest.mark.parametrize("files", [("ready.so", "program.c"), ("program.c", "ready.so"), ("a.so", "b.so")])
def test_a_shared_object_beside_other_files_is_refused(tmp_path, files):
    """Only the first file would be copied, whatever it is, and the rest be left out in silence."""
    owner = model(task("t", 10, version("v", "1ms", "u1")), units="u1")
    source = Source(files=files, entry="step")
    [owned] = owner.tasks
    owner = replace(owner, tasks=(replace(owned, versions=(replace(owned.versions[0], source=source),)),))
    for name in source.files:
        (tmp_path / name).write_bytes(b"a program")
    tables = schedule(owner, 10, job(owner, "t", 0, 0, "u1", "v"))
    with pytest.raises(HalpipeError) as caught:
        FORMAT.write(owner, tables, LinuxOptions(sources=str(tmp_path), cpus={"u1": 0}))
    assert [d.code for d in caught.value.diagnostics] == [codes.NOT_ALONE.id]


def test_a_dispatcher_without_tasks_has_one_level():
    empty = model(units="u1")
    assert thread_levels(empty, schedule(empty, 10), 98) == {}
    with pytest.raises(HalpipeError, match="1 levels from 99"):
        thread_levels(empty, schedule(empty, 10), 99)


def test_the_refusal_of_levels_names_the_highest_priority_that_fits():
    owner = system()
    with pytest.raises(HalpipeError) as caught:
        thread_levels(owner, planned(owner), 98)
    [found] = caught.value.diagnostics
    assert found.help == "state --priority 97 or lower"
    assert thread_levels(owner, planned(owner), 97)


@pytest.mark.parametrize(("length", "fits"), [(MOST, True), (MOST + 1, False)])
@pytest.mark.parametrize("what", ["tables", "parts of a nanosecond", "nanoseconds of a table"])
def test_tables_are_refused_from_one_above_their_types(what, length, fits):
    """The types of `dispatch.h`: 16 bits for numbers of tables, 62 bits for times."""
    owner, findings = model(units="u1"), Findings()
    most = 2**62 if "nanosecond" in what else MOST
    count = most if fits else most + 1
    tables = Tables(count if what.startswith("parts") else 1, [], [])
    table = Table("m", count if what.startswith("nano") else 1, 0, 0, 0)
    tables.tables = [table] * (count if what == "tables" else 1)
    _refuse_large(tables, {}, {}, owner, findings)
    assert [what in found.message for found in findings.items] == [True] * (not fits)
    assert all(found.code == codes.TOO_LARGE.id for found in findings.items)


@pytest.mark.parametrize(
    ("event", "stated"), [("overrun", (1, -1)), ("fault", (-1, 1)), ("any", (1, 1)), ("miss", (-1, -1))]
)
def test_a_worker_has_the_mode_that_its_health_rules_go_to(event, stated):
    owner, tables = two_modes()
    known = {str(each): each for each in HealthEvent}
    rules = (
        HealthRule(task="b", event=known.get(event, HealthEvent.OVERRUN), mode="one"),
        HealthRule(task="b", event=known.get(event, HealthEvent.OVERRUN), mode="both"),
    )
    lost = HealthRule(task="b", event=HealthEvent.ANY, mode="elsewhere")
    owner = replace(owner, health=(lost, *rules) if event in known else (lost,))
    found = [_refuge(owner, tables, "b", each) for each in (HealthEvent.OVERRUN, HealthEvent.FAULT)]
    assert (*found, _refuge(owner, tables, "a", HealthEvent.OVERRUN)) == (*stated, -1)


@pytest.mark.parametrize(
    ("split", "interrupts", "early"), [(False, False, True), (True, False, False), (False, True, False)]
)
def test_phases_wait_where_jobs_are_split_or_interrupted(split, interrupts, early):
    phase = access("memory", 2, 3, "1/2")
    one = version("v", 6, "u1", phase)
    one = replace(one, split=Split(points=(ms(2),))) if split else one
    owner = model(task("long", 20, one), units="u1", resources="memory")
    if interrupts:
        load = Interrupt(name="i", wcet=ms("0.1ms"), distance=ms(5))
        owner = replace(owner, units=(replace(owner.units[0], interrupts=(load,)),))
    tables = schedule(owner, 20, job(owner, "long", 0, 1, "u1"))
    said = [text for text, _ in sentences(owner, tables, LinuxOptions())]
    assert any("bounds of access phases are not enforced" in text for text in said)
    assert any("and phases begin when the program comes to them" in text for text in said) == early


@pytest.mark.parametrize(("period", "fits"), [("40ms", True), ("39ms", False)])
def test_a_let_may_be_as_long_as_the_period(period, fits):
    owned = task("a", "40ms", version("v", "1ms", "u1"))
    owned = replace(owned, let=ms(40), period=ms(period))
    owner = model(owned, units="u1")
    findings = Findings()
    program = Program("a/v", "p", ("step",), ("a.c",), (), (), (), written=((0, 1, 8),))
    tables = schedule(replace(owner, tasks=(replace(owned, period=ms(40)),)), 40, job(owner, "a", 0, 0, "u1"))
    copies_of(owner, tables, [program], {("a", "v"): 0}, findings)
    assert any("its LET of 40ms is longer than its period of 39ms" in d.message for d in findings.items) is not fits


def test_the_first_of_several_releases_in_the_next_table_counts(tmp_path):
    """The job of 8 ms to 16 ms meets the release at 1 ms of the next cycle, not the later one at 6 ms."""
    owned = replace(task("a", 5, version("v", "1ms", "u1")), let=ms(5), offset=ms(1))
    owner = model(owned, units="u1")
    program = Program("a/v", "p", ("step",), ("a.c",), (), (), (), written=((0, 1, 8),))
    tables = schedule(owner, 10, job(owner, "a", 0, 1, "u1"), job(owner, "a", 1, 6, "u1"))
    findings = Findings()
    copies_of(owner, tables, [program], {("a", "v"): 0}, findings)
    assert findings.items == []
    longer = replace(owner, tasks=(replace(owned, let=ms("5.001ms")),))
    copies_of(longer, tables, [program], {("a", "v"): 0}, findings)
    assert 'writes 1us after the release of the next one, in table "all"' in findings.items[-1].message


def test_programs_that_stand_in_are_written_where_they_are_used():
    plain = Program("a", "p", ("step",), ("a.c",), (), (), ())
    values = {
        "name": "n",
        "compiled": [],
        "ready": [],
        "priority": 50,
        "cpus": [0],
        "places": [],
        "unrealised": [],
        "regulated": False,
    }
    assert "src/dummy.c" not in _rendered(values, [plain])
    assert "src/dummy.c" in _rendered(values, [plain, replace(plain, files=("src/dummy.c",))])


def test_the_length_of_a_switch_stands_beside_those_of_the_modes(tmp_path):
    owner, tables = two_modes()
    _, files = write(tmp_path, owner, tables, busy=1)
    lines = [x.strip() for x in files["tables.c"].splitlines() if ".length = " in x]
    assert [line.split(".length = ")[1].split("}")[0] for line in lines] == [
        "10000000, .rest = 0, .from = 0, .to = 0",
        "10000000, .rest = 0, .from = 1, .to = 1",
        "0, .rest = 0, .from = 0, .to = 1",
        "5000000, .rest = 0, .from = 1, .to = 0",
    ]
    assert "switches[] = { -1, 2, 3, -1, }" in files["tables.c"]


def test_the_tables_of_two_modes_are_those_of_the_golden_file(tmp_path):
    """Names with `>` stay what they are, and no line differs."""
    owner, tables = two_modes()
    _, files = write(tmp_path, owner, tables, busy=50, cpus={"u1": 3})
    assert files["tables.c"] == GOLDEN.read_text()


def test_tables_without_tasks_have_one_level():
    empty = model(units="u1")
    assert b".levels = 1," in rendered_tables(empty, schedule(empty, 10), Tables(1, [], []), [], {}, {})


def test_what_one_of_several_versions_or_units_has_is_said():
    plain, phased = version("v", 6, "u1"), version("v", 6, "u2", access("memory", 2, 3, "1/2"))
    owner = model(task("a", 20, plain), task("b", 20, phased), units="u1 u2", resources="memory")
    load = Interrupt(name="i", wcet=ms("0.1ms"), distance=ms(5))
    owner = replace(owner, units=(owner.units[0], replace(owner.units[1], interrupts=(load,))))
    tables = schedule(owner, 20, job(owner, "a", 0, 1, "u1"), job(owner, "b", 0, 1, "u2"))
    said = [text for text, _ in sentences(owner, tables, LinuxOptions())]
    assert "bounds of access phases are not enforced" in said


def test_long_names_are_cut_in_the_refusal_and_told_apart_by_length():
    findings = Findings()
    owner = model(task("t", 10, version()), units="u1", name="'" + "n" * 70)
    check_texts(owner, schedule(owner, 10), ["b" * 1000, "b" * 1001], findings)
    cut, model_name = sorted(found.message for found in findings.items)
    assert model_name == f"{'b' * 60!r} has other characters"
    assert cut == f"{chr(39) + 'n' * 59!r} has other characters"


def test_the_help_for_a_late_start_names_the_largest_offset():
    owned = replace(task("a", 40, version("v", "1ms", "u1")), let=ms(30), offset=ms(38))
    owner = model(owned, units="u1")
    program = Program("a/v", "p", ("step",), ("a.c",), (), (), (), written=((0, 1, 8),))
    findings = Findings()
    copies_of(owner, schedule(owner, 40, job(owner, "a", 0, 10, "u1")), [program], {("a", "v"): 0}, findings)
    assert [found.help for found in findings.items] == ["state an offset of at most 10ms, or less slack"]


def test_the_sizes_of_pieces_are_those_of_the_program_with_most(tmp_path):
    owner = without_programs(Split(points=(ms(2), ms(5))))
    short = owner.tasks[0]
    short = replace(short, versions=(replace(short.versions[0], split=Split(points=(ms("0.5ms"),))),))
    owner = replace(owner, tasks=(short, owner.tasks[1]))
    _, files = write(tmp_path, owner, planned(owner), busy=50)
    assert "int64_t times[3]" in files["src/dummy.c"]


def test_what_is_written_comes_first_whatever_the_order_of_the_jobs():
    writer = replace(task("w", 40, version("v", "1ms", "u1")), let=ms(20))
    reader = replace(task("r", 40, version("v", "1ms", "u2")), let=ms(20), offset=ms(20))
    owner = model(writer, reader, units="u1 u2")
    plain = Program("w/v", "p", ("step",), ("a.c",), (), (), (), written=((0, 1, 8),))
    programs = [plain, replace(plain, written=(), read=((1, 2, 8),))]
    tables = schedule(owner, 40, job(owner, "r", 0, 20, "u2"), job(owner, "w", 0, 0, "u1"))
    [rows] = copies_of(owner, tables, programs, {("w", "v"): 0, ("r", "v"): 1}, Findings())
    assert [(row.at, row.source) for row in rows] == [(20_000_000, 0), (20_000_000, 1)]


def test_only_units_with_jobs_and_only_gangs_are_named(tmp_path):
    owner = model(task("a", 10, version("v", 1, "u1")), units="u1 u2")
    _, files = write(tmp_path, owner, schedule(owner, 10, job(owner, "a", 0, 0, "u1")), busy=1, cpus={"u1": 3, "u2": 4})
    assert "| u1 | 3 |" in files["README.md"]
    assert "u2" not in files["README.md"]
    assert "occupy several units" not in files["README.md"]


def test_the_longest_of_several_tables_counts():
    owner, findings = model(units="u1"), Findings()
    _refuse_large(Tables(1, [Table("m", 2**62 + 1, 0, 0, 0), Table("n", 1, 0, 1, 1)], []), {}, {}, owner, findings)
    assert ["nanoseconds of a table" in found.message for found in findings.items] == [True]


@pytest.mark.parametrize(("count", "fits"), [(MOST, True), (MOST + 1, False)])
def test_the_job_with_most_parts_counts(count, fits):
    owner, findings, part = model(units="u1"), Findings(), Part(0, 0, 1)
    _refuse_large(Tables(1, [], [], [], [(part,), (part,) * count]), {}, {}, owner, findings)
    assert ["parts of a job" in found.message for found in findings.items] == [True] * (not fits)


@pytest.mark.parametrize(("highest", "help"), [(97, "state --priority 1 or lower"), (98, "let fewer tasks preempt")])
def test_levels_that_fit_nowhere_have_another_remedy(highest, help, monkeypatch):
    monkeypatch.setattr("halpipe.exporters.linux.tables.levels_of", lambda _: {"": {"a": highest}})
    owner = model(task("a", 10, version("v", 1, "u1")))
    with pytest.raises(HalpipeError) as caught:
        thread_levels(owner, schedule(owner, 10), 50)
    assert caught.value.diagnostics[0].help.startswith(help)


def test_phases_are_held_where_one_of_the_units_serves_interrupts(tmp_path):
    load = Interrupt(name="i", wcet=ms("0.1ms"), distance=ms(5))
    phased = sourced(task("a", 20, version("v", 6, "u1", access("memory", 2, 3, "1/2"))), "both")
    owner = model(phased, units="u1 u2", resources="memory")
    tables = schedule(owner, 20, job(owner, "a", 0, 0, "u1"))
    assert write(tmp_path, owner, tables, cpus={"u1": 0, "u2": 1})
    owner = replace(owner, units=(owner.units[0], replace(owner.units[1], interrupts=(load,))))
    assert refused(tmp_path, owner, tables, cpus={"u1": 0, "u2": 1}) == [codes.EARLY_PHASE.id]
    split = sourced(task("b", 20, version("v", 1, "u2")), "both")
    split = replace(split, versions=(replace(split.versions[0], split=Split(anywhere=True, max_gaps=1)),))
    other = model(phased, split, units="u1 u2", resources="memory")
    said = [text for text, _ in sentences(other, tables, LinuxOptions())]
    assert "bounds of access phases are not enforced" in said
