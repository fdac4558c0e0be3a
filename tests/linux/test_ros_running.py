"""The container of an exported package runs with stand-ins that behave as rclcpp does; no middleware takes part.

The stand-ins name the sources of ros2/rclcpp that they imitate; held against nothing real here. Where a ROS is sourced,
`tests/ros` runs the examples as they are.
"""

import csv
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from test_ros_package import HUMBLE, ROLLING, STUBS, package
from test_ros_package import system as plain_system

from halpipe.deploy.linux.judging import judge, read_recording
from halpipe.models import Status, TransitionTable
from support import ms

SCENARIOS = Path(__file__).with_name("ros_scenarios") / "scenarios.cpp"
NAMES = ("full", "within", "dead", "patterns", "cancelling", "unload", "lifecycle", "throwing", "hanging", "random")
WAITS = ("waiting", "missing")
THREADS = ("threads", "task_threads", "wrong_threads", "unknown_threads", "reserved_task", "apart", "reservations")
SIMULATIONS = ("slow_simulation", "fast_simulation")
REFUSED = {
    "node_simulated": "/sink: use_sim_time: the tables have the machine's clock; state it for the container, too",
    "no_cpu": "cpus is UNIT=CPU,..., each unit once, not u1=",
    "two_cpus": "cpus is UNIT=CPU,..., each unit once, not u1=1",
}
FAULTS = 3
"""Exit status after a fault that was noticed."""
pytestmark = [
    pytest.mark.slow,  # a program of C++ is built, and the tables begin at a whole second
    pytest.mark.skipif(not shutil.which("g++") or not shutil.which("cc"), reason="the scenarios are built with g++"),
]


class Played:
    """Output, messages, exit status and recording of a scenario."""

    def __init__(self, process, recording):
        self.out, self.err = process.communicate(timeout=120)
        self.status = process.returncode
        self.recording = recording

    @property
    def is_sound(self):
        """Whether it ended as it should, but for jobs that a busy machine made late."""
        late = re.search("ended late|took longer than its slot|were left out", self.err)
        return self.status == 0 or (self.status == FAULTS and late is not None)

    @property
    def rows(self):
        return list(csv.DictReader(self.recording.read_text().splitlines()))


def system():
    """The system with a mode in which only the source runs."""
    owner, tables = plain_system()
    [mode], [table] = owner.modes, tables.modes
    limp = replace(mode, name="limp", runs=tuple(run for run in mode.runs if run.task == "/source"))
    owner = replace(owner, modes=(mode, limp))
    alone = replace(table, name="limp", jobs=tuple(job for job in table.jobs if job.task == "/source"))
    way = TransitionTable(
        source=mode.name, target="limp", length=ms(0), worst_latency=ms(10), status=Status.VALID, jobs=()
    )
    return owner, replace(tables, modes=(table, alone), transitions=(way,))


@pytest.fixture(scope="module", params=[HUMBLE, ROLLING])
def played(request, tmp_path_factory):
    """All scenarios with one version of rclcpp, started together; Jazzy has the code of Rolling, and is compiled."""
    folder = tmp_path_factory.mktemp("ros")
    build(folder, request.param)
    return play(folder, (*NAMES, *WAITS, *SIMULATIONS, *THREADS, *REFUSED, "no_background"))


