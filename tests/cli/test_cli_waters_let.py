"""The WATERS 2019 system under logical execution time: the published end-to-end latencies, whatever the schedule.

Figures: latencies (first-to-first) and reaction times as published for the five chains of the challenge; with a LET of
one period and offsets of zero they follow from the periods alone.
"""

from dataclasses import replace
from fractions import Fraction

import pytest

import waters2019
from halpipe import api
from halpipe.exporters.native import format_model, format_schedule
from halpipe.models import Chain
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.schedule import SearchOptions
from support import model, ms, task, version

CHAINS = {
    "sfm planner dasm": (65, 98),
    "lane_detection planner dasm": (98, 164),
    "detection planner dasm": (230, 430),
    "can_polling localization ekf planner dasm": (845, 855),
    "lidar_grabber localization ekf planner dasm": (875, 908),
}
"""Latency and reaction time in milliseconds."""


def under_let():
    """Every task on a unit of its own, with the WCETs of an A57 core, or of the GPU where the function needs one."""
    wcets = {name: (period, ms(wcet)) for name, (period, wcet, _) in waters2019.PLAIN.items()}
    for name, (period, pre, function, post) in waters2019.OFFLOADING.items():
        wcets[name] = period, ms(pre[0]) + ms(function[-1]) + ms(post[0])
    tasks = [
        replace(task(name, period, version("v", wcet, f"u_{name}"), offset=0, slack=Fraction(1, 20)), let=ms(period))
        for name, (period, wcet) in wcets.items()
    ]
    chains = [Chain(name=steps.split()[0], tasks=tuple(steps.split())) for steps in CHAINS]
    return model(*tasks, units=" ".join(f"u_{name}" for name in wcets), chains=chains, name="waters2019")


@pytest.fixture(scope="module")
def scheduled():
    system = under_let()
    found = schedule_model(system, SearchOptions(), lambda *_: True)
    assert found.is_complete
    return system, found.schedule


@pytest.mark.slow
def test_the_published_latencies_and_reaction_times(scheduled):
    _, plan = scheduled
    rows = {row["chain"]: (row["latency_ms"], row["reaction_ms"]) for row in api.latencies(plan)}
    assert rows == {steps.split()[0]: figures for steps, figures in CHAINS.items()}


def test_show_prints_them(scheduled, halpipe, tmp_path):
    system, plan = scheduled
    (tmp_path / "m.xml").write_bytes(format_model(system))
    (tmp_path / "s.xml").write_bytes(format_schedule(plan))
    shown = halpipe("show", tmp_path / "s.xml").stdout
    for steps, (latency, reaction) in CHAINS.items():
        assert f"chain {steps.split()[0]}: latency {latency}ms, reaction {reaction}ms, age " in shown


def test_a_limit_a_millisecond_below_is_refused(scheduled):
    system, plan = scheduled
    (first, *rest) = system.chains
    for limit, is_kept in ((65, True), (64, False)):
        limited = replace(system, chains=(replace(first, max_latency=ms(limit)), *rest))
        assert (not [d for d in api.verify(limited, replace(plan, model_sha256="")) if d.is_error]) == is_kept
