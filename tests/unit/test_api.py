"""The public functions of the package: the tool from Python."""

import math
import pickle
import subprocess
import sys
from dataclasses import replace
from fractions import Fraction
from functools import partial

import pytest
from hypothesis import given

import halpipe
from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.core.durations import Duration
from halpipe.exporters.native import format_model
from halpipe.models import Binding, Resource, Task, TaskModel, Transfer, Version
from halpipe.models.attributes import LONG
from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.solve.schedule import UNBOUNDED
from profiles import examples
from strategies import task_models
from support import chain, mode, model, task, version


def small():
    return model(task("a", 10, version("v", 3)), task("b", 10, version("v", 4)))


def test_from_file_to_report(tmp_path):
    path = tmp_path / "model.xml"
    path.write_bytes(format_model(small()))
    system = halpipe.load(str(path))
    assert halpipe.validate(system) == []
    plan = halpipe.schedule(system, seed=2)
    assert halpipe.verify(system, plan) == []
    assert b"<svg" in halpipe.export("report", system, plan)[""]


def test_what_is_invalid_is_told_and_not_exported():
    system = small()
    plan = halpipe.schedule(system)
    late = replace(plan.modes[0], jobs=plan.modes[0].jobs[:1])
    wrong = replace(plan, modes=(late,))
    assert halpipe.verify(system, wrong)
    with pytest.raises(HalpipeError):
        halpipe.export("report", system, wrong)


def test_a_search_that_fails_raises_with_what_is_still_wrong():
    hard = model(task("short", 4, version("v", 1)), task("long", 12, version("v", 4)))
    with pytest.raises(HalpipeError) as failure:
        halpipe.schedule(hard, budget=20)
    assert failure.value.exit in (Exit.NOT_FOUND, Exit.INFEASIBLE)
    assert failure.value.diagnostics
    assert halpipe.explain(hard).diagnostics


def test_importing_the_package_is_cheap():
    program = "import halpipe, sys; print(sorted(m for m in ('lxml', 'numpy', 'typer') if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# ------------------------------------------------------------------------------------------------ values


def test_fields_take_what_people_write():
    made = Task(name="a", period="10ms", slack="0.5", binding="system", versions=[Version(name="v", wcet="5ms")])
    assert made.period == Duration.parse("10ms")
    assert made.slack == Fraction(1, 2)
    assert made.binding is Binding.SYSTEM
    assert made.versions == (Version(name="v", wcet=Duration.parse("5ms")),)


def test_sizes_and_bandwidths_may_be_texts_as_in_files():
    assert Resource(name="ddr", bandwidth="19.2GB/s").bandwidth == 19_200_000_000
    assert Transfer(buffer="b", symbol="s", size="64KiB").size == 65536
    assert Transfer(buffer="b", symbol="s", size=7).size == 7
    with pytest.raises(ValueError, match=r"Transfer.size: '64' is not a size"):
        Transfer(buffer="b", symbol="s", size="64")
    with pytest.raises(TypeError, match=r"Version.gang: '2' is a str; give a whole number"):
        Version(name="v", gang="2")


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("period", 5, 'Task.period: 5 is a int; give a duration such as "5ms"'),
        ("period", "5 parsecs", "Task.period: '5 parsecs' is not a duration"),
        ("slack", 0.5, "Task.slack: 0.5 is a float; give an exact number"),
        ("versions", "v", "Task.versions: 'v' is a str; give a list, of which each is a Version"),
        ("versions", [3], "Task.versions: in the list, 3 is a int; give a list, of which each is a Version"),
        ("binding", "firm", "Task.binding: 'firm' is not known; write one of job, mode, system"),
    ],
)
def test_a_wrong_type_names_its_field(field, value, said):
    with pytest.raises((TypeError, ValueError)) as failure:
        Task(**{"name": "a", field: value})
    assert str(failure.value).startswith(said)


@given(model=task_models)
@examples(60)
def test_what_repr_prints_reads_back(model):
    names = {**vars(halpipe.models), "Duration": Duration, "Fraction": Fraction}
    assert eval(repr(model), names) == model


def test_a_changed_model_is_no_longer_that_of_its_file(tmp_path):
    model = halpipe.save(small(), str(tmp_path / "model.xml"))
    assert model.digest == halpipe.load(str(tmp_path / "model.xml")).digest != ""
    changed = replace(model, name="other")
    assert changed.digest == ""
    plan = halpipe.schedule(changed)
    saved = halpipe.save(changed, str(tmp_path / "changed.xml"))
    assert halpipe.verify(saved, plan) == []


# ------------------------------------------------------------------------------------------------ functions


def test_progress_ends_a_search():
    hopeless = generate(SetParameters(tasks=48, units=2, utilisation=Fraction(1)), 1)
    with pytest.raises(HalpipeError) as failure:
        halpipe.schedule(hopeless, progress=lambda *done: False)
    assert failure.value.exit is Exit.INTERRUPTED


