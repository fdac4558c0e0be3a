"""The ament package: it compiles against stand-ins of Humble, Jazzy and Rolling, and refuses what it cannot bind."""

import random
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from ctf_writer import ros_trace
from halpipe import api
from halpipe.core.bundles import seal
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.core.files import write_directory
from halpipe.exporters.linux.codes import BAD_TEXT
from halpipe.exporters.ros import FORMAT, RosOptions, codes
from halpipe.importers.ros.traced import callbacks_of
from halpipe.models import Chain, HealthAction, HealthEvent, HealthRule, Part, Resource, Split
from halpipe.models.trace import BoundCallback
from support import access, job, model, ms, schedule, task, version

STUBS = Path(__file__).with_name("ros_stubs")
GRAPH = Path(__file__).parents[2] / "examples" / "roboracer" / "graph" / "architecture.yaml"
HUMBLE, JAZZY, ROLLING = 16, 28, 29
BINDINGS = {
    "/source": BoundCallback(node="/source", kind="timer", period=10_000_000),
    "/sink": BoundCallback(node="/sink", kind="subscription", topic="/a"),
}
needs_compiler = pytest.mark.skipif(not shutil.which("g++"), reason="the declarations are checked by g++")


def system():
    tasks = [task(name, 10, version("v", "1ms", "u1")) for name in BINDINGS]
    owner = model(*tasks, units="u1", name="Demo 1".replace(" ", "-"))
    return owner, schedule(owner, 10, job(owner, "/source", 0, 0, "u1"), job(owner, "/sink", 0, 2, "u1"))


def package(bindings=None, owner=None, tables=None, **chosen):
    if owner is None:
        owner, tables = system()
    options = RosOptions(package=True, bindings=BINDINGS if bindings is None else bindings, cpus={"u1": 0}, **chosen)
    return {name: content.decode() for name, content in FORMAT.write(owner, tables, options).items()}


def with_modes(*names):
    """The system with its mode several times, by other names."""
    owner, tables = system()
    [mode], [table] = owner.modes, tables.modes
    owner = replace(owner, modes=tuple(replace(mode, name=name) for name in names))
    return owner, replace(tables, modes=tuple(replace(table, name=name) for name in names))


def refusal(**options):
    with pytest.raises(HalpipeError) as caught:
        package(**options)
    return {d.code for d in caught.value.diagnostics}


def write_all(folder, files):
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content)


def compiled(folder, files, distribution):
    """Check the syntax and types of the container; return what the compiler says."""
    write_all(folder, files)
    command = ["g++", "-std=c++17", "-fsyntax-only", "-Wall", "-Wextra", "-Werror", f"-DSTUB_RCLCPP={distribution}"]
    command += [
        "-DPRIORITY=80",
        f"-I{STUBS}",
        f"-I{folder}/src",
        f"-I{folder}/runtime",
        str(folder / "src/container.cpp"),
    ]
    return subprocess.run(command, capture_output=True, text=True, check=False).stderr


@pytest.fixture(scope="module")
def examples():
    """The packages of every ROS graph that the project ships, by name."""
    imported = api.import_model("ros", str(GRAPH), overlay=[str(GRAPH.parents[1] / "overlay.yaml")], name="roboracer")
    tables = api.schedule(imported.model, seed=1)
    cpus = dict(zip(("core1", "core2", "core3", "core4"), range(4), strict=True))
    chosen = {"": {}, "race": {"mode": "race"}, "limp": {"missing": {"/local_planner": "safe-stop"}}}
    return {
        name: api.export("ros", imported.model, tables, package=True, graph=[str(GRAPH)], cpus=cpus, **options)
        for name, options in chosen.items()
    }


