"""DOT text of the dependency graph, built with the graphviz package; labels are HTML-like, so text is escaped."""

from __future__ import annotations

from html import escape
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.records import record
from halpipe.exporters.common.palette import FILLS, INK, RESOURCES, tone
from halpipe.models import Anchor, Match, Mode, Precedence, Schedule, Task, TaskModel, Version

if TYPE_CHECKING:
    from collections.abc import Iterable

    import graphviz

    from halpipe.exporters.graph import GraphOptions

FONT = "Helvetica,Arial,sans-serif"
MANY_UNITS = 4


@record
class _Part:
    """The tasks that are drawn together, with the versions available there; `prefix` keeps node ids apart."""

    prefix: str
    versions: dict[str, tuple[Version, ...]]


def format_graph(model: TaskModel, schedule: Schedule | None, options: GraphOptions) -> str:
    """Return the graph of the whole model, of one mode, or of every mode in a box of its own."""
    import graphviz

    modes = [mode for mode in model.modes if options.mode in ("", mode.name)]
    graph = graphviz.Digraph("tasks", strict=False)
    title = options.title or (f"{model.name}, mode {options.mode}" if options.mode else model.name)
    graph.attr("graph", rankdir="LR", label=_html([f"<b>{escape(title)}</b>"]), labelloc="t", fontname=FONT)
    graph.attr("graph", nodesep="0.35", ranksep="0.9")
    graph.attr("node", shape="box", style="filled,rounded", fontname=FONT, fontsize="11", color=INK, fontcolor=INK)
    graph.attr("edge", fontname=FONT, fontsize="9", color="#444444", fontcolor="#222222")
    colours = _Colours(model, schedule)
    if options.cluster:
        for number, mode in enumerate(modes):
            with graph.subgraph(name=f"cluster_{number}") as box:
                box.attr(label=_html([f"mode {escape(mode.name)}"]), style="rounded", color="#888888")
                _draw(box, model, _part(model, [mode], f"m{number}"), colours)
    else:
        _draw(graph, model, _part(model, modes if options.mode else None, ""), colours)
    colours.draw_legend(graph)
    return str(graph.source)


def _part(model: TaskModel, modes: list[Mode] | None, prefix: str) -> _Part:
    """Return the tasks of `modes`; of the whole model, whatever the modes, for None."""
    if modes is None:
        return _Part(prefix, {task.name: task.versions for task in model.tasks})
    available = {run.task: set(run.versions) for mode in modes for run in mode.runs}
    return _Part(
        prefix,
        {
            task.name: tuple(v for v in task.versions if v.name in available[task.name])
            for task in model.tasks
            if task.name in available
        },
    )


def _draw(graph: graphviz.Digraph, model: TaskModel, part: _Part, colours: _Colours) -> None:
    ids = {task.name: f"{part.prefix}t{number}" for number, task in enumerate(model.tasks)}
    for task in model.tasks:
        if task.name in part.versions:
            shape = {} if task.period else {"shape": "box", "style": "filled,dashed"}
            label = _node_label(task, part.versions[task.name])
            graph.node(ids[task.name], label=label, fillcolor=colours.of(task), **shape)
    steps = _chain_steps(model, part)
    for (before, after), rows in _edges(part).items():
        graph.edge(ids[before], ids[after], label=_html(rows), **_chain_style(steps.pop((before, after), [])))
    for (before, after), chains in steps.items():
        names = _html([f"<i>{escape(model.chains[number].name)}</i>" for number in chains])
        style = _chain_style(chains) | {"style": "dashed"}
        graph.edge(ids[before], ids[after], label=names, **style)


def _node_label(task: Task, versions: Iterable[Version]) -> str:
    facts = [f"every {task.period}" if task.period else "on demand"]
    facts += [f"slack {task.slack * 100}%"] if task.slack and (task.slack * 100).denominator == 1 else []
    rows = [f"<b>{escape(task.name)}</b>", escape(", ".join(facts))]
    for version in versions:
        wcet = "WCET not stated" if version.wcet is None else str(version.wcet)
        gang = f"{version.gang} of " if version.gang > 1 else ""
        text = escape(f"{version.name}: {wcet} on {gang}{_units(version.units)}")
        rows.append(f'<font point-size="9">{text}</font>')
    return _html(rows)


def _html(rows: Iterable[str]) -> str:
    """Return an HTML-like label of lines that are escaped already."""
    return "<" + "<br/>".join(rows) + ">"


