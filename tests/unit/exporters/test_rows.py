"""Schedules as rows, JSON and CSV: exact milliseconds, a row for each part of a job, floats for plots only."""

import json
import math
from dataclasses import replace
from fractions import Fraction

from halpipe.exporters.common.rows import as_csv, as_floats, as_json, job_rows, latency_rows, load_rows, switch_rows
from halpipe.models import ChainLatency, Part, ResourceLoad, Status, TransitionTable, UnitLoad
from support import job, model, ms, schedule, task, version

SYSTEM = model(task("a", 10, version("v", "2ms", "u1 u2", gang=2)), task("b", 10, version("v", "1/3ms")))
GAPPED = replace(
    job(SYSTEM, "b", 3, 4, "u1"),
    end=ms(6),
    parts=(
        Part(start=ms(4), end=ms("25/6ms"), executed_from=ms(0), executed_to=ms("1/6ms")),
        Part(start=ms(5), end=ms(6), executed_from=ms("1/6ms"), executed_to=ms("1/3ms")),
    ),
)
PLAN = schedule(SYSTEM, 10, job(SYSTEM, "a", 0, 1, "u1 u2"), GAPPED)
PLAN = replace(
    PLAN,
    modes=(
        replace(
            PLAN.modes[0],
            margin=Fraction(1, 3),
            unit_loads=(UnitLoad(unit="u1", busy=ms(4), share=Fraction(2, 5)),),
            resource_loads=(ResourceLoad(resource="r", peak=Fraction(3, 4), mean=Fraction(1, 7)),),
            chains=(ChainLatency(name="c", reaction=ms(20), age=None),),
        ),
    ),
    transitions=(
        TransitionTable(
            source="all",
            target="all",
            length=ms(3),
            worst_latency=ms(13),
            status=Status.VALID,
            jobs=(job(SYSTEM, "b", 0, 0, "u1"),),
        ),
    ),
)


def test_there_is_a_row_for_each_part_of_a_job():
    assert [tuple(row.values()) for row in job_rows(PLAN)] == [
        ("all", "a", 0, "v", "u1 u2", 0, 1, 3),
        ("all", "b", 3, "v", "u1", 0, 4, Fraction(25, 6)),
        ("all", "b", 3, "v", "u1", 1, 5, 6),
        ("all->all", "b", 0, "v", "u1", 0, 0, Fraction(1, 3)),
    ]


def test_loads_latencies_and_switches_are_rows():
    assert [tuple(row.values()) for row in load_rows(PLAN)] == [
        ("all", "unit", "u1", 4, Fraction(2, 5), None),
        ("all", "resource", "r", None, Fraction(1, 7), Fraction(3, 4)),
    ]
    assert [tuple(row.values()) for row in latency_rows(PLAN)] == [("all", "c", 20, None, None)]
    assert [tuple(row.values()) for row in switch_rows(PLAN)] == [("all", "all", 3, 13, 1, "valid")]


def test_csv_has_a_line_for_each_row():
    assert as_csv(PLAN).splitlines() == [
        "table,task,job,version,units,part,start_ms,end_ms",
        "all,a,0,v,u1 u2,0,1,3",
        "all,b,3,v,u1,0,4,25/6",
        "all,b,3,v,u1,1,5,6",
        "all->all,b,0,v,u1,0,0,1/3",
    ]


def test_json_has_exact_numbers_as_texts_in_ascii():
    text = as_json(replace(PLAN, model="m\u00fc"))
    assert text.isascii()
    found = json.loads(text)
    assert (found["halpipe-show"], found["model"]) == (1, "m\u00fc")
    (mode,) = found["modes"]
    assert (mode["name"], mode["hyperperiod_ms"], mode["margin"], mode["margin_bound"]) == ("all", "10", "1/3", None)
    assert [row["end_ms"] for row in found["jobs"]] == ["3", "25/6", "6", "1/3"]
    assert [row["share"] for row in found["loads"]] == ["0.4", "1/7"]
    assert (found["latencies"][0]["reaction_ms"], found["switches"][0]["jobs"]) == ("20", 1)


def test_floats_are_for_plots_and_what_is_too_large_is_infinite():
    rows = [{"a": Fraction(1, 4), "b": 3, "c": "x", "d": Fraction(10**400)}]
    assert as_floats(rows) == [{"a": 0.25, "b": 3, "c": "x", "d": math.inf}]
    assert isinstance(as_floats(rows)[0]["b"], int)
