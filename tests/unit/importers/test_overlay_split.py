"""What an overlay says of split jobs, bound and polled tasks, and interrupts (MODEL 8.1)."""

from dataclasses import replace

from overlay_case import applied, apply, imported, overlay

from halpipe.importers.overlay import OverlayUse, codes
from halpipe.models import Binding, Interrupt, Split
from support import access, model, ms, task, version


def of(diagnostics, code):
    return [d for d in diagnostics if d.code == code.id]


def only_version(result, name):
    return result.task(name).versions[0]


def test_split_points_and_their_settings(tmp_path):
    text = "tasks: {/planning: {wcet: 10ms, split: [4ms, 9ms], resume: 0.1ms, max-gaps: 1}}"
    expected = Split(points=(ms(4), ms(9)), resume=ms("0.1ms"), max_gaps=1)
    assert only_version(applied(tmp_path, text), "/planning").split == expected


def test_a_single_point_stands_alone(tmp_path):
    found = applied(tmp_path, "tasks: {/planning: {wcet: 10ms, split: 4ms}}")
    assert only_version(found, "/planning").split == Split(points=(ms(4),))


def test_anywhere_for_a_version(tmp_path):
    text = "tasks: {/planning: {versions: {v: {wcet: 10ms, split: anywhere, max-gaps: 0, min-part: 1ms}}}}"
    expected = Split(anywhere=True, max_gaps=0, min_part=ms(1))
    assert only_version(applied(tmp_path, text), "/planning").split == expected


def split_source(**fields):
    owner = task("t", 20, replace(version("default", 8), split=Split(**fields)))
    return model(owner)


def test_what_replaces_the_source_is_reported(tmp_path):
    source = split_source(points=(ms(1), ms(2)), max_gaps=2)
    text = "tasks: {t: {split: anywhere, max-gaps: 5, resume: 1us, binding: system, distance: 30ms}}"
    result, diagnostics, _ = apply(overlay(tmp_path, text), source)
    assert only_version(result, "t").split == Split(anywhere=True, max_gaps=5, resume=ms("1us"))
    assert result.task("t").binding is Binding.SYSTEM
    assert result.task("t").distance == ms(30)
    assert {d.message for d in of(diagnostics, codes.OVERRIDDEN)} == {
        "split: anywhere replaces 1ms, 2ms of the source",
        "max-gaps: 5 replaces 2 of the source",
    }


def test_none_takes_the_split_of_the_source_away(tmp_path):
    result = applied(tmp_path, "tasks: {t: {split: none}}", to=split_source(anywhere=True, max_gaps=2))
    assert not only_version(result, "t").split.is_allowed


def test_the_default_entry_splits_only_what_the_source_does_not(tmp_path):
    source = split_source(points=(ms(1),))
    result = applied(tmp_path, 'tasks: {"*": {split: [2ms], binding: mode}}', to=source)
    assert only_version(result, "t").split.points == (ms(1),)
    result, _, coverage = apply(overlay(tmp_path, 'tasks: {"*": {split: [2ms], binding: mode}}'), split_source())
    assert only_version(result, "t").split.points == (ms(2),)
    assert {d.what for d in coverage.defaulted_values} == {"split", "binding"}


def test_a_new_version_is_not_cut_where_the_imported_one_is(tmp_path):
    text = "tasks: {t: {versions: {fast: {wcet: 2ms}}}}"
    result = applied(tmp_path, text, to=split_source(points=(ms(3),), resume=ms("1us")))
    assert result.task("t").version("fast").split == Split(resume=ms("1us"))
    result = applied(tmp_path, text, to=split_source(anywhere=True, max_gaps=2))
    assert result.task("t").version("fast").split == Split(anywhere=True, max_gaps=2)


def test_a_shorter_wcet_needs_new_split_points(tmp_path):
    _, diagnostics, _ = apply(overlay(tmp_path, "tasks: {t: {wcet: 3ms}}"), split_source(points=(ms(1), ms(4))))
    (found,) = of(diagnostics, codes.DOES_NOT_FIT)
    assert "split point 4ms is not below the WCET 3ms" in found.message
    assert (found.at.file, found.at.line) == (str(tmp_path / "overlay0.yaml"), 2)
    assert applied(tmp_path, "tasks: {t: {wcet: 3ms, split: [1ms]}}", to=split_source(points=(ms(1), ms(4))))