def build(folder, distribution):
    """Build the scenarios with a package, whose rows they may change."""
    owner, tables = system()
    files = package(owner=owner, tables=tables)
    rows = files["src/bindings.hpp"]
    files["src/bindings.hpp"] = rows.replace("static const Row rows[]", "static Row rows[]")
    assert files["src/bindings.hpp"] != rows
    for name, content in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content)
    for source in ("runtime/dispatch.c", "runtime/record.c", "tables.c"):
        command = ["cc", "-c", "-std=gnu11", "-Iruntime", source, "-o", f"{Path(source).stem}.o"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
    command = [
        "g++",
        "-std=c++17",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-O0",
        f"-DSTUB_RCLCPP={distribution}",
        "-DPRIORITY=0",
    ]
    command += [f"-I{STUBS}", "-Isrc", "-Iruntime", str(SCENARIOS), "dispatch.o", "record.o", "tables.o"]
    built = subprocess.run(
        [*command, "-o", "scenarios", "-pthread", "-ldl"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert built.returncode == 0, built.stderr


def play(folder, names):
    """Run some scenarios at once."""
    running = {}
    for name in names:
        command = [str(folder / "scenarios"), name, str(folder / f"{name}.csv")]
        running[name] = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    return {name: Played(process, folder / f"{name}.csv") for name, process in running.items()}


def torn_cycles(rows):
    """Return the cycles in which a busy machine did not run the sink between its source and the next one."""
    times = {(row["task"], int(row["cycle"])): (int(row["start"]), int(row["end"] or 2**63)) for row in rows}
    never = (2**63, 2**63)
    return [
        cycle
        for (task, cycle), (start, end) in times.items()
        if task == "/sink"
        and not times.get(("/source", cycle), never)[1] <= start <= end <= times.get(("/source", cycle + 1), never)[0]
    ]


def numbers(text):
    words = text.split()
    return dict(zip(words[::2], map(int, words[1::2]), strict=True))


@pytest.mark.parametrize("name", ["full", "within"])
def test_a_queue_that_was_full_at_the_start_makes_no_datum_old(played, name):
    """Through the middleware, and within the process, where the wait of the background lane takes messages."""
    found, torn = numbers(played[name].out), torn_cycles(played[name].rows)
    assert played[name].is_sound, played[name].err
    assert found["sent"] > 50
    assert found["sent"] - len(torn) <= found["seen"] <= found["sent"]
    assert found["wrong"] <= len(torn)
    assert found["first"] == 1 or torn


def test_a_system_without_a_publisher_is_found_dead(played):
    dead = played["dead"]
    assert dead.status == FAULTS
    pipe, status = dead.out.splitlines()
    assert numbers(pipe)["seen"] == 0
    assert {(row["task"], row["data"]) for row in dead.rows} == {("/source", "1"), ("/sink", "0")}
    assert "/sink: there was no message for a job" in dead.err
    found = re.fullmatch(
        r"table_container: all tasks level 1 count (\d+) array (\d+); mode all; cycle (\d+); ended late \d+; "
        r"longer than their slots \d+; without a message (\d+); skipped 0; failed 0; tables lost \d+",
        status,
    )
    count, arrays, cycle, missing = map(int, found.groups())
    assert count > arrays >= 1  # every 100 ms, and every second
    assert 0 < missing <= cycle + 1
    judgement = judge(*system(), read_recording(dead.recording.read_bytes()), is_timed=False)
    assert {d.code for d in judgement.diagnostics} == {"HAL1089"}


def test_what_no_row_runs_is_served_in_the_background_lane(played):
    found = numbers(played["patterns"].out)
    assert played["patterns"].is_sound
    assert (found["extra"], found["reentrant"], found["late"]) == (1, 1, 1)
    assert (found["answers"], found["action"]) == (4, 4)
    assert found["overlap"] == 0  # of a handler and a job of one exclusive group
    assert (found["own"], found["polled"]) == (0, 0)  # its node spins this group
    assert "no row, so it runs in the background lane: timer" in played["patterns"].err


def test_a_timer_that_was_cancelled_does_not_run(played):
    """In the background lane, where it was ready when another cancelled it, and as a row, which has no datum then."""
    assert numbers(played["cancelling"].out) == {"first": 1, "after": 0, "sent": 0}
    assert {row["data"] for row in played["cancelling"].rows} == {"0"}
    assert "/source: there was no message for a job" in played["cancelling"].err


def test_a_node_is_not_unloaded_while_the_tables_run_it(played):
    assert numbers(played["unload"].out) == {"playing": 0, "other": 1, "seen": 1}
    assert played["unload"].is_sound  # and the end removes each node from the executor that has it


def test_the_tables_wait_for_the_callbacks_of_a_lifecycle_node(played):
    assert "the tables wait for the callbacks of: /sink (subscription /a of /sink)" in played["lifecycle"].err
    found = numbers(played["lifecycle"].out)
    assert found["seen"] == 1
    assert found["wrong"] <= len(torn_cycles(played["lifecycle"].rows))


def test_an_exception_ends_the_tables_with_its_task_and_the_recording(played):
    thrown = played["throwing"]
    assert thrown.status == FAULTS
    assert "task /source: no more wheels" in thrown.err
    assert "the tables have ended after a failure" in thrown.err
    rows = [row for row in thrown.rows if row["task"] == "/source"]
    assert [row["cycle"] for row in rows] == [str(i) for i in range(numbers(thrown.out)["sent"])]
    # The thirtieth job throws; tables that were due by then, since the machine was away, are played.
    assert all(int(row["planned"]) < int(rows[29]["end"]) + 1_000_000 for row in rows[30:])


def test_a_callback_that_never_returns_is_named_and_does_not_hold_up_the_end(played):
    hung = played["hanging"]
    assert hung.status == FAULTS
    assert "a job does not return; the process ends without it" in hung.err
    assert "task /sink still runs" in hung.err
    assert [row["end"] for row in hung.rows if row["task"] == "/sink"].count("") == 1


@pytest.mark.parametrize("name", REFUSED)
def test_what_the_tables_cannot_be_played_with_is_refused_by_name(played, name):
    refused = played[name]
    assert (refused.status, numbers(refused.out)["sent"]) == (1, 0)
    assert REFUSED[name] in refused.err
    assert "the tables are not played" in refused.err
    assert "the tables never began" in refused.err


@pytest.mark.parametrize("name", SIMULATIONS)
def test_tables_follow_simulated_time(played, name):
    """They hold while it pauses, and end when it is set back; the recording has the time of the simulation."""
    found = played[name]
    counts = numbers(found.out)
    assert (counts["unpaused"], counts["some"]) == (0, 1)
    assert counts["wrong"] <= len(torn_cycles(found.rows))
    assert "the tables wait for /clock" in found.err
    assert "/source: without use_sim_time, as the tables have it, its now() is that of the machine" in found.err
    assert "/sink: without use_sim_time" not in found.err
    assert re.search(
        r"the clock was set, by -[5-7]\d{6} us in all; the tables end", found.err
    )  # since it was read last
    assert found.status == FAULTS
    assert all(int(row["start"]) >= int(row["planned"]) for row in found.rows)
    assert {int(row["planned"]) - 10_000_000 * int(row["cycle"]) for row in found.rows} == {0, 2_000_000}
    cycles = {int(row["cycle"]) for row in found.rows}
    assert max(cycles) < 260  # simulated time ends at 8.6 s, and the tables begin at a whole second of it, 6 or later
    assert ("simulated time ran ahead" in found.err) == (cycles != set(range(max(cycles) + 1)))
    assert (name == "slow_simulation") or "simulated time ran ahead" in found.err


def test_a_callback_group_has_the_thread_that_a_file_states(played):
    """Nice value and CPUs of the group's thread, which ends with its node; a template's entry states nothing."""
    found = numbers(played["threads"].out)
    assert found == {"nice": 5, "cpus": 1, "runs": 1, "after": 0, "priority": 0, "seen": 1}
    assert played["threads"].is_sound


def test_the_threads_of_tasks_have_the_priority_that_a_file_states(played):
    """By the name of a task, and by the group of its callback; a machine without rights says so."""
    found = played["task_threads"]
    assert numbers(found.out)["priority"] == 20 or "Operation not permitted give this process CAP_SYS_NICE" in found.err


def test_entries_that_cannot_be_are_refused_with_their_lines(played):
    wrong = played["wrong_threads"]
    for line, why in enumerate(
        (
            "there is no policy SCHED_SOON",
            "priority is from 1 to 99, not 0",
            "priority is from -20 to 19, not 20",
            "affinity is a list of CPUs, not 0,x",
            "SCHED_DEADLINE has 1024 <= runtime <= deadline <= period, in ns",
            "the kernel refuses affinity of SCHED_DEADLINE",
        ),
        1,
    ):
        assert f"t.yaml:{line}: /other@Timer(7000000): {why}" in wrong.err
    assert "t.yaml:1: there is no callback group or task /sink@Subscription(/b); its node has /sink@" in (
        played["unknown_threads"].err
    )
    assert "t.yaml:1: /sink: a thread of the tables starts at fixed instants, which SCHED_FIFO keeps" in (
        played["reserved_task"].err
    )
    assert re.search("t.yaml:[12]: .*above the lowest of the tables, whose priority is 2[01]", played["apart"].err)
    for name in ("wrong_threads", "unknown_threads", "reserved_task", "apart"):
        assert (played[name].status, numbers(played[name].out)["seen"]) == (1, 0)
        assert "the tables are not played" in played[name].err


def test_a_reservation_that_the_kernel_does_not_admit_is_named(played):
    """The judge is the kernel: one reservation of 99 % more than there are CPUs, or none at all without rights."""
    assert re.search(r"t.yaml:\d+: /other@Timer\(\d+\): .*\((EBUSY|EPERM)\)", played["reservations"].err)
    assert played["reservations"].status == 1


def test_a_background_lane_on_no_cpu_is_refused(played):
    refused = played["no_background"]
    assert (refused.status, refused.err) == (1, "--background-cpus is CPU,..., not 1,x\n")


def test_equal_timers_run_their_own_rows_or_are_refused(played):
    """A thousand nodes with up to four timers and subscriptions, equal or nearly so, in up to three groups."""
    assert numbers(played["random"].out) == {"wrong": 0, "needless": 0, "refused": 1, "right": 1}


def test_a_job_waits_for_the_message_of_a_sensor_and_without_one_its_mode_follows(played):
    """The sink waits 0.9 ms of its WCET; when the publisher is dead, the mode follows in which only the source runs."""
    folder, waiting = played["waiting"].recording.parent, played["waiting"]
    for _ in range(2):  # the publisher needs a processor within a millisecond, which a busy machine may not give
        if not numbers(waiting.out)["seen"]:
            waiting = play(folder, ["waiting"])["waiting"]
    assert numbers(waiting.out) == {"seen": 1, "fresh": 1}
    rows = played["missing"].rows
    first = next(row for row in rows if row["data"] == "0")  # it asks for the mode, which the next table has
    assert all(int(row["planned"]) < int(first["end"]) + 3_000_000 for row in rows if row["mode"] == "all")
    assert "limp" in {row["mode"] for row in rows}
