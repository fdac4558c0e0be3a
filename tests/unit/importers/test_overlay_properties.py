"""What holds for any overlay: the order of entries, repetition, independence of files, and its cost on large models."""

from fnmatch import fnmatchcase

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from overlay_case import apply, overlay, refusal

from growth import growth, half_way
from halpipe.core.diagnostics import Location
from halpipe.core.settings import Stated
from halpipe.importers.overlay.entries import Overlay, TaskEntry, VersionEntry, merge
from profiles import examples
from support import after, model, ms, task, version

NAMES = ("/a", "/ab", "/abc", "/b", "/ba")
PATTERNS = (*NAMES, "*", "/a*", "/?b", "*b*", "/[ab]", "**")

uses_tmp_path = examples(60, HealthCheck.function_scoped_fixture)


def entries(stated):
    return tuple(
        TaskEntry(pattern=p, at=Location("o", n), common=VersionEntry(stated={"wcet": Stated(ms(w), Location("o", n))}))
        for n, (p, w) in enumerate(stated, 1)
    )


def expected_wcet(name, stated, source):
    """The rule as the manual states it: exact name, then the last glob, then the source, then the last ``*``."""
    exact = [w for p, w in stated if p == name]
    globs = [w for p, w in stated if p not in (name, "*") and fnmatchcase(name, p)]
    rest = [w for p, w in stated if p == "*"]
    return (exact or globs or ([source] if source else []) or rest or [None])[-1]


@given(
    stated=st.lists(st.tuples(st.sampled_from(PATTERNS), st.integers(1, 9)), max_size=8),
    sources=st.tuples(*(st.sampled_from([None, 11, 12]) for _ in NAMES)),
)
def test_the_order_rule(stated, sources):
    tasks = (task(n, 100, version("default", w)) for n, w in zip(NAMES, sources, strict=True))
    result, _, _ = apply(Overlay(tasks=entries(stated)), model(*tasks))
    found = [t.versions[0].wcet for t in result.tasks]
    assert found == [ms(expected_wcet(n, stated, w)) for n, w in zip(NAMES, sources, strict=True)]


@given(
    first=st.lists(st.tuples(st.sampled_from(PATTERNS), st.integers(1, 9)), max_size=4),
    second=st.lists(st.tuples(st.sampled_from(PATTERNS), st.integers(1, 9)), max_size=4),
)
def test_two_files_are_one_file_with_the_entries_of_the_second_behind(first, second):
    tasks = [task(n, 100, version("default", None)) for n in NAMES]
    joined, _, _ = apply(Overlay(tasks=entries([*first, *second])), model(*tasks))
    apart, _, _ = apply(merge([Overlay(tasks=entries(first)), Overlay(tasks=entries(second))]), model(*tasks))
    assert joined == apart


FRAGMENTS = {
    "platform": "platform: {units: [{name: u0}, {name: u1}], resources: [{name: ddr}]}",
    "precedence": "precedence: [{from: /planning, to: /control, max: 3ms}, {from: /control, to: /debug/view, max: 1s}]",
    "modes": 'modes: {a: {tasks: "*"}, b: {tasks: [/control], versions: {"/c*": [default]}}}',
    "chains": "chains: [{name: drive, tasks: [/planning, /control]}]",
}
ENTRIES = (
    '"*": {wcet: 1ms, slack: 0.5}',
    '"*/*": {versions: {v: {wcet: 2ms}, w: {}}}',
    "/planning: {period: 20ms, versions: {x: {wcet: 1ms, precedence: []}, y: {wcet: 4ms}}}",
    '"/c*": {offset: 1ms, wcet: 3ms}',
    "/sensing/lidar: {deadline: 9ms, precedence: [{from: /planning, max: 1ms}]}",
    "/control: {versions: {default: {wcet: 5ms}, z: {wcet: 6ms}}}",
)


@uses_tmp_path
@given(
    sections=st.sets(st.sampled_from(sorted(FRAGMENTS))),
    chosen=st.sets(st.sampled_from(ENTRIES)),
    later=st.booleans(),
)
def test_applying_twice_is_applying_once(tmp_path, sections, chosen, later):
    texts = [FRAGMENTS[name] for name in sorted(sections)]
    listed = "tasks: {" + ", ".join(sorted(chosen)) + "}"
    files = ["\n".join(texts), listed] if later else ["\n".join([*texts, listed])]
    use = overlay(tmp_path, *files)
    once, diagnostics, _ = apply(use)
    twice, again, coverage = apply(use, once)
    assert [d for d in diagnostics if d.is_error] == []
    assert twice == once
    assert (again, coverage.defaulted_values) == ((), [])


@uses_tmp_path
@given(text=st.text(alphabet='{}[]:,-*"ab \n/1ms', max_size=60))
def test_no_text_is_a_traceback(tmp_path, text):
    path = tmp_path / "o.yaml"
    path.write_text("halpipe-overlay: 1\ntasks:\n  a: {" + text + "}\n")
    for diagnostic in refusal(path):
        assert diagnostic.at.file == str(path)
    path.write_text("halpipe-overlay: 1\n" + text)
    for diagnostic in refusal(path):
        assert diagnostic.at.file == str(path)


@pytest.mark.slow
def test_the_time_of_fifty_globs_grows_with_the_tasks_and_not_with_their_square(tmp_path):
    def prepare(count):
        tasks = [
            task(f"/area{i % 97}/node{i}", 100, version("default", None, "core0", after("/area0/node0", 0, 100)))
            for i in range(count)
        ]
        globs = "".join(f'  "/area{i}/*{i % 10}": {{wcet: {i + 1}us, slack: 0.1}}\n' for i in range(50))
        exact = "".join(f"  /area{i % 97}/node{i}: {{wcet: 5us}}\n" for i in range(0, count, 4))
        wrong = "".join(f"  /area{i}/nodee{i}x: {{wcet: 1us}}\n" for i in range(50))
        folder = tmp_path / str(count)
        folder.mkdir()
        given_ = overlay(folder, f'tasks:\n{globs}{exact}{wrong}  "*": {{wcet: 9us}}\n')
        source = model(*tasks, units="core0")

        def work():
            result, diagnostics, _ = apply(given_, source)
            assert len([d for d in diagnostics if d.is_error]) == 50
            assert all(t.versions[0].wcet is not None for t in result.tasks)

        return work

    assert growth(prepare, 500, 10_000) < half_way(20)