def _units(names: tuple[str, ...]) -> str:
    if len(names) <= MANY_UNITS:
        return ", ".join(names) or "no unit"
    return f"{names[0]} … {names[-1]} ({len(names)} units)"


def _edges(part: _Part) -> dict[tuple[str, str], list[str]]:
    """Return the label lines of every precedence edge; a window that not all versions have names those that do."""
    found: dict[tuple[str, str], dict[str, list[str]]] = {}
    for task, versions in part.versions.items():
        for version in versions:
            for precedence in version.precedences:
                if precedence.task in part.versions:
                    windows = found.setdefault((precedence.task, task), {})
                    windows.setdefault(_window(precedence), []).append(version.name)
    return {
        edge: [
            escape(text if len(names) == len(part.versions[edge[1]]) else f"{text} ({', '.join(names)})")
            for text, names in windows.items()
        ]
        for edge, windows in found.items()
    }


def _window(precedence: Precedence) -> str:
    """Return a window as ``end +0..2ms``."""
    low, high = str(precedence.min) if precedence.min else "0", str(precedence.max)
    if low.lstrip("0123456789./") == high.lstrip("0123456789./"):
        low = low.rstrip("nums")
    text = f"{precedence.anchor} +{low}..{high}"
    if precedence.point is not None:
        text = text.replace("point", f"point {precedence.point}", 1)
    until = "" if precedence.to is Anchor.START else f" to {precedence.to}"
    return text + until + ("" if precedence.match is Match.WINDOW else ", same cycle")


def _chain_steps(model: TaskModel, part: _Part) -> dict[tuple[str, str], list[int]]:
    """Return the positions of the chains that go over every pair of tasks, of those chains that run as a whole."""
    steps: dict[tuple[str, str], list[int]] = {}
    for number, chain in enumerate(model.chains):
        if all(name in part.versions for name in chain.tasks):
            for pair in dict.fromkeys(pairwise(chain.tasks)):
                steps.setdefault(pair, []).append(number)
    return steps


def _chain_style(chains: list[int]) -> dict[str, str]:
    if not chains:
        return {}
    colours = ":".join(RESOURCES[number % len(RESOURCES)] for number in chains[: len(RESOURCES)])
    return {"color": colours, "penwidth": "2.4"}


class _Colours:
    """Fills by the units a task may use, or by those it does use where a schedule is given; and their legend."""

    def __init__(self, model: TaskModel, schedule: Schedule | None) -> None:
        self.chains = [chain.name for chain in model.chains]
        self.what = "units a task may use" if schedule is None else "units a task runs on"
        order = {unit.name: number for number, unit in enumerate(model.units)}
        used: dict[str, set[str]] = {task.name: set() for task in model.tasks}
        if schedule is None:
            for task in model.tasks:
                used[task.name].update(unit for version in task.versions for unit in version.units)
        else:
            for job in (job for mode in schedule.modes for job in mode.jobs):
                used[job.task].update(job.units)
        self.sets = {name: tuple(sorted(units, key=lambda u: (order.get(u, -1), u))) for name, units in used.items()}
        self.tones = {units: tone(n) for n, units in enumerate(dict.fromkeys(filter(None, self.sets.values())))}

    def of(self, task: Task) -> str:
        """Return the fill of a task; white where it has no unit."""
        units = self.sets[task.name]
        return FILLS[self.tones[units]] if units else "#ffffff"

    def draw_legend(self, graph: graphviz.Digraph) -> None:
        """Add one node that explains fills and thick edges."""
        rows = [f'<tr><td align="left" colspan="2"><b>{escape(self.what)}</b></td></tr>']
        for units, number in list(self.tones.items())[: len(FILLS)]:
            rows.append(_legend_row(FILLS[number], _units(units)))
        if len(self.tones) > len(FILLS):
            rows.append(_legend_row("#ffffff", f"{len(self.tones) - len(FILLS)} more, in the same colours again"))
        for number, name in enumerate(self.chains):
            rows.append(_legend_row(RESOURCES[number % len(RESOURCES)], f"chain {name}"))
        table = f'<<table border="0" cellspacing="2" cellpadding="2">{"".join(rows)}</table>>'
        graph.node("legend", label=table, shape="plaintext", style="", fontsize="9")


def _legend_row(colour: str, text: str) -> str:
    return f'<tr><td bgcolor="{colour}" width="14"></td><td align="left">{escape(text)}</td></tr>'
