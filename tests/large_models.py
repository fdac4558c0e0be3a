"""Large models of several shapes through every verb: at most 10 s of processor time and 1 GiB each.

Models are of 5 MB, and most of their schedules as large, so that a verb reads 10 MB; one that reads more may take a
second for each MB. Prints a line for each verb and ends with 1 if one breaks the law. Schedules are made within a time
limit, which is no part of the law; a shape for which none is found meets the verbs of models alone.
Usage: large_models.py [MB] [SHAPE ...]
"""

from __future__ import annotations

import resource
import sys
import tempfile
from itertools import count, pairwise
from pathlib import Path
from typing import TYPE_CHECKING

from endurance import MEBIBYTES, SECONDS, run

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

PATIENCE = 120
NAMESPACE = "urn:halpipe:task-model:1"

MADE = {"schedule, with a limit": "schedule model.xml -o s.xml --time-limit 60s -q"}
ON_MODELS = {
    "schedule": "schedule model.xml -o other.xml",
    "explain": "explain model.xml",
    "size": "size model.xml --wcet-factor",
    "validate": "validate model.xml",
    "diff of models": "diff model.xml model.xml",
    "export arxml": "export arxml model.xml -o out.arxml",
    "export amalthea": "export amalthea model.xml -o out.amxmi",
    "export graph": "export graph model.xml -o out.dot",
}
ON_SCHEDULES = {
    "verify": "verify model.xml s.xml",
    "show": "show s.xml",
    "show, CSV": "show s.xml --format csv",
    "sensitivity": "sensitivity model.xml s.xml",
    "sensitivity, search": "sensitivity model.xml s.xml --search",
    "diff of schedules": "diff s.xml s.xml",
    "export btf": "export btf model.xml s.xml -o out.btf",
    "compare": "compare s.xml out.btf",
    "export trace": "export trace model.xml s.xml -o out.json",
    "export report": "export report model.xml s.xml -o out.html",
    "export xlsx": "export xlsx model.xml s.xml -o out.xlsx",
    "export arxml, schedule": "export arxml model.xml s.xml -o out.arxml",
    "export amalthea, schedule": "export amalthea model.xml s.xml -o out.amxmi",
    "export graph, schedule": "export graph model.xml s.xml -o out.dot",
    "export ros": "export ros model.xml s.xml -o out.yaml",
    "export linux": "export linux model.xml s.xml -o linux --busy 50",
    "export feo": "export feo model.xml s.xml --mode m0 -o feo.json",
    "export timpani": "export timpani model.xml s.xml --mode m0 -o timpani.yaml",
    "export launch-manager": "export launch-manager model.xml s.xml -o launch.json",
}


def task(name: str, inside: str = "", *, unit: str = "u0", period: str = " period='1s'") -> str:
    """Return a task with one version that takes a microsecond."""
    return (
        f"<task name='{name}'{period}><version name='v' wcet='1us'><units names='{unit}'/>{inside}</version></task>\n"
    )


def model(tasks: list[str], modes: list[list[str]], *, rest: str = "", switches: str = "") -> str:
    """Return a model of eight units whose modes run tasks by name."""
    units = "".join(f"<unit name='u{i}'/>" for i in range(8))
    runs = ("".join(f"<run task='{name}' versions='v'/>" for name in names) for names in modes)
    listed = "".join(f"<mode name='m{i}'>{text}</mode>\n" for i, text in enumerate(runs))
    return (
        f"<task-model xmlns='{NAMESPACE}' name='m'><platform>{units}</platform>\n<tasks>{''.join(tasks)}</tasks>\n"
        f"{rest}<modes>{listed}</modes>{switches}</task-model>\n"
    )


def filled(size: int, one: Callable[[int], str], beside: int = 40) -> tuple[list[str], list[str]]:
    """Return as many tasks as fill the size, with `beside` bytes for the mention of each in modes, and their names."""
    tasks: list[str] = []
    for number in count():
        tasks.append(one(number))
        size -= len(tasks[-1]) + beside
        if size <= 0:
            return tasks, [f"t{i}" for i in range(number + 1)]
    raise AssertionError


def flat(size: int) -> str:
    """One mode of tasks on eight units."""
    tasks, names = filled(size, lambda i: task(f"t{i}", unit=f"u{i % 8}"))
    return model(tasks, [names])


def two_modes(size: int) -> str:
    """Two modes of all tasks, with switches between them."""
    tasks, names = filled(size, lambda i: task(f"t{i}", unit=f"u{i % 8}"), 80)
    switches = "<transitions><transition from='m0' to='m1'/><transition from='m1' to='m0'/></transitions>"
    return model(tasks, [names, names], switches=switches)


