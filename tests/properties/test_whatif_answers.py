"""Answers of sensitivity and size for small systems in full: numbers, reasons, proofs, and how often a search asks."""

import random
from dataclasses import replace
from fractions import Fraction

import pytest
import refined_systems
import split_systems
import verify_systems
from test_search_golden import FAMILIES

from golden_answers import assert_answers, findings
from halpipe.pipeline.verify import verify
from halpipe.pipeline.whatif.excerpt import Sections
from halpipe.pipeline.whatif.sensitivity import SensitivityOptions, common_tick, sensitivities, with_searches
from halpipe.pipeline.whatif.size import SizeOptions, answer_of, complaint, question_of

MOST_QUESTIONS = 80
"""Questions whether to go on after which the answer is no."""


def refined(family):
    """Return a family of systems with requirements of MODEL 10, with the schedules from which they are drawn."""

    def made(rng):
        system, plan = family.valid_system(rng)
        return refined_systems.refined(rng, system, plan).read_from("0" * 64), plan

    return made


PLANNED = {
    "whole": verify_systems.valid_system,
    "split": split_systems.valid_system,
    "crowded": split_systems.crowded_system,
    "switching": verify_systems.switching_system,
    "switching-split": split_systems.switching_system,
    "refined": refined(verify_systems),
    "refined-split": refined(split_systems),
}
"""Systems with a schedule."""


def planned(name):
    """Return the system of a family and a seed, with a schedule of it that verifies."""
    family, seed = name.split()
    system, plan = PLANNED[family](random.Random(int(seed)))[:2]
    assert not any(found.is_error for found in verify(system, plan))
    return system, plan


def rows_of(name):
    system, plan = planned(name)
    return system, list(sensitivities(system, plan, frozenset()))


class Asked:
    """Counts the questions of a search, and answers no from some number on."""

    def __init__(self):
        self.count = 0

    def __call__(self, *_):
        self.count += 1
        return self.count < MOST_QUESTIONS


def sensitivity(name):
    return [f"{row.task} {row.version}: {row.wcet} + {row.growth}, {row.reason}" for row in rows_of(name)[1]]


def search(name):
    """Look how far the WCETs of the first three versions can grow where all may move."""
    system, rows = rows_of(name)
    asked = Asked()
    chosen = SensitivityOptions(search=True, budget=20, step=Fraction(1, 8))
    lines = []
    for row in with_searches(system, rows[:3], chosen, asked, asked):
        found = row.searched
        failed = ", ".join(map(str, found.failed))
        cut = ", cut" if found.is_cut else ""
        lines.append(f"{row.task} {row.version}: {found.found} of {found.bound}, failed: {failed}{cut}")
    return [*lines, f"asked {asked.count} times"]


def size(name, **options):
    """Ask for a size of the system of a family and a seed; every second unit of three is a core."""
    family, seed = name.split()
    system = planned(name)[0] if family in PLANNED else FAMILIES[family](int(seed))
    types = (replace(unit, type="core" if n % 3 else "x") for n, unit in enumerate(system.units))
    chosen, asked = SizeOptions(budget=20, **options), Asked()
    question = question_of(replace(system, units=tuple(types)) if chosen.units else system, chosen)
    answer = answer_of(question, chosen, asked, asked)
    values = f"{question.hardest} to {question.easiest} times {question.step}, likely {question.likely}"
    failed = ", ".join(map(str, answer.failed))
    cut = ", cut" if answer.is_cut else ""
    lines = [f"{question.what}: {answer.found}, bound {answer.bound} of {values}, failed: {failed}{cut}"]
    said = complaint(answer)
    lines += findings([*question.warnings, *answer.witness, *([said] if said else [])])
    return [*lines, f"asked {asked.count} times"]


VERBS = {
    "sensitivity": sensitivity,
    "search": search,
    "units": lambda name: size(name, units="core"),
    "bandwidth": lambda name: size(name, bandwidth="r", step=Fraction(1, 8)),
    "factor": lambda name: size(name, wcet_factor=True, step=Fraction(1, 8)),
    "switches": lambda name: size(name, wcet_factor=True, step=Fraction(1, 4), switches=True),
}

ANSWERS = {
    "sensitivity": {
        "switching": (123, 135, 174, 210, 215, 237, 273),
        "crowded": (24, 40, 69, 208, 286),
        "refined": (147, 151, 180, 215, 234, 252, 253, 311),
        "whole": (123, 215, 223, 226, 241, 253, 329, 332),
        "split": (54, 211),
        "switching-split": (47, 54, 83, 129),
        "refined-split": (3, 162),
    },
    "search": {
        "split": (9, 11, 39, 72, 91, 120, 323, 325, 332, 335),
        "whole": (1, 5, 11, 17, 23, 44, 45, 49, 50, 64, 66, 67, 70, 82, 100, 102, 115),
        "crowded": (325, 338),
        "refined-split": (301, 316, 325, 335),
        "refined": (76, 84),
    },
    "units": {
        "split": (301, 305, 313, 314, 328, 331, 332, 336, 339, 342),
        "random": (9, 42, 51, 59, 96, 110, 114),
        "whole": (11, 14, 28, 30, 31, 68, 72, 91, 93, 104),
        "gangs": (10, 94),
    },
    "bandwidth": {"whole": (30, 42, 54, 61, 75), "every": (27, 110), "split": (45, 86, 103)},
    "factor": {
        "random": (310, 313, 336, 337, 342),
        "split": (5, 29, 60, 104, 301),
        "whole": (24, 99, 112),
        "refined": (21, 62, 115),
        "every": (63, 108),
    },
    "switches": {"every": (40, 63, 108), "switching": (5, 19, 23), "switching-split": (318, 332)},
}
"""Systems by verb that reach each line of the room: families and seeds."""


@pytest.mark.parametrize("verb", ANSWERS)
def test_sizes_are_what_they_were_before(verb):
    """Numbers, words and the count of the work, to the last one."""
    names = [f"{family} {seed}" for family, seeds in ANSWERS[verb].items() for seed in seeds]
    assert_answers(f"whatif-{verb}", {name: lambda name=name: VERBS[verb](name) for name in names})


def edges(name):
    """Return how far each version can grow before it meets others on its units, and to which edges of windows."""
    system, plan = planned(name)
    sections = Sections(system, plan, common_tick(system, plan))
    versions = [(task.name, version.name) for task in system.tasks for version in task.versions]
    lines = []
    for section in (*sections.modes(), *sections.switches()):
        for task, version in filter(section.__contains__, versions):
            room = section.room(task, version)
            turns = " ".join(map(str, section.turns(task, version, 40)))
            lines.append(f"{task} {version}: {room.units}, free {room.free}; {turns}")
    return lines


EDGES = {
    "refined-split": (0, 16, 19, 27, 38, 41, 51, 65, 72, 74, 78, 79, 88, 101, 105, 114, 118),
    "refined": (21, 38, 43, 50, 58, 61, 75, 76, 102, 109, 115),
    "switching-split": (0, 9, 11, 16, 19, 28, 33, 37, 38, 39, 41, 43),
    "switching": (3, 5, 10, 11, 13, 17, 20, 21, 26),
}


def test_rooms_to_grow_are_what_they_were_before():
    names = [f"{family} {seed}" for family, seeds in EDGES.items() for seed in seeds]
    assert_answers("whatif-edges", {name: lambda name=name: edges(name) for name in names})