def built_with_cmake(folder, files, distribution):
    """Build a package as colcon does, with stand-ins for the packages that it finds; return what cmake says."""
    write_directory(str(folder / "package"), files)
    ament = "function(ament_package)\nendfunction()\n"
    if distribution == HUMBLE:
        ament += f"function(ament_target_dependencies target)\n{_include('${target}', 'PRIVATE')}endfunction()\n"
    else:
        for target in ("rclcpp::rclcpp", "rclcpp_components::component_manager"):
            ament += f"add_library({target} INTERFACE IMPORTED)\n{_include(target, 'INTERFACE')}"
    for name in ("ament_cmake", "rclcpp", "rclcpp_components", "std_srvs", "diagnostic_msgs"):
        (folder / f"{name}Config.cmake").write_text(ament if name == "ament_cmake" else "")
    flags = f"-O0 -Wall -Wextra -Werror -DSTUB_RCLCPP={distribution}"
    stated = [f"-DCMAKE_PREFIX_PATH={folder}", *(f"-D{name}_DIR={folder}" for name in ("ament_cmake", "rclcpp"))]
    stated += [f"-D{name}_DIR={folder}" for name in ("rclcpp_components", "std_srvs", "diagnostic_msgs")]
    said = ""
    for command in (
        ["cmake", "-S", str(folder / "package"), "-B", str(folder / "b"), f"-DCMAKE_CXX_FLAGS={flags}", *stated],
        ["cmake", "--build", str(folder / "b")],
    ):
        ran = subprocess.run(command, capture_output=True, text=True, check=False)
        assert ran.returncode == 0, ran.stdout + ran.stderr
        said += ran.stderr
    assert (folder / "b" / "table_container").exists()
    return said


def _include(target, kind):
    return f"target_include_directories({target} {kind} {STUBS})\n"


@needs_compiler
@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("cmake"), reason="packages are built with cmake")
@pytest.mark.parametrize("distribution", [HUMBLE, ROLLING])
def test_the_package_of_an_example_is_built_by_its_own_cmake_files(tmp_path, examples, distribution):
    """Of Rolling, ament has no ament_target_dependencies any more (ament/ament_cmake, pull request 583)."""
    assert built_with_cmake(tmp_path, examples[""], distribution) == ""


@pytest.mark.slow
@needs_compiler
def test_the_packages_of_the_examples_compile(tmp_path, examples):
    """Their containers are one file; rows and tables differ."""
    command = ["cc", "-std=gnu11", "-fsyntax-only", "-Wall", "-Wextra", "-Werror", "-DPRIORITY=1"]
    for name, contents in examples.items():
        files = {place: content.decode() for place, content in contents.items()}
        said = compiled(tmp_path / name, files, JAZZY) if name != "race" else write_all(tmp_path / name, files)
        own = ["-Iruntime", "runtime/dispatch.c", "runtime/record.c", "tables.c"]
        plain = subprocess.run([*command, *own], cwd=tmp_path / name, capture_output=True, text=True, check=False)
        assert (said or "", plain.stderr) == ("", "")


@pytest.mark.slow
@needs_compiler
@pytest.mark.parametrize(("distribution", "condition"), [(HUMBLE, "1"), (JAZZY, "0")])
def test_the_timer_of_the_other_distribution_does_not_compile(tmp_path, distribution, condition):
    files = package()
    files["src/table_executor.hpp"] = files["src/table_executor.hpp"].replace("RCLCPP_VERSION_GTE(28, 0, 0)", condition)
    assert "execute_timer" in compiled(tmp_path, files, distribution)


def any_package(seed):
    """Tasks with any number of jobs, callbacks and waits, in a model whose name has every kind of character."""
    dice = random.Random(seed)
    names = [f"/{dice.choice(['a', 'b:c', 'x' * 200, 'd%s', 'e$f'])}{number}" for number in range(dice.randint(1, 9))]
    owner = model(*(task(name, 10, version("v", "1ms", "u1")) for name in names), units="u1")
    jobs = [job(owner, name, k, 10 * k + dice.randint(0, 9), "u1") for name in names for k in range(dice.randint(1, 5))]
    bindings = {}
    for number, name in enumerate(names):
        node, order = f"/{dice.choice(['a', 'a/b_c', 'x' * 200])}{number}", dice.randint(0, 3)
        timer = BoundCallback(node=node, kind="timer", period=dice.randint(1, 10**12), order=order)
        bindings[name] = dice.choice(
            [timer, BoundCallback(node=node, kind="subscription", topic=f"{node}/_1", order=order)]
        )
    waiting = {name: ms("0.5ms") for name in names if bindings[name].topic and dice.randint(0, 1)}
    owner = replace(owner, name=dice.choice(["a$b", "a%b", "a/b:c", "2wd", "a.b~c@d"]))
    return package(
        bindings, owner, schedule(owner, 50, *jobs), wait=waiting, messages=dice.choice(["oldest", "newest"])
    )


