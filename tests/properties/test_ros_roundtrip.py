"""What goes out as ROS executors comes in again as the same model."""

import random
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from verify_systems import switching_system, valid_system

import strategies
from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.native import format_model
from halpipe.exporters.ros import FORMAT as OUT
from halpipe.exporters.ros import RosOptions
from halpipe.importers.native import parse_model
from halpipe.importers.ros import FORMAT as IN
from halpipe.importers.ros.options import RosImportOptions
from halpipe.models import HealthAction, HealthEvent, HealthRule
from halpipe.pipeline.verify import verify
from profiles import examples
from support import bare

FAST = examples(30, *HealthCheck)


def again(tmp_path_factory, model, schedule):
    data = OUT.write(model, schedule, RosOptions())[""]
    path = tmp_path_factory.mktemp("ros") / "executors.yaml"
    path.write_bytes(data)
    return data, IN.read([str(path)], RosImportOptions(strict=True)).model


@pytest.mark.parametrize("make", [valid_system, switching_system])
@FAST
@given(seed=st.integers(0, 10**6))
def test_a_model_comes_back(tmp_path_factory, make, seed):
    model, schedule = make(random.Random(seed))
    _, back = again(tmp_path_factory, model, schedule)
    assert bare(back) == bare(model)
    assert parse_model(format_model(back), "m.xml") == back
    assert list(verify(back, replace(schedule, model_sha256=back.digest))) == []
    data, once_more = again(tmp_path_factory, back, schedule)
    assert bare(once_more) == bare(back)
    assert again(tmp_path_factory, once_more, schedule)[0] == data


def test_health_rules_come_back(tmp_path_factory):
    model, schedule = switching_system(random.Random(1))
    task, (one, two) = model.tasks[0].name, [mode.name for mode in model.modes][:2]
    switch = HealthRule(task=task, event=HealthEvent.FAULT, count=3, cycles=7, mode=two)
    ruled = replace(model, health=(switch, HealthRule(task=task, action=HealthAction.STOP)))
    _, back = again(tmp_path_factory, ruled, schedule)
    assert bare(back.health) == ruled.health
    assert "<health>" not in OUT.write(ruled, schedule, RosOptions(mode=one))[""].decode()


@FAST
@given(seed=st.integers(0, 10**6), data=st.data())
def test_a_damaged_file_is_refused_or_read_but_never_fails(tmp_path_factory, seed, data):
    """Lines are removed, doubled or exchanged, and values replaced by anything."""
    model, schedule = valid_system(random.Random(seed))
    lines = OUT.write(model, schedule, RosOptions())[""].decode().splitlines()
    for _ in range(data.draw(st.integers(1, 4))):
        here, there = (data.draw(st.integers(2, len(lines) - 1)) for _ in range(2))
        change = data.draw(st.sampled_from(["exchange", "fill", "remove", "double"]))
        if change == "exchange":
            lines[here], lines[there] = lines[there], lines[here]
        elif change == "fill":
            key = lines[here].partition(":")[0]
            lines[here] = f"{key}: {data.draw(strategies.xml_texts)!r}"
        elif change == "remove":
            lines[here] = ""
        else:
            lines.insert(here, lines[there])
    path = tmp_path_factory.mktemp("damaged") / "executors.yaml"
    path.write_bytes("\n".join(lines).encode("utf-8", "replace"))
    try:
        imported = IN.read([str(path)], RosImportOptions())
    except HalpipeError as refused:
        assert refused.diagnostics, "a refusal needs a reason"  # noqa: PT017 - both ways out are allowed
    else:
        assert parse_model(format_model(imported.model), "m.xml") == imported.model
