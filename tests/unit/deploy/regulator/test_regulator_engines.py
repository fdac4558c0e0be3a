"""The programs that play the regulator: which one is taken, what happens when it is missing or fails, what is kept."""

import os
import stat
import sys
from types import SimpleNamespace

import pytest

import regulator_bundles as bundles
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.programs import NOT_STARTED
from halpipe.deploy.regulator import codes, simulate, stimuli
from halpipe.deploy.regulator.reading import read_tables
from halpipe.deploy.regulator.simulate import Design, Icarus, Verilator, run_bench


def design(**changes):
    facts = {
        "sources": {
            "a.v": b"module bench; endmodule\n",
            "clocked.cpp": b"// clock\n",
            "clocked.v": b"module clocked; endmodule\n",
        },
        "parameters": {"UNITS": 2},
    }
    return Design(**{**facts, **changes})


@pytest.fixture
def tools(tmp_path, monkeypatch):
    """A PATH of our own: `tools("verilator", script)` installs a program."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def install(name, body):
        program = folder / name
        program.write_text(f"#!{sys.executable}\nimport sys, os, pathlib\n{body}\n")
        program.chmod(0o755)

    return install


# ------------------------------------------------------------------------------------------------ choice


def test_without_a_simulator_it_says_what_is_missing(tools):
    engine, told = simulate.choose_engine("auto")
    assert engine is None
    assert told == "no simulation: verilator: verilator, g++, make not installed; icarus: iverilog, vvp not installed"


def test_the_second_choice_says_why_not_the_first(tools):
    for name in ("iverilog", "vvp", "verilator"):
        tools(name, "")
    engine, told = simulate.choose_engine("auto")
    assert engine.name == "icarus"
    assert told == "engine icarus; verilator: g++, make not installed"


@pytest.mark.parametrize("name", ["verilator", "icarus"])
def test_an_engine_that_was_asked_for_must_be_there(tools, name):
    with pytest.raises(HalpipeError) as refused:
        simulate.choose_engine(name)
    (diagnostic,) = refused.value.diagnostics
    assert diagnostic.code == codes.NO_ENGINE.id
    assert "apt-get install" in diagnostic.help


# ------------------------------------------------------------------------------------------------ failures


def failure(action):
    with pytest.raises(HalpipeError) as refused:
        action()
    (diagnostic,) = refused.value.diagnostics
    assert diagnostic.code == codes.ENGINE_FAILED.id
    return diagnostic.message


def test_a_compiler_that_refuses_is_quoted(tools, tmp_path):
    tools("iverilog", 'sys.exit("a.v:3: error: no such wire")')
    assert (
        failure(lambda: Icarus().build(design(), str(tmp_path))) == "iverilog ended with 1: a.v:3: error: no such wire"
    )


def test_of_what_a_tool_says_its_errors_are_quoted(tools, tmp_path):
    """Three lines, 400 characters at most; without any, whatever it says first."""
    tools("iverilog", "[print('warning: nothing'), *(print(f'error {n}') for n in range(4)), sys.exit(2)]")
    assert failure(lambda: Icarus().build(design(), str(tmp_path))) == (
        "iverilog ended with 2: error 0 | error 1 | error 2"
    )
    tools("iverilog", "print('x' * 500); sys.exit(2)")
    assert failure(lambda: Icarus().build(design(), str(tmp_path))) == f"iverilog ended with 2: {'x' * 400}"


def test_a_bench_that_crashes_is_reported(tools, tmp_path):
    tools("vvp", "os.abort()")
    assert "vvp ended with -6" in failure(lambda: run_bench(("vvp",), str(tmp_path)))


def test_a_bench_that_does_not_end_is_stopped(tools, tmp_path, monkeypatch):
    monkeypatch.setattr(simulate, "RUN_SECONDS", 0.2)
    tools("vvp", "import time; time.sleep(20)")
    assert "took more than" in failure(lambda: run_bench(("vvp",), str(tmp_path)))


def test_a_program_that_is_not_there(tmp_path):
    with pytest.raises(HalpipeError) as failure:
        run_bench((str(tmp_path / "none"),), str(tmp_path))
    (found,) = failure.value.diagnostics
    assert (found.code, found.message) == (NOT_STARTED.id, "none cannot be started: No such file or directory")


# ------------------------------------------------------------------------------------------------ what is kept

VERILATE = """
if "--version" in sys.argv: print("Verilator 5"); sys.exit()
place = pathlib.Path("made"); place.mkdir()
(place / "bench").write_text("#!/bin/sh\\n"); (place / "bench").chmod(0o755)
log = pathlib.Path(os.environ["XDG_CACHE_HOME"] + ".log")
log.write_text((log.read_text() if log.exists() else "") + "x")
"""


@pytest.fixture
def builds(tools, tmp_path):
    """Build with a pretended Verilator; returns the player and how often it was called so far."""
    tools("verilator", VERILATE)
    tools("g++", 'print("g++ 12")')
    tools("make", "")
    count = iter(range(100))

    def build(what):
        folder = tmp_path / f"build{next(count)}"
        folder.mkdir()
        player = Verilator().build(what, str(folder))
        log = tmp_path / "cache.log"
        return player, len(log.read_text()) if log.exists() else 0

    return build


def test_the_same_design_is_compiled_once(builds, tmp_path):
    first, _ = builds(design())
    second, count = builds(design())
    assert (first, count) == (second, 1)
    assert str(tmp_path / "cache") in first[0]
    assert not [p for p in (tmp_path / "cache" / "halpipe" / "regulator").iterdir() if p.name.startswith("tmp")]


@pytest.mark.parametrize(
    "changes",
    [
        {"sources": {"a.v": b"module bench; wire a; endmodule\n"}},
        {"sources": {"b.v": b"module bench; endmodule\n"}},
        {"parameters": {"UNITS": 3}},
        {"sources": {"a.v": b"module bench; endmodule\n", "clocked.cpp": b"// other\n"}},
    ],
)
def test_another_design_is_compiled_again(builds, changes):
    builds(design())
    assert builds(design(**changes))[1] == 2


def test_another_compiler_compiles_again(builds, tools):
    builds(design())
    tools("g++", 'print("g++ 13")')
    assert builds(design())[1] == 2


@pytest.mark.parametrize("mode", [0o722, 0o755 | 0o020])
def test_what_others_could_have_put_into_the_cache_is_not_run(builds, mode):
    player, _ = builds(design())
    os.chmod(player[0], mode)
    assert builds(design())[1] == 2


def test_a_cache_that_others_may_write_is_not_used(builds, tmp_path):
    folder = tmp_path / "cache" / "halpipe" / "regulator"
    folder.mkdir(parents=True)
    folder.chmod(0o777)
    player, _ = builds(design())
    assert str(folder) not in player[0]
    assert list(folder.iterdir()) == []


def test_without_a_cache_it_is_compiled_each_time(builds, tmp_path):
    (tmp_path / "cache").write_text("in the way")
    builds(design())
    assert builds(design())[1] == 2


def test_what_is_kept_is_for_its_user_only(builds):
    player, _ = builds(design())
    assert stat.S_IMODE(os.stat(player[0]).st_mode) == 0o700


# ------------------------------------------------------------------------------------------------ runs


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return bundles.target(bundles.export(tmp_path_factory.mktemp("runs"), *bundles.system(), window="64")).bundle


def runs(monkeypatch, bundle, cycles, *, shares=(6400, 1280), stepped=4000):
    """The tables and the run of each simulation of an engine that has so many cycles for each unit."""
    tables = read_tables(bundle)
    units = len(tables.units)
    monkeypatch.setattr(simulate, "CYCLES", {"e": tuple(share * units for share in shares)})
    monkeypatch.setattr(simulate, "STEPPED_CYCLES", {"e": stepped})
    monkeypatch.setattr(simulate, "play", lambda loaded, tables, player, run: loaded)
    monkeypatch.setattr(simulate, "judge", lambda tables, run, loaded, _: (tables, run, loaded))
    engine = SimpleNamespace(name="e", build=lambda design, folder: [])
    return tables, [*simulate.simulate(bundle, tables, engine, seed=3, cycles=cycles)]


def test_runs_take_the_cycles_of_their_engine(monkeypatch, bundle):
    """Every table is stepped through, the greedy run has all windows of the tables, random traffic has excerpts."""
    tables, found = runs(monkeypatch, bundle, 0)
    assert [run.traffic for _, run, _ in found] == [stimuli.STEPPED, *stimuli.TRAFFIC]
    windows = [4000 // 4, 6400 // 64, *[1280 // 64] * (len(found) - 2)]
    for (played, run, loaded), most in zip(found, windows, strict=True):
        is_excerpt = run.traffic not in (stimuli.STEPPED, stimuli.TRAFFIC[0])
        assert played == (stimuli.excerpt(tables, most) if is_excerpt else tables)
        assert (loaded is bundle) == (played is tables)
        assert run == stimuli.plan(played, run.traffic, 3, windows=most)
        assert len(run.expected) <= most


def test_runs_are_of_four_windows_at_least(monkeypatch, bundle):
    _, found = runs(monkeypatch, bundle, 0, shares=(64, 64), stepped=4)
    assert {len(run.expected) for _, run, _ in found} == {4}


def test_with_cycles_every_mode_is_played_as_often_and_every_switch_is_made(monkeypatch, bundle):
    tables, (stepped, *found) = runs(monkeypatch, bundle, 3)
    assert len(stepped[1].expected) <= 1000
    for played, run, loaded in found:
        assert played is tables
        assert loaded is bundle
        assert run == stimuli.plan(tables, run.traffic, 3, windows=2**31, repeats=3)


def test_the_bench_gets_what_the_run_is_made_of(bundle):
    """Data of writes waits in 3 of 4 cycles of a run that owes; the latency leaves each unit two bursts of a window."""
    tables = read_tables(bundle)
    platform, units = tables.platform, len(tables.units)
    beats = platform.burst_bytes // platform.bus_bytes
    for traffic in (stimuli.STEPPED, *stimuli.TRAFFIC):
        run = stimuli.plan(tables, traffic, 2**32 + 7, windows=100)
        stated = dict(word[1:].split("=") for word in simulate._arguments(tables, run))
        assert stated == {
            "cycles": str(run.cycles),
            "extra": "0",
            "of": "1",
            "windows": str(len(run.expected)),
            "seed": "7",
            "hold": str(len(run.expected) * run.cycles * 3 // 4 if traffic.is_owing else 0),
            "latency": str(max(0, min(traffic.latency, run.cycles - 2 * units * beats))),
            "depth": str(traffic.depth),
            "longest": "1" if traffic.is_owing else str(beats),
            "kinds": "".join(f"{kind:02x}" for kind in reversed(run.kinds)),
        }
