"""The chart in the terminal: what runs when, by letters."""

import pytest

from halpipe.cli.show import IDLE, LETTERS, SEVERAL, gantt, letters_of
from halpipe.models import Job, ModeSchedule, Status
from support import ms


def job(task, start, end, units="c1"):
    return Job(task=task, index=0, start=ms(start), end=ms(end), version="v", units=tuple(units.split()))


def rows(*jobs, length=10, width=44, wraps=True):
    letters = {task: task.upper() for task in "abc"}
    scale, *lines = gantt(jobs, ms(length), letters, width, wraps=wraps)
    assert all(len(line) == len(scale) for line in lines)
    return {line.split()[0]: line.split()[1] for line in lines}


def test_a_job_fills_the_columns_of_its_time():
    assert rows(job("a", 0, 5)) == {"c1": "A" * 20 + IDLE * 20}


def test_a_job_round_the_end_goes_on_at_the_beginning():
    assert rows(job("a", 9, 12)) == {"c1": "A" * 8 + IDLE * 28 + "A" * 4}
    assert rows(job("a", 9, 12), wraps=False) == {"c1": IDLE * 36 + "A" * 4}


def test_a_gang_is_on_all_its_units_and_short_jobs_are_still_seen():
    assert rows(job("a", 0, "1us", "c1 c2"), job("b", 5, 10, "c2")) == {
        "c1": "A" + IDLE * 39,
        "c2": "A" + IDLE * 19 + "B" * 20,
    }


def test_two_jobs_in_one_column_are_told():
    assert rows(job("a", 0, "100us"), job("b", "100us", "200us"))["c1"][0] == SEVERAL


@pytest.mark.parametrize("width", [0, 10, 80])
def test_any_terminal_has_room(width):
    assert len(rows(job("a", 0, 10), width=width)["c1"]) == max(20, width - 4)


def test_tasks_have_letters_of_their_own_until_there_are_too_many():
    jobs = tuple(job(f"t{n}", 0, 1) for n in range(70))
    table = ModeSchedule(name="m", hyperperiod=ms(10), status=Status.VALID, jobs=jobs)
    letters = letters_of((table,), ())
    assert len(set(letters.values())) == len(LETTERS) == 62
    assert letters["t0"] == letters["t62"] == "A"


def test_lines_of_units_begin_below_each_other():
    letters = {"a": "A"}
    lines = gantt((job("a", 0, 5, "c1"), job("a", 0, 5, "gpu-large")), ms(10), letters, 60, wraps=True)
    assert {line.index("A") for line in lines[1:]} == {len("gpu-large") + 2}
    assert lines[0].index("0") == len("gpu-large") + 2