@pytest.mark.slow
@needs_compiler
def test_the_rows_and_tables_of_random_packages_compile(tmp_path):
    """The rows of all stand in one file, each in a namespace of its own, since the executor is the same."""
    packages = [any_package(seed) for seed in range(20)]
    begin = '#include "table_executor.hpp"\n'
    rows = [files["src/bindings.hpp"].partition(begin)[2] for files in packages]
    spaces = [f"namespace p{i} {{using table::Row;\n{text}}}\n" for i, text in enumerate(rows)]
    used = "".join(f" + p{i}::table::n_rows + sizeof p{i}::table::rows[0]" for i in range(len(rows)))
    used += "".join(f" + p{i}::table::mode_names.size() + p{i}::table::takes_newest" for i in range(len(rows)))
    text = f"#include <array>\n#include <string>\n{begin}{''.join(spaces)}int main() {{return (0{used}) > 0;}}\n"
    stated = {"src/container.cpp": text, "src/table_executor.hpp": packages[0]["src/table_executor.hpp"]}
    assert compiled(tmp_path, stated, HUMBLE) == ""
    for i, files in enumerate(packages):
        (tmp_path / f"tables{i}.c").write_text(files["tables.c"])
    (tmp_path / "dispatch.h").write_text(packages[0]["runtime/dispatch.h"])
    command = ["cc", "-std=c11", "-fsyntax-only", "-Wall", "-Wextra", "-Werror", *sorted(tmp_path.glob("*.c"))]
    assert subprocess.run(command, capture_output=True, text=True, check=False).stderr == ""


def test_each_program_is_bound_to_one_callback():
    files = package()
    assert '{"/source", "/source", "timer", "", 10000000, 0, 0, -1},' in files["src/bindings.hpp"]
    assert '{"/sink", "/sink", "subscription", "/a", 0, 0, 0, -1},' in files["src/bindings.hpp"]
    assert ".run" not in files["tables.c"]
    stated = yaml.safe_load(files["config/components.yaml"])
    assert [one["node"] for one in stated["components"]] == ["/sink", "/source"]
    assert "<name>demo_1</name>" in files["package.xml"]
    compile(files["launch/tables.launch.py"], "tables.launch.py", "exec")
    assert "a lane of its own" in files["README.md"]
    assert "takes_newest = true" in files["src/bindings.hpp"]
    assert seal("ros-package", {"a": b""}, {})


def test_the_launch_file_takes_nodes_parameters_and_remappings(tmp_path, monkeypatch):
    """Stand-ins for launch_ros/actions/composable_node_container.py and descriptions/composable_node.py."""
    stated = {
        "background_cpus": "0,1",
        "container": {"record": "run.csv"},
        "components": [
            {
                "node": "/ns/in/planner",
                "package": "p",
                "plugin": "p::Planner",
                "parameters": {"rate": 10},
                "parameter_files": ["car.yaml"],
                "remappings": {"/a": "/b"},
                "intra_process": True,
            },
            {"node": "/sink", "package": "q", "plugin": "q::Sink"},
        ],
    }
    (tmp_path / "config").mkdir()
    (tmp_path / "config" / "components.yaml").write_text(yaml.safe_dump(stated))
    stand_ins = {
        "ament_index_python.packages": {"get_package_share_directory": lambda package: str(tmp_path)},
        "launch": {"LaunchDescription": list},
        "launch_ros.actions": {"ComposableNodeContainer": dict},
        "launch_ros.descriptions": {"ComposableNode": dict},
    }
    for name, members in stand_ins.items():
        monkeypatch.setitem(sys.modules, name, SimpleNamespace(**members))
    space = {}
    exec(package()["launch/tables.launch.py"], space)
    [container] = space["generate_launch_description"]()
    assert (container["executable"], container["parameters"]) == ("table_container", [{"record": "run.csv"}])
    assert container["arguments"] == ["--background-cpus", "0,1"]
    planner, sink = container["composable_node_descriptions"]
    assert (planner["namespace"], planner["name"], planner["plugin"]) == ("/ns/in", "planner", "p::Planner")
    assert (planner["parameters"], planner["remappings"]) == (["car.yaml", {"rate": 10}], [("/a", "/b")])
    assert [one["extra_arguments"][0]["use_intra_process_comms"] for one in (planner, sink)] == [True, False]
    assert (sink["namespace"], sink["name"], sink["parameters"], sink["remappings"]) == ("/", "sink", [{}], [])
    stated["container"]["use_sim_time"] = True
    (tmp_path / "config" / "components.yaml").write_text(yaml.safe_dump(stated))
    [container] = space["generate_launch_description"]()
    assert container["composable_node_descriptions"][1]["parameters"] == [{"use_sim_time": True}, {}]


