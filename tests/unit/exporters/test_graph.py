import re
import shutil
import subprocess
from dataclasses import replace

import pytest
from exporter_samples import hostile, many, roboracer, thirds, two_modes
from lxml import etree

from golden_file import assert_golden
from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.common.palette import FILLS
from halpipe.exporters.graph import FORMAT, GraphOptions, render_svg
from halpipe.models import Anchor, Match, Precedence
from support import after, chain, model, ms, task, version

needs_dot = pytest.mark.skipif(shutil.which("dot") is None, reason="Graphviz is not installed")
SVG = "{http://www.w3.org/2000/svg}"


def write(system, planned=None, **options):
    files = FORMAT.write(system, planned, GraphOptions(**options))
    assert list(files) == [""]
    return files[""].decode()


def fills(dot):
    return [
        re.search(r"<b>(.*?)</b>.*fillcolor=\"(.*?)\"", line).groups() for line in dot.split("\n") if "fillc" in line
    ]


def edges(dot):
    return [line.strip() for line in dot.splitlines() if "->" in line]


def test_the_graph_of_the_paper_is_the_golden_one():
    assert_golden("roboracer.dot", write(*roboracer()))


def everything():
    """A system with every kind of label: shares, gangs, many units, points, several versions and many chains."""
    units = [f"u{number}" for number in range(1, 2 * len(FILLS))]
    point = Precedence(task="a", min=ms(0), max=ms(3), anchor=Anchor.POINT, point=ms(1), to=Anchor.END)
    cycle = Precedence(task="a", min=ms("1us"), max=ms(3), anchor=Anchor.END, match=Match.CYCLE)
    pair = version("v", 2, "u2 u1", gang=2)
    return model(
        task("a", 10, version("wide", 3, " ".join(units[:5])), version("v", None, "u1 u2 u3 u4"), slack="0.25"),
        task("b", 10, replace(pair, precedences=(point,)), version("w", 1, "u1"), slack="1/3"),
        task("c", None, replace(pair, precedences=(cycle, after("b", "0.5s", 1000, "end")))),
        task("d", 10, version("v", 1, "")),
        *(task(f"t{number}", 10, version("v", 1, unit)) for number, unit in enumerate(units)),
        units=" ".join(units[::-1]),
        chains=[chain(f"c{number}", "a b c") for number in range(5)] + [chain("other", "d c")],
    )


def test_labels_of_everything_are_those_of_the_golden_file():
    assert_golden("everything.dot", write(everything()))


@pytest.mark.parametrize(("length", "shown"), [(300, 300), (301, 300)])
def test_a_failure_of_graphviz_is_said_in_few_words(monkeypatch, length, shown, capfd):
    def fail(*_, quiet, **__):
        assert quiet
        raise subprocess.CalledProcessError(3, "dot", stderr=b"x" * length)

    monkeypatch.setattr("graphviz.pipe", fail)
    with pytest.raises(HalpipeError) as caught:
        render_svg("digraph {}")
    [found] = caught.value.diagnostics
    assert found.message == "`dot` stopped with status 3: " + "x" * shown


def test_edges_carry_their_windows_and_the_versions_that_have_them():
    found = edges(write(roboracer()[0]))
    assert found[1].startswith("t1 -> t2 [label=<end +0..2ms (full)>")
    assert found[3].startswith("t2 -> t3 [label=<end +0..2ms>")


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [("0ms", "2ms", "start +0..2ms"), ("24ms", "75ms", "start +24..75ms"), ("500us", "2ms", "start +500us..2ms"),
     ("1/30s", "1/15s", "start +100/3..200/3ms"), ("500ms", "1s", "start +500ms..1s"), ("0ms", "1s", "start +0..1s")],
)  # fmt: skip
def test_windows_are_short_and_exact(low, high, text):
    system = model(task("a", 25, version()), task("b", 25, version("v", "1ms", "u1", after("a", low, high))))
    assert f"<{text}>" in write(system)


def test_chains_are_thick_and_steps_without_a_constraint_are_dashed():
    system = model(
        task("a", 25, version()),
        task("b", 25, version("v", "1ms", "u1", after("a", 0, 2))),
        task("c", 25, version()),
        chains=[chain("first", "a b c"), chain("second", "a b")],
    )
    ab, bc = edges(write(system))
    assert "penwidth" in ab
    assert ab.count("#") == 2  # one colour per chain
    assert "style=dashed" in bc
    assert "first" in bc


def test_a_chain_of_which_a_mode_runs_only_a_part_is_not_drawn_there():
    assert "penwidth" not in "".join(edges(write(two_modes()[0], mode="safe-stop")))


def test_colour_shows_the_units_allowed_or_with_a_schedule_those_used():
    system, planned = roboracer()
    assert len({colour for _, colour in fills(write(system))}) == 1
    used = fills(write(system, planned))
    assert len({colour for _, colour in used}) == len(used) == 4


def test_on_demand_tasks_look_different():
    dot = write(two_modes()[0])
    (line,) = [line for line in dot.splitlines() if "diagnostics" in line and "fillcolor" in line]
    assert "on demand" in line
    assert "dashed" in line


def test_modes_can_be_boxes_or_be_chosen():
    system, _ = two_modes()
    boxes = write(system, cluster=True)
    assert boxes.count("subgraph cluster_") == 2
    assert boxes.count("particle_filter") == 2
    one = write(system, mode="safe-stop")
    assert "opponent_detection" not in one
    assert "coarse" in one
    assert "reduced" in one
    assert "24ms" not in one  # both versions of 24 ms are not available there


@pytest.mark.parametrize("sample", [roboracer, two_modes, thirds, hostile])
def test_the_same_model_gives_the_same_bytes(sample):
    assert write(*sample(), cluster=True) == write(*sample(), cluster=True)


@needs_dot
@pytest.mark.parametrize("sample", [two_modes, hostile, lambda: many(30, 2)])
@pytest.mark.parametrize("cluster", [False, True])
def test_graphviz_draws_every_name_as_it_is(sample, cluster):
    system, planned = sample()
    root = etree.fromstring(render_svg(write(system, planned, cluster=cluster)))
    texts = {"".join(node.itertext()) for node in root.iter(f"{SVG}text")}
    drawn = {t.name for t in system.tasks if not cluster or any(t.name == r.task for m in system.modes for r in m.runs)}
    assert drawn <= texts


def test_a_missing_graphviz_is_said_with_how_to_install_it(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(HalpipeError) as caught:
        render_svg("digraph {}")
    (found,) = caught.value.diagnostics
    assert found.code == "HAL0805"
    assert "apt install graphviz" in found.help


@needs_dot
def test_a_graph_that_graphviz_refuses_is_said():
    with pytest.raises(HalpipeError) as caught:
        render_svg("digraph {")
    (found,) = caught.value.diagnostics
    assert found.code == "HAL0806"
    assert "syntax error" in found.message


def test_a_crashing_graphviz_is_said(monkeypatch):
    def crash(*_, **__):
        raise subprocess.CalledProcessError(-11, "dot", stderr=None)

    monkeypatch.setattr("graphviz.pipe", crash)
    with pytest.raises(HalpipeError) as caught:
        render_svg("digraph {}")
    assert caught.value.diagnostics[0].message == "`dot` stopped with status -11"
