"""The WATERS 2019 system: where strict periods on the TX2 cannot work, why, and what it takes that they do."""

import math
from dataclasses import replace

import pytest

from halpipe.core.durations import milliseconds
from halpipe.models import Status
from halpipe.pipeline.explain import codes
from halpipe.pipeline.explain.explanation import Verdict, explain
from halpipe.pipeline.explain.witnesses import find_witnesses
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from halpipe.pipeline.validate import validate
from halpipe.pipeline.verify import verify
from support import chain
from waters2019 import OFFLOADING, PLAIN, waters2019


def test_the_published_parameters():
    """Ten periodic tasks with 6951 jobs in 13.2 s; the four that offload are three tasks each here."""
    system = waters2019()
    expansion = expand(system, system.modes[0])
    assert str(expansion.hyperperiod) == "13.2s"
    counted = [expansion.by_name[name].jobs for name in (*PLAIN, *OFFLOADING)]
    assert len(counted) == 10
    assert sum(counted) == 6951
    assert not [d for d in validate(system) if d.is_error]


def test_strictly_periodic_on_the_tx2_the_gpu_cannot_hold_what_the_solution_puts_there():
    (hopeless,) = find_witnesses(waters2019(mapped=True))
    by_code = {witness.diagnostic.code: witness for witness in hopeless.witnesses}
    met = by_code[codes.TASKS_MEET.id]
    assert set(met.tasks) == {"detection", "sfm"}
    assert '7.9ms of "sfm" + 116ms of "detection" > 1ms = gcd(33ms, 200ms)' in met.diagnostic.message
    assert '1 more unit of type "gpu"' in met.diagnostic.help


def test_two_tasks_are_the_proof_where_sfm_has_to_keep_up_with_its_camera():
    """On the fastest cores its stages take 34.55 ms; on the GPU there is no room beside the 116 ms of detection."""
    limited = chain("camera", "sfm_pre sfm sfm_post", age="33ms")
    (hopeless,) = find_witnesses(replace(waters2019(slack=1), chains=(limited,)))
    (witness,) = [w for w in hopeless.witnesses if w.diagnostic.code == codes.UNIT_HELD.id]
    assert set(witness.tasks) == {"detection", "sfm_pre", "sfm", "sfm_post"}
    assert '"detection" holds "gpu" for 116ms at a time' in witness.diagnostic.message
    assert "elsewhere it would take 34.55ms at least" in witness.diagnostic.message
    room = 33 + 33 + (33 - 3.54) - 2 * 7.9 - 3.19 - 3.54  # limit, distance of the last stage's jobs, and what they take
    assert f"must start within {room:.2f}ms" in witness.diagnostic.message
    assert not find_witnesses(replace(waters2019(slack=1), chains=(replace(limited, max_age=milliseconds(77)),)))


def test_no_slack_lets_detection_and_sfm_share_the_gpu():
    """With all the slack that its deadline allows, sfm leaves 50.2 ms free, and detection takes 116 ms."""
    (hopeless,) = find_witnesses(waters2019(mapped=True, slack=1))
    (witness,) = [w for w in hopeless.witnesses if w.diagnostic.code == codes.NO_GAP.id]
    assert "at most 50.2ms free" in witness.diagnostic.message


def test_all_versions_free_it_cannot_work_on_the_tx2_either():
    """Eight tasks at one instant, and seven units: recomputed here, in hundredths of a millisecond."""
    (hopeless,) = find_witnesses(waters2019())
    (witness,) = hopeless.witnesses
    assert witness.diagnostic.code == codes.TASKS_MEET.id
    eight = {"detection", "localization", "os_overhead", "planner", "ekf", "lane_detection", "sfm", "lidar_grabber"}
    assert set(witness.tasks) == eight

    def together(first, second):
        (d1, c1), (d2, c2) = first, second
        over = c1 + c2 - math.gcd(d1, d2)
        assert over > 0
        return math.lcm(d1, d2), min(c1, c2, over / 2)

    # Localization never finds a gap on the GPU. On the fastest core, lane_detection and sfm need at most 42.24 ms: what
    # runs that long after the start of detection began after it, so that it is not on the GPU.
    detection = (20000, 11600 - 4224)
    slow = together((40000, 29481), together(detection, (10000, 5000)))
    sixty_six = together((6600, 4224), together((3300, 2782), (3300, 1087)))
    fifteen = together((1500, 1244), (1500, 443))
    assert together(slow, together(sixty_six, fifteen))[1] > 0


def test_with_one_more_unit_nothing_is_proven():
    assert not find_witnesses(waters2019(mapped=True, gpus="gpu2"))
    assert not find_witnesses(waters2019(gpus="gpu2"))
    assert not find_witnesses(waters2019(cores="core6"))


@pytest.mark.slow
@pytest.mark.parametrize(
    "extra",
    [{"mapped": True, "gpus": "gpu2", "cores": "core6"}, {"gpus": "gpu2", "cores": "core6"}, {"cores": "core6 core7"}],
    ids=["mapped", "core and gpu", "two cores"],
)
def test_strictly_periodic_with_more_units(extra):
    system = waters2019(**extra)
    schedule = schedule_model(system, SearchOptions(budget=2000), lambda *_: True).schedule
    assert schedule.modes[0].status is Status.VALID
    assert not [d for d in verify(system, schedule) if d.is_error]


@pytest.mark.slow
def test_explain_finds_the_units_that_are_missing():
    explanation = explain(waters2019(mapped=True))
    assert explanation.verdicts == (("all", Verdict.INFEASIBLE),)
    found = [d.message for d in explanation.diagnostics if d.code == codes.REMEDY.id]
    assert any("more unit of type" in text and '"gpu"' in text for text in found), found