def endless():
    """Tasks that the search looks at for ever: they are as long as three units together, but no choice fills one."""
    lengths = (10007, 20011, 30011, 40009, 50021, 60013, 70001, 9929, 9998)
    return [task(f"t{n}", 100, version("v", f"{length}us", "w1 w2 w3")) for n, length in enumerate(lengths)]


def test_a_mode_that_was_not_come_to_is_no_schedule():
    """One mode is improved when the search is stopped, the other one is still to come."""
    rows = (("a", 8, 3), ("b", 16, 4), ("c", 8, 1), ("d", 16, 2))
    first = [task(name, period, version("v", wcet, "u1 u2")) for name, period, wcet in rows]
    chains = [chain("one", "a b c"), chain("two", "d c")]
    modes = [mode("first", first), mode("second", endless())]
    system = model(*first, *endless(), units="u1 u2 w1 w2 w3", chains=chains, modes=modes)
    asked = []
    with pytest.raises(HalpipeError):
        halpipe.schedule(system, optimise=["cost"], progress=lambda name, *_: asked.append(name) or len(asked) < 3)
    assert asked[:3] == ["first"] * 3


def test_with_a_time_limit_the_clock_alone_ends_a_search():
    allowed = set()
    with pytest.raises(HalpipeError):
        halpipe.schedule(
            model(*endless(), units="w1 w2 w3"),
            time_limit=0.2,
            progress=lambda name, made, most, best: allowed.add(most),
        )
    assert min(allowed) >= UNBOUNDED


def test_an_unknown_option_of_an_import_is_named():
    with pytest.raises(TypeError, match="did you mean"):
        halpipe.import_model("arxml", "x.arxml", granularty="event")


def test_files_may_be_paths(tmp_path):
    source = tmp_path / "graph.dot"
    source.write_text('digraph { "/a" -> "/b" [label="/t"] }')
    overlay = tmp_path / "overlay.yaml"
    overlay.write_text("halpipe-overlay: 1\nplatform: {units: [{name: u}]}\ntasks: {'*': {period: 10ms, wcet: 1ms}}\n")
    imported = halpipe.import_model("ros", source, overlay=overlay).model
    saved = halpipe.save(imported, tmp_path / "m.xml")
    assert halpipe.load(tmp_path / "m.xml") == saved
    plan = halpipe.save(halpipe.schedule(saved), tmp_path / "s.xml")
    assert halpipe.load_schedule(tmp_path / "s.xml") == plan
    trace = tmp_path / "t.btf"
    trace.write_bytes(halpipe.export("btf", saved, plan)[""])
    assert halpipe.compare(plan, trace)
    assert halpipe.learn(plan, trace)
    with pytest.raises(HalpipeError, match="HAL1001"):
        halpipe.check(tmp_path)


def test_export_takes_the_settings_of_pipeline_files(tmp_path):
    with pytest.raises(HalpipeError) as failure:
        halpipe.export("regulator", small(), halpipe.schedule(small()), backend="tabel", platform="none.yaml")
    assert any("tabel" in d.message for d in failure.value.diagnostics)


def test_tables_are_plain_rows():
    plan = halpipe.schedule(small())
    rows = halpipe.jobs(plan)
    assert [row["task"] for row in rows] == [job.task for job in plan.modes[0].jobs]
    assert rows[0]["end_ms"] - rows[0]["start_ms"] in (3, 4)
    assert {row["name"] for row in halpipe.utilisation(plan)} == {"u1"}
    assert halpipe.latencies(plan) == []


def test_numbers_of_tables_are_floats_or_exact():
    third = task("t", "100/3ms", version("v", "10/3ms", "u1"))
    system = model(third, chains=[chain("c", "t", "90ms")])
    plan = halpipe.schedule(system)
    for rows in (halpipe.jobs, halpipe.utilisation, partial(halpipe.latencies, model=system)):
        for name, exact in rows(plan, exact=True)[0].items():
            shown = rows(plan)[0][name]
            assert type(shown) is (float if type(exact) is Fraction else type(exact)), name
            assert shown == (float(exact) if type(exact) is Fraction else exact), name
    assert halpipe.jobs(plan, exact=True)[0]["end_ms"] == Fraction(10, 3)
    (load,) = plan.modes[0].unit_loads
    loads = (replace(load, share=Fraction(10**400)),)
    assert halpipe.utilisation(replace(plan, modes=(replace(plan.modes[0], unit_loads=loads),)))[0]["share"] == math.inf


def test_changes_and_limits():
    system = small()
    plan = halpipe.schedule(system)
    assert halpipe.diff(plan, plan).is_same
    assert halpipe.diff(system, replace(system, name="other"))
    assert {row.task for row in halpipe.sensitivity(system, plan)} == {"a", "b"}
    assert halpipe.size(system).found >= 1
    with pytest.raises(TypeError):
        halpipe.diff(system, plan)


def test_a_notebook_shows_a_table():
    assert halpipe.schedule(small())._repr_html_().count("<tr>") == 2