THREADS = """\
hardware_info: {model: 85}
callback_groups:
  - id: /a@Timer(7)@Waitable@Waitable
    affinity: [0, 2]
    policy: SCHED_FIFO
    priority: 5
  - {id: "/b@Service(/x)", domain_id: 3, affinity: ~, policy: SCHED_OTHER, priority: 0}
  - {id: /c, policy: SCHED_DEADLINE, runtime: 2000, deadline: 3000, period: 4000, affinity: ~}
non_ros_threads:
  - {name: /task, policy: SCHED_FIFO, priority: 9}
"""
PLACED = [
    "t.yaml:3 SCHED_FIFO 5 - - - 0,2 /a@Timer(7)",
    "t.yaml:8 SCHED_DEADLINE - 2000 3000 4000 - /c",
    "t.yaml:10 SCHED_FIFO 9 - - - - /task",
]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (THREADS, PLACED),
        (THREADS.replace("priority: 5", "prio: 5"), "t.yaml:6: unknown key, or one that is there twice: prio"),
        (THREADS.replace("priority: 5", "policy: 5"), "t.yaml:6: unknown key, or one that is there twice: policy"),
        (THREADS.replace("name: /task, ", ""), "t.yaml:10: an entry has an id and a policy"),
        (THREADS.replace("non_ros", "no_ros"), "t.yaml:9: there is no section no_ros_threads"),
        ("callback_groups: [x]\n", "t.yaml:1: expected keys and values"),
        ("callback_groups: {a: b}\n", "t.yaml:1: expected a list"),
        ("callback_groups: ~\n", []),
        ("", []),
        (THREADS.replace("id: /c,", 'id: "/c: d",'), "t.yaml:8: expected a number or a word"),
    ],
)
def test_the_launch_file_reads_the_file_of_the_callback_isolated_executor(tmp_path, monkeypatch, capsys, text, found):
    """Form of cie_thread_configurator/README.md (tier4/callback_isolated_executor), whose IDs may end in @Waitable."""
    for name in ("ament_index_python.packages", "launch", "launch_ros.actions", "launch_ros.descriptions"):
        stand_in = SimpleNamespace(
            get_package_share_directory=0, LaunchDescription=0, ComposableNodeContainer=0, ComposableNode=0
        )
        monkeypatch.setitem(sys.modules, name, stand_in)
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    (tmp_path / "t.yaml").write_text(text)
    space = {}
    exec(package()["launch/tables.launch.py"], space)
    if isinstance(found, str):
        with pytest.raises(ValueError, match="^" + found + "$"):
            space["read_threads"](str(tmp_path / "t.yaml"))
    else:
        lines = space["read_threads"](str(tmp_path / "t.yaml"))
        assert lines == found
        assert [yaml.safe_load(line) for line in lines] == found  # evaluate_parameter_dict of launch_ros does so
        assert ("t.yaml:1: hardware_info is not used" in capsys.readouterr().err) == ("hardware_info" in text)


def test_tasks_without_a_callback_are_named():
    assert refusal(bindings={"/source": BINDINGS["/source"]}) == {codes.UNBOUND.id}


@pytest.mark.parametrize("name", ['/si"nk', "sink", "//sink", "/sink/", "/2sink", "/a-b", "/" + "x" * 250])
def test_names_that_are_none_of_ros_are_refused(name):
    """The container would wait for their callbacks for ever."""
    for wrong in (
        BoundCallback(node=name, kind="timer", period=1),
        BoundCallback(node="/sink", kind="subscription", topic=name),
    ):
        assert refusal(bindings={**BINDINGS, "/sink": wrong}) == {BAD_TEXT.id}


@pytest.mark.parametrize(
    ("names", "fits"),
    [(("a-b", "c"), True), (("2wd",), False), (("_x",), False), (("a-b", "a_b"), False), (("a-b", "a-c"), True)],
)
def test_modes_have_services_of_their_own_or_are_refused(names, fits):
    owner, tables = with_modes(*names)
    if fits:
        assert package(owner=owner, tables=tables)["src/bindings.hpp"].count("a_b") == ("a-b" in names)
    else:
        assert refusal(owner=owner, tables=tables) == {BAD_TEXT.id}