def fifty_modes(size: int) -> str:
    """Fifty modes that each run a fiftieth of the tasks."""
    tasks, names = filled(size, lambda i: task(f"t{i}", unit=f"u{i % 8}"))
    return model(tasks, [names[i::50] for i in range(50)])


def chains(size: int) -> str:
    """Chains of ten tasks with a bound of age."""
    tasks, names = filled(size, lambda i: task(f"t{i}", unit=f"u{i % 8}"), 60)
    links = (names[i : i + 10] for i in range(0, len(names) - 1, 10))
    listed = "".join(
        f"<chain name='c{i}' tasks='{' '.join(link)}' max-age='4s'/>\n" for i, link in enumerate(links) if len(link) > 1
    )
    return model(tasks, [names], rest=f"<chains>{listed}</chains>")


def precedences(size: int) -> str:
    """Pairs of tasks, the second within 100 ms of the first."""

    def one(i: int) -> str:
        after = f"<precedence task='t{i - 1}' max='100ms'/>" if i % 2 else ""
        return task(f"t{i}", after, unit=f"u{i % 8}")

    tasks, names = filled(size, one)
    return model(tasks, [names])


def accesses(size: int) -> str:
    """Tasks that each load a memory for half of their time, with a share of a hundredth."""
    access = "<access resource='r' start='0us' end='0.5us' bound='0.01'/>"
    tasks, names = filled(size, lambda i: task(f"t{i}", access, unit=f"u{i % 8}"))
    return model(tasks, [names]).replace("</platform>", "<resource name='r' bandwidth='1GB/s'/></platform>")


def many_jobs(size: int) -> str:
    """Tasks with ten jobs each, but for one of the length of the hyperperiod: the schedule is the larger file."""

    def one(i: int) -> str:
        return task(f"t{i}", unit=f"u{i % 8}", period=f" period='{100 if i else 1000}ms'")

    tasks, names = filled(size // 10, one)
    return model(tasks, [names])


def demands(size: int) -> str:
    """Pairs of tasks, the first without a period, which runs where the second needs it within 100 ms."""

    def one(i: int) -> str:
        need = f"<precedence task='t{i - 1}' from='end' max='100ms'/>" if i % 2 else ""
        return task(f"t{i}", need, unit=f"u{i % 8}", period=" period='1s'" if i % 2 else "")

    tasks, names = filled(size, one)
    return model(tasks, [names])


SHAPES: dict[str, Callable[[int], str]] = {
    "flat": flat, "two modes": two_modes, "fifty modes": fifty_modes, "chains": chains, "precedences": precedences,
    "accesses": accesses, "many jobs": many_jobs, "demands": demands,
}  # fmt: skip


def inputs(folder: Path, words: list[str]) -> list[str]:
    """Return the words of a command that name files to read."""
    return [word for before, word in pairwise(words) if before != "-o" and (folder / word).is_file()]


def verdicts(folder: Path) -> Iterator[bool]:
    """Try each verb with the model in a folder, print a line for each, and say whether it was within the law."""
    found = False
    for verb, words in (MADE | ON_MODELS | ON_SCHEDULES).items():
        if verb in ON_SCHEDULES and not found:
            continue
        read = sum((folder / word).stat().st_size for word in inputs(folder, words.split())) / 1e6
        code, seconds, memory = run(folder, *words.split())
        found = found or (verb in MADE and code == 0)
        lawful = code in range(5) and (verb in MADE or seconds <= max(SECONDS, read)) and memory <= MEBIBYTES
        said = "ok" if lawful else "BREAKS THE LAW"
        print(f"    {verb:28} exit {code:3} {seconds:7.1f} s {memory:6.0f} MiB {read:5.1f} MB read  {said}", flush=True)  # noqa: T201
        yield lawful


def main() -> int:
    """Try every shape, or those that are named."""
    size = int(float(sys.argv[1]) * 1e6) if len(sys.argv) > 1 else 5_000_000
    resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE, PATIENCE))
    lawful = True
    for shape in sys.argv[2:] or SHAPES:
        with tempfile.TemporaryDirectory(prefix="halpipe-large-") as place:
            text = SHAPES[shape](size)
            Path(place, "model.xml").write_text(text)
            print(f"{shape}: {len(text) / 1e6:.1f} MB, {text.count('<task ')} tasks", flush=True)  # noqa: T201
            lawful = all(list(verdicts(Path(place)))) and lawful
    return 0 if lawful else 1


if __name__ == "__main__":
    sys.exit(main())
