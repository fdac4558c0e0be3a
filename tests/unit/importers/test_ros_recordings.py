"""Recordings as rosbag2 leaves them: empty, split, cut short, of every version; and statistics of ROS 1."""

import pytest
from ros_case import found, periods, read, reasons, refusal, write

from halpipe.importers.ros import codes

GRAPH = 'digraph { scan [label="/scan", shape=box]; n [label="/n", shape=ellipse]; scan -> n }'
INFINITE = "- deadline:\\n    sec: 9223372036\\n    nsec: 854775807"
BAG = """\
rosbag2_bagfile_information:
  version: {version}
  storage_identifier: mcap
  duration: {{nanoseconds: {duration}}}
  starting_time: {{nanoseconds_since_epoch: {start}}}
  message_count: {count}
  topics_with_message_count:
    - topic_metadata: {{name: /scan, type: t, offered_qos_profiles: {qos}}}
      message_count: {count}
  files: [{{path: a_0.mcap}}, {{path: a_1.mcap}}]
"""


def bag(version=9, duration=10**9, start=1, count=41, qos="''"):
    return BAG.format(version=version, duration=duration, start=start, count=count, qos=qos)


@pytest.fixture
def imported(tmp_path):
    def read_with(text):
        return read(write(tmp_path, GRAPH), write(tmp_path, text, "metadata.yaml"))

    return read_with


@pytest.fixture
def refused(tmp_path):
    def refuse(text):
        return refusal(write(tmp_path, GRAPH), write(tmp_path, text, "metadata.yaml")).diagnostics

    return refuse


@pytest.mark.parametrize("version", [1, 4, 5, 8, 9])
def test_every_version_states_rates_alike(imported, version):
    assert periods(imported(bag(version=version))) == {"/n": "25ms"}


@pytest.mark.parametrize(
    ("duration", "start", "count"), [(0, 9223372036854775807, 0), (0, 1, 1), (0, 1, 50), (10**9, 1, 9)]
)
def test_an_empty_or_short_recording_has_no_rate(refused, duration, start, count):
    assert {d.code for d in refused(bag(duration=duration, start=start, count=count)) if d.is_error} == {
        codes.NO_TASKS.id
    }


@pytest.mark.parametrize(
    ("qos", "period"),
    [
        ('"- deadline:\\n    sec: 0\\n    nsec: 20000000"', "20ms"),
        ('"- deadline: {sec: 1, nsec: 0}\\n- deadline: {sec: 0, nsec: 500000000}"', "500ms"),
        ("[{deadline: {sec: 0, nsec: 100000000}}]", "100ms"),
        ("[{deadline: {sec: 31535999, nsec: 0}}]", "31535999s"),
    ],
)
def test_an_offered_deadline_stands_in_for_a_rate(imported, qos, period):
    assert periods(imported(bag(count=1, qos=qos))) == {"/n": period}
    assert periods(imported(bag(count=41, qos=qos))) == {"/n": "25ms"}


@pytest.mark.parametrize(
    "qos",
    [
        f'"{INFINITE}"',
        "''",
        "'- ['",
        "[]",
        "3",
        "'- deadline: {sec: -1, nsec: 0}'",
        "[{deadline: {sec: 0, nsec: 0}}]",
        "[{deadline: {sec: 31536000, nsec: 0}}]",
        "~",
    ],
)
def test_no_finite_deadline_is_no_rate(refused, qos):
    assert codes.NO_TASKS.id in {d.code for d in refused(bag(count=2, qos=qos))}


@pytest.mark.parametrize(
    "text",
    [
        bag().replace("duration: {nanoseconds: 1000000000}", "duration: ~"),
        bag().replace("name: /scan, ", ""),
        "rosbag2_bagfile_information: {duration: {nanoseconds: 5}}\n",
        "rosbag2_bagfile_information: {duration: {nanoseconds: 5}, topics_with_message_count: ~}\n",
    ],
)
def test_a_recording_cut_short_is_malformed(refused, text):
    (first, *_) = found(refused(text), codes.MALFORMED)
    assert "reindex" in first.help


def test_a_topic_recorded_twice_counts_once(tmp_path):
    double = bag().split("    - topic_metadata")[1].split("  files")[0]
    text = bag().replace("  files", "    - topic_metadata" + double.replace("41", "401") + "  files")
    imported = read(write(tmp_path, GRAPH), write(tmp_path, text, "metadata.yaml"))
    assert periods(imported) == {"/n": "2.5ms"}
    assert found(imported.diagnostics, codes.BAG_CONFLICT)


def test_recordings_of_other_topics_are_ignored(tmp_path):
    other = write(tmp_path, bag().replace("/scan", "/other"), "metadata.yaml")
    imported = read(write(tmp_path, GRAPH), other, sources={"/scan": "10ms"})
    assert reasons(imported, "bag_topic") == {"/other": "no node of the graph uses it"}


# ------------------------------------------------------------------------------------------ statistics of ROS 1

ROS1 = """\
digraph graphname {
	graph [bb="0,0,1,1", rankdir=LR];
	n__driver [URL="/driver", height=0.5, label="/driver", shape=ellipse];
	n__filter [URL="/filter", label="/filter", shape=ellipse];
	n__log [URL="/log", label="/log", shape=ellipse];
	t__scan [URL="topic_/scan", label="/scan", shape=box];
	n__driver -> t__scan [color="#000000", penwidth=1];
	t__scan -> n__filter [color="#ff0000", label="%s", penwidth=3.2];
	t__scan -> n__log [label="%s"];
}
"""


@pytest.mark.parametrize(
    ("labels", "period"),
    [
        (("40.0 Hz // 12.0 ms", ""), "25ms"),
        (("/scan\\n39.8 Hz // 12.0 ms", "/scan\\n39.9 Hz // 3.0 ms"), "25ms"),
        (("10 Hz // nan ms", "0.0 Hz // 0 ms"), "100ms"),
    ],
)
def test_statistics_on_edges_are_rates_of_topics(tmp_path, labels, period):
    imported = read(write(tmp_path, ROS1 % labels))
    assert periods(imported) == dict.fromkeys(("/driver", "/filter", "/log"), period)


def test_statistics_that_say_nothing_are_no_rate(tmp_path):
    assert found(refusal(write(tmp_path, ROS1 % ("nan Hz // nan ms", "0.0 Hz"))).diagnostics, codes.NO_TASKS)


def test_a_recording_goes_before_statistics(tmp_path):
    graph = write(tmp_path, ROS1 % ("10.0 Hz // 1 ms", ""))
    assert set(periods(read(graph, write(tmp_path, bag(), "metadata.yaml"))).values()) == {"25ms"}


@pytest.mark.parametrize(
    ("change", "doubt"),
    [
        ({"version": 9}, None),
        ({"version": 10}, 'version "10" is not known'),
        ({"total": 40}, "message_count is 40, and the topics have 41 messages"),
    ],
)
def test_metadata_that_contradicts_itself_or_its_format_is_doubted(imported, change, doubt):
    total = change.pop("total", 41)
    result = imported(bag(**change).replace("message_count: 41", f"message_count: {total}", 1))
    assert [d.message for d in found(result.diagnostics, codes.ODD_BAG)] == ([doubt] if doubt else [])
