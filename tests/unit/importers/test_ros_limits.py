"""Graphs and overlays beyond the limits are refused at once; what is just within them is read."""

import pytest

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.core.files import TOO_MUCH, parse_yaml
from halpipe.importers.common.base import Coverage
from halpipe.importers.overlay import entries, reader
from halpipe.importers.ros import caret

GRAPH = """\
named_paths: []
executors: []
nodes:
- node_name: /n
  callbacks:
  - {callback_name: /n/a, callback_type: subscription_callback, topic_name: /s}
  - {callback_name: /n/b, callback_type: subscription_callback, topic_name: /s}
  publishes:
  - {topic_name: /p}
  message_contexts:
  - {context_type: tilde, subscription_topic_name: /s, publisher_topic_name: /p}
"""


def graph():
    return caret.read_caret(parse_yaml(GRAPH.encode(), "g.yaml"), "g.yaml", Findings(), Coverage())


def refusal(run):
    with pytest.raises(HalpipeError) as refused:
        run()
    (found,) = refused.value.diagnostics
    assert found.code == TOO_MUCH.id
    assert found.help
    return found


def test_a_graph_has_no_more_entries_than_there_is_time_for(monkeypatch):
    monkeypatch.setattr(caret, "MAX_ELEMENTS", 5)
    assert len(graph().callbacks) == 2
    monkeypatch.setattr(caret, "MAX_ELEMENTS", 4)
    assert "has 5 nodes, callbacks" in refusal(graph).message


def test_flows_within_a_node_are_bounded(monkeypatch):
    monkeypatch.setattr(caret, "MAX_FLOWS", 4)
    assert {(flow.writer, flow.reader) for flow in graph().flows} == {("/n/a", "/n/b"), ("/n/b", "/n/a")}
    monkeypatch.setattr(caret, "MAX_FLOWS", 3)
    assert "has 4 flows" in refusal(graph).message


@pytest.mark.parametrize(
    "section",
    [
        "tasks:\n  a: {wcet: 1ms}\n  'b*': {wcet: 1ms}\n  'c?': {wcet: 1ms}\n",
        "tasks:\n  a: {units: [x, 'u*', 'v*']}\n",
        "drop: [a, 'b*', 'c?']\n",
        "sources:\n  '/b*': {period: 1ms}\n  '/c?': {period: 1ms}\n",
        "modes:\n  m: {tasks: ['a*', '[b]']}\n",
    ],
)
def test_patterns_of_an_overlay_are_bounded(tmp_path, monkeypatch, section):
    overlay = tmp_path / "o.yaml"
    overlay.write_text("halpipe-overlay: 1\n" + section)
    monkeypatch.setattr(reader, "MAX_GLOBS", 2)
    reader.read_overlays([str(overlay)])
    monkeypatch.setattr(reader, "MAX_GLOBS", 1)
    assert refusal(lambda: reader.read_overlays([str(overlay)])).at.file == str(overlay)
    assert entries.MAX_GLOBS == 1000