def test_what_does_not_fit_a_new_wcet_is_told_with_the_line_of_the_overlay(tmp_path):
    """Phases of an import have no line of their own."""
    source = model(task("t", 10, version("v", 5, "u1", access("mem", 3, 5))), resources="mem")
    _, diagnostics, _ = apply(overlay(tmp_path, "tasks:\n  t:\n    slack: 1\n    wcet: 4ms\n"), source)
    (found,) = of(diagnostics, codes.DOES_NOT_FIT)
    assert (found.message, found.at.line) == ("an access phase ends at 5ms, the WCET is 4ms", 5)
    points = "tasks:\n  t:\n    slack: 1\n    split: [8ms]\n"
    _, diagnostics, _ = apply(overlay(tmp_path, points), split_source())
    assert [d.at.line for d in of(diagnostics, codes.DOES_NOT_FIT)] == [5]


# ------------------------------------------------------------------------------------------------ interrupts

TIMER = Interrupt(name="timer", distance=ms(1), wcet=ms("10us"))


def bare(interrupts):
    return [replace(i, origin=None) for i in interrupts]


def test_interrupts_of_listed_units(tmp_path):
    text = "platform: {units: [{name: core0, interrupts: [{name: timer, distance: 1ms, wcet: 10us}]}]}"
    (unit,) = applied(tmp_path, text).units
    assert bare(unit.interrupts) == [TIMER]
    assert unit.interrupts[0].origin.line == 2


def test_interrupts_join_the_units_of_the_source(tmp_path):
    text = 'platform: {interrupts: [{units: "core*", name: timer, distance: 1ms, wcet: 10us}]}'
    given = overlay(tmp_path, text)
    assert OverlayUse(given).states_interrupt("timer")
    assert not OverlayUse(given).states_interrupt("other")
    assert bare(apply(given)[0].units[0].interrupts) == [TIMER]


def with_timer():
    source = imported()
    return replace(source, units=(replace(source.units[0], interrupts=(TIMER,)),))


def test_an_interrupt_of_the_source_is_replaced(tmp_path):
    text = "platform: {interrupts: [{units: core0, name: timer, distance: 2ms, wcet: 10us}]}"
    result, diagnostics, _ = apply(overlay(tmp_path, text), with_timer())
    assert bare(result.units[0].interrupts) == [replace(TIMER, distance=ms(2))]
    (note,) = of(diagnostics, codes.OVERRIDDEN)
    assert note.message == "interrupt: 10us every 2ms replaces 10us every 1ms of the source"
    assert note.path == 'unit "core0" interrupt "timer"'


def test_a_later_overlay_wins(tmp_path):
    text = "platform: {interrupts: [{units: core0, name: timer, distance: 3ms, wcet: 10us}]}"
    texts = [text, text.replace("3ms", "1ms")]
    assert bare(applied(tmp_path, *texts).units[0].interrupts) == [TIMER]


def test_a_listed_unit_keeps_the_interrupts_of_the_source(tmp_path):
    result, diagnostics, _ = apply(overlay(tmp_path, "platform: {units: [{name: core0}]}"), with_timer())
    assert bare(result.units[0].interrupts) == [TIMER]
    assert diagnostics == ()


def test_units_that_are_listed_keep_the_interrupts_of_the_source_each_its_own(tmp_path):
    source = imported()
    units = (replace(source.units[0], interrupts=(TIMER,)), replace(source.units[0], name="core1"))
    text = "platform: {units: [{name: core1}, {name: core0}]}"
    found = applied(tmp_path, text, to=replace(source, units=units)).units
    assert {unit.name: bare(unit.interrupts) for unit in found} == {"core0": [TIMER], "core1": []}


def test_an_interrupt_is_stated_with_its_unit_or_apart(tmp_path):
    stated = "name: timer, distance: 1ms, wcet: 10us"
    listed = f"platform: {{units: [{{name: core0, interrupts: [{{{stated}}}]}}, {{name: core1}}]}}"
    apart = f'platform: {{interrupts: [{{units: "core*", {stated}}}]}}'
    for text in (listed, apart):
        use = OverlayUse(overlay(tmp_path, text))
        assert (use.states_interrupt("timer"), use.states_interrupt("other")) == (True, False)
    assert not OverlayUse(overlay(tmp_path, "platform: {units: [{name: core0}]}")).states_interrupt("timer")