@pytest.mark.parametrize("limit", ["max_age", "max_reaction", "max_latency", None])
@pytest.mark.parametrize("messages", ["oldest", "newest"])
def test_chains_with_limits_do_not_read_the_oldest_message(limit, messages):
    owner, tables = system()
    limits = {limit: ms(30)} if limit else {}
    owner = replace(owner, chains=(Chain(name="c", tasks=("/source", "/sink"), **limits),))
    if limit and messages == "oldest":
        assert refusal(owner=owner, tables=tables, messages=messages) == {codes.OLD_MESSAGES.id}
    else:
        assert package(owner=owner, tables=tables, messages=messages)


@pytest.mark.parametrize(
    ("groups", "period", "fits"),
    [(("a", "a"), 10, True), (("a", "b"), 10, False), (("a", "b"), 20, True), (("", "b"), 10, True)],
)
def test_equal_timers_of_different_groups_are_refused(groups, period, fits):
    """Where the group of one is not known, the container decides when it runs."""
    same = [
        BoundCallback(node="/pair", kind="timer", period=p * 1_000_000, group=g)
        for p, g in zip((10, period), groups, strict=True)
    ]
    bindings = dict(zip(("/source", "/sink"), same, strict=True))
    if fits:
        assert package(bindings=bindings)
    else:
        assert refusal(bindings=bindings) == {codes.EQUAL_CALLBACKS.id}


@pytest.mark.parametrize(
    ("node", "period", "fits"),
    [
        ("/source", 10_010_000, False),  # the container takes it for the row's, if it was constructed first
        ("/source", 9_990_000, False),
        ("/source", 10_010_001, True),
        ("/source", 10_000_000, True),  # equal: the graph counts both
        ("/other", 10_010_000, True),
    ],
)
def test_a_timer_without_a_row_that_is_nearly_equal_to_one_is_refused(node, period, fits):
    bindings = {**BINDINGS, "/spare": BoundCallback(node=node, kind="timer", period=period)}
    if fits:
        assert package(bindings=bindings)
    else:
        assert refusal(bindings=bindings) == {codes.EQUAL_CALLBACKS.id}


@pytest.mark.parametrize(
    ("chosen", "row"),
    [
        ({"wait": {"/sink": ms("0.5ms")}}, "500000, -1}"),
        ({"missing": {"/sink": "one"}}, "0, 1}"),
        ({"wait": {"/sink": ms(1)}}, ""),  # the whole WCET: there is no time left to run
        ({"wait": {"/source": ms("0.5ms")}}, ""),
        ({"missing": {"/source": "one"}}, ""),
        ({"missing": {"/sink": "none"}}, ""),
        ({"wait": {"/sinc": ms("0.5ms")}}, ""),
    ],
)
def test_a_job_may_wait_for_its_message_within_its_wcet(chosen, row):
    owner, tables = with_modes("m", "one")
    if row:
        files = package(owner=owner, tables=tables, **chosen)
        assert f'"subscription", "/a", 0, 0, {row}' in files["src/bindings.hpp"]
    else:
        assert refusal(owner=owner, tables=tables, **chosen) == {codes.NO_EVENT.id}


@pytest.mark.parametrize(
    ("wait", "longest", "fits"), [("0.4ms", 600_000, True), ("0.4ms", 600_001, False), ("0.9ms", 0, True)]
)
def test_a_wait_leaves_the_measured_time_of_the_callback(wait, longest, fits):
    owner, tables = system()
    bindings = {**BINDINGS, "/sink": replace(BINDINGS["/sink"], longest=longest)}
    options = RosOptions(package=True, bindings=bindings, cpus={"u1": 0}, wait={"/sink": ms(wait)})
    found = [d for d in FORMAT.remarks(owner, tables, options, {}) if d.code == codes.NO_TIME_LEFT.id]
    assert [d.path for d in found] == ([] if fits else ['task "/sink"'])
    assert all(f"make the WCET {ms(wait) + Duration(longest)} or longer" in d.help for d in found)
    left = f"a job took {Duration(longest)}, and {ms(1) - ms(wait)} of the WCET of 1ms is left after the wait"
    assert all(d.message == left for d in found)


def left_open(owner, tables):
    options = RosOptions(package=True, bindings=BINDINGS, cpus={"u1": 0})
    found = [d.message for d in FORMAT.remarks(owner, tables, options, {})]
    stated = package(owner=owner, tables=tables)
    assert all(text in stated["README.md"] for text in found)
    return found