def grown():
    first = halpipe.models.TaskModel(name="car").add_task("a", period="10ms", slack=1, wcet="3ms", units="u")
    return first, first.add_task("b", period="20ms", slack=1, wcet="4ms", units=["u", "w"]).add_chain("c", "a", "b")


def test_a_model_grows_step_by_step():
    first, second = grown()
    assert [unit.name for unit in first.units] == ["u"]
    assert [unit.name for unit in second.units] == ["u", "w"]
    assert [run.task for run in second.mode("default").runs] == ["a", "b"]
    assert second.chains[0].tasks == ("a", "b")
    assert halpipe.verify(second, halpipe.schedule(second)) == []
    alone = second.add_task("d", period="20ms", wcet="1ms", units="u", modes=["other"])
    assert {mode.name: [run.task for run in mode.runs] for mode in alone.modes} == {
        "default": ["a", "b"],
        "other": ["d"],
    }
    without = second.add_task("e", period="20ms")
    assert without.task("e").versions == ()
    assert without.mode("default").runs[-1].versions == ()


def test_a_misspelt_field_or_a_change_in_place_names_the_remedy(tmp_path):
    with pytest.raises(TypeError, match="Task has no field 'priod'; write one of name, period, "):
        TaskModel(name="m").add_task("a", wcet="1ms", priod="5ms")
    with pytest.raises(TypeError, match=r"Chain has no field 'reaction'; write one of .*max_reaction"):
        TaskModel(name="m").add_chain("c", "a", reaction="5ms")
    with pytest.raises(AttributeError, match=r"dataclasses\.replace makes a changed copy"):
        TaskModel(name="m").name = "n"
    with pytest.raises(TypeError, match="save: give a model or a schedule, then the name"):
        halpipe.save("model.xml", TaskModel(name="m"))


def test_a_schedule_draws_its_jobs():
    matplotlib = pytest.importorskip("matplotlib", reason="the extra [plot]")
    matplotlib.use("agg")
    plan = halpipe.schedule(grown()[1])
    axes = plan.plot()
    drawn = sorted((box.x0, box.x1) for bars in axes.collections for box in (p.get_extents() for p in bars.get_paths()))
    jobs = [(job.start, job.end) for job in plan.modes[0].jobs]
    assert drawn == sorted(tuple(float(time.in_unit("ms")) for time in span) for span in jobs)
    assert axes.get_xlim() == (0, 20)
    with pytest.raises(KeyError, match="there are default"):
        plan.plot("zz")


def test_learning_from_a_recording_is_that_of_the_command(tmp_path):
    system = model(task("a", 10, version("v", 3)))
    planned = halpipe.schedule(system)
    file = tmp_path / "run.csv"
    starts = [10_000_000 * cycle for cycle in range(5)]
    file.write_text("task,start,end\n" + "".join(f"a,{at},{at + 4_000_000 + at // 10_000_000}\n" for at in starts))
    learned = halpipe.learn(planned, str(file), system, quantile="0.5", margin="50%")
    (found,) = learned.versions
    assert (str(found.longest), str(found.wcet)) == ("4.000004ms", "6.000003ms")  # 1.5 times the third
    assert str(learned.corrected(system).task("a").versions[0].wcet) == "6.000003ms"
    with pytest.raises(TypeError, match="has no option"):
        halpipe.learn(planned, str(file), system, quantil="0.5")


def test_a_file_name_where_a_value_is_wanted_is_refused_with_the_function_that_reads_it():
    plan = halpipe.schedule(small())
    with pytest.raises(TypeError, match=r"schedule\(\), model: a TaskModel is wanted, not 'm.xml'; halpipe.load reads"):
        halpipe.schedule("m.xml")
    with pytest.raises(TypeError, match=r"verify\(\), model: a TaskModel is wanted, not a Schedule"):
        halpipe.verify(plan, small())
    with pytest.raises(TypeError, match=r"jobs\(\), schedule: .* halpipe.load_schedule reads"):
        halpipe.jobs(schedule=small())


def test_errors_and_findings_print_as_on_the_command_line(tmp_path):
    with pytest.raises(halpipe.HalpipeError) as failure:
        halpipe.load(str(tmp_path / "none.xml"))
    shown = str(failure.value)
    assert shown.startswith(f"{tmp_path}/none.xml: error[HAL0001] ")
    assert "\n    help: " in shown
    assert repr(list(failure.value.diagnostics)) == f"[{shown}]"
    back = pickle.loads(pickle.dumps(failure.value))
    assert (back.diagnostics, back.exit) == (failure.value.diagnostics, failure.value.exit)


@pytest.mark.parametrize("count", [LONG, LONG + 1])
def test_of_equal_names_the_first_is_found_whatever_their_number(count):
    tasks = tuple(task(f"t{n % (count - 1)}", n + 1, version("v", 1)) for n in range(count))
    system = replace(model(tasks[0]), tasks=tasks)
    assert system.task("t0") is system.tasks[0]
    assert system.task(f"t{count - 2}") is system.tasks[count - 2]
    with pytest.raises(KeyError, match="there is no"):
        system.task("t")
