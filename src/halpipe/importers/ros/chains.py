"""Named paths of CARET as cause-effect chains of tasks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.importers.ros import codes
from halpipe.models import Chain, Origin

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.core.diagnostics import Findings
    from halpipe.importers.common.base import Coverage
    from halpipe.importers.ros.activation import Activations, Wiring
    from halpipe.importers.ros.names import Names
    from halpipe.importers.ros.sources.graph import Path, Step


def chains_of(
    wiring: Wiring,
    activations: Activations,
    task_names: Mapping[str, str],
    names: Names,
    findings: Findings,
    coverage: Coverage,
) -> tuple[Chain, ...]:
    """Return a chain for every path whose nodes are tasks; its ends may be sources or sinks without one."""
    chains: list[Chain] = []
    first: dict[tuple[str, ...], str] = {}
    for path in wiring.graph.paths:
        sequence = [name for step in path.steps for name in _callbacks(step, wiring, activations)]
        problem, tasks = _tasks(sequence, task_names)
        if not problem and tasks in first:
            problem = f'has the same tasks as path "{first[tasks]}"'
        elif problem:
            help = "give its callbacks periods, or write the chain in the overlay"
            findings.add(
                codes.PATH_IGNORED(f"is no chain: {problem}", at=path.at, path=named("path", path.name), help=help)
            )
        if problem:
            coverage.ignored("path", path.name, problem, path.at)
            continue
        first[tasks] = path.name
        coverage.mapped("path")
        chains.append(_chain(path, tasks, names))
    return tuple(chains)


def _chain(path: Path, tasks: tuple[str, ...], names: Names) -> Chain:
    name = names.unique(path.name or "path", f'path "{path.name}"', path.at)
    return Chain(name=name, tasks=tasks, origin=Origin(path.at.file, path.at.line, path.name))


def _callbacks(step: Step, wiring: Wiring, activations: Activations) -> list[str]:
    """Return the callbacks that a message passes in a node: the one that reads it and the one that publishes.

    A reader that is stated to publish the topic itself does so; otherwise it leaves the message for the publisher.
    """
    reading = [
        callback.name
        for callback in map(wiring.callbacks.__getitem__, wiring.readers(step.subscribed or ""))
        if callback.node == step.node
    ]
    publishing = [
        name
        for publication in wiring.publications.get(step.published or "", ())
        if publication.node == step.node
        for name in publication.callbacks
    ]
    publishing = [name for name in publishing if name in reading] or sorted(
        publishing, key=lambda name: activations.of[name].order if name in activations.of else len(wiring.callbacks)
    )
    sides = [side[0] for side in (reading, publishing) if side]
    return list(dict.fromkeys(sides)) or [step.node]


def _tasks(sequence: list[str], task_names: Mapping[str, str]) -> tuple[str, tuple[str, ...]]:
    """Return the tasks of a sequence of callbacks, or what prevents a chain."""
    tasks = [task_names.get(name, "") for name in sequence]
    while tasks and not tasks[0]:
        tasks.pop(0)
        sequence = sequence[1:]
    while tasks and not tasks[-1]:
        tasks.pop()
    if "" in tasks:
        return f'"{sequence[tasks.index("")]}" on it is not a task', ()
    repeated = next((task for task in tasks if tasks.count(task) > 1), None)
    if repeated:
        return f'it passes through "{repeated}" more than once', ()
    if len(tasks) < 2:
        return f"{len(tasks)} of its nodes are tasks, a chain needs two", ()
    return "", tuple(tasks)