def test_a_package_names_the_rules_that_it_does_not_follow():
    """It goes to another mode after one overrun or exception; it neither counts nor restarts."""
    owner, tables = with_modes("m", "n")
    assert left_open(owner, tables) == []
    followed = HealthRule(task="/sink", event=HealthEvent.FAULT, action=HealthAction.SWITCH, mode="n")
    others = [replace(followed, task="/source", count=2), replace(followed, action=HealthAction.STOP, mode="")]
    assert left_open(replace(owner, health=(followed,)), tables) == []
    for rule in others:
        (said,) = left_open(replace(owner, health=(followed, rule)), tables)
        assert said.endswith(f'but for switches after one overrun or exception: "{rule.task}"')


def test_a_package_says_that_bounds_and_versions_are_not_its_own():
    """Of one task the phases, of another the second version."""
    owner, tables = system()
    source, sink = owner.tasks
    phased = replace(sink, versions=(replace(sink.versions[0], accesses=(access("m", 0, "1ms"),)),))
    owner = replace(owner, tasks=(source, phased), resources=(Resource(name="m"),))
    (said,) = left_open(owner, tables)
    assert said.startswith("bounds of access phases are not enforced")
    two = replace(source, versions=(*source.versions, replace(source.versions[0], name="w")))
    owner = replace(owner, tasks=(two, sink))
    assert left_open(owner, tables) == []  # the other version has no job
    [table] = tables.modes
    more = replace(table.jobs[0], version="w", start=ms(5), end=ms(6), index=1)
    tables = replace(tables, modes=(replace(table, jobs=(*table.jobs, more)),))
    assert left_open(owner, tables) == ["all versions of a task are its one callback"]


@pytest.mark.parametrize(
    ("name", "expected"), [("Demo-1", "demo_1"), ("2wd.car", "p_2wd_car"), ("--", "tables"), ("_x_", "x")]
)
def test_a_package_has_a_name_that_ros_takes(name, expected):
    """REP 144: letters, digits and _ from a letter on."""
    owner, tables = system()
    owner = replace(owner, name=name)
    assert f"<name>{expected}</name>" in package(owner=owner, tables=replace(tables, model=name))["package.xml"]


def test_equal_services_name_the_mode_that_has_it():
    owner, tables = with_modes("a-b", "c", "a_b")
    with pytest.raises(HalpipeError) as caught:
        package(owner=owner, tables=tables)
    (found,) = caught.value.diagnostics
    assert (found.path, found.message) == ('mode "a_b"', '"~/mode/a_b" is the service of mode "a-b" already')


def gapped(split):
    """The system with a job of two parts in place of the first one in one piece."""
    owner, tables = system()
    tasks = tuple(replace(t, versions=tuple(replace(v, split=split) for v in t.versions)) for t in owner.tasks)
    [table] = tables.modes
    first, *others = table.jobs
    half, pause = ms("0.5ms"), ms("0.1ms")
    parts = (
        Part(start=first.start, end=first.start + half, executed_from=ms(0), executed_to=half),
        Part(start=first.start + half + pause, end=first.end + pause, executed_from=half, executed_to=half + half),
    )
    apart = replace(first, parts=parts, end=parts[1].end)
    return replace(owner, tasks=tasks), replace(tables, modes=(replace(table, jobs=(apart, *others)),))


def test_a_callback_is_not_held_at_split_points():
    owner, tables = gapped(Split(points=(ms("0.5ms"),)))
    assert refusal(owner=owner, tables=tables) == {codes.SPLIT_CALLBACK.id}
    _, whole = system()
    assert "tables.c" in package(owner=owner, tables=whole)  # no job has a gap, so none must be held


def test_a_callback_may_be_interrupted_anywhere():
    owner, tables = gapped(Split(anywhere=True, max_gaps=1))
    files = package(owner=owner, tables=tables)
    assert "{{0, 0, 1}, }" in files["tables.c"].replace("[] = { {", "{{")


def test_a_trace_says_which_callbacks_the_tasks_are(tmp_path):
    found = callbacks_of([str(ros_trace(3).write(tmp_path))])
    assert found == {
        "/source": BoundCallback("/source", "timer", "", 10_000_000, 0, longest=1_002_000),
        "/sink/callback_0": BoundCallback("/sink", "timer", "", 20_000_000, 0, "/sink/callback_group_0", 3_000_000),
        "/sink/callback_1": BoundCallback("/sink", "subscription", "/a", 0, 0, "/sink/callback_group_0", 700_000),
    }
