"""Show a report: a table in Markdown, a plot in SVG, and both on one page."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.core.records import record
from search_benchmark.real import PUBLISHED, Waters2019

if TYPE_CHECKING:
    from collections.abc import Iterator

    from search_benchmark.results import Ratio, Report, RowResult, Spread

_SCALES = (("s", 10**9), ("ms", 10**6), ("us", 10**3), ("ns", 1))
_NONE = "–"

_PLOT_LEFT, _PLOT_WIDTH, _LINE = 330, 620, 34
_TOP, _BOTTOM = 44, 40


RESULTS = "results.json"
NAMES = (RESULTS, "table.md", "plot.svg", "index.html")


def outputs(report: Report) -> dict[str, bytes]:
    """Return the files of a report by name."""
    plot = _render("plot.svg.j2", escape=True, **_plot(report))
    shared = {"report": report, "columns": _columns(report), "table": _table(report), "facts": _facts(report)}
    shared["has_exact"] = _has_exact(report)
    shared["chains"] = _chains(report)
    contents = (
        report.to_json(),
        _render("table.md.j2", escape=False, **shared),
        plot,
        _render("page.html.j2", escape=True, plot=plot, **shared),
    )
    return {name: content.encode() for name, content in zip(NAMES, contents, strict=True)}


def _render(name: str, *, escape: bool, **values: Any) -> str:
    import jinja2

    environment = jinja2.Environment(
        autoescape=escape, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True,
        keep_trailing_newline=True,
    )  # fmt: skip
    source = Path(__file__).with_name("templates").joinpath(name).read_text(encoding="utf-8")
    return environment.from_string(source).render(**values)


# ------------------------------------------------------------------------------------------------ table


def _columns(report: Report) -> list[str]:
    columns = ["sets", "instances", "success", "moves, median", "kernel, median", "kernel, worst"]
    columns += ["whole, median", "whole, worst"]
    if _has_paper(report):
        columns.append("paper (Table III)")
    if _has_gaps(report):
        columns.append("gaps per second, median")
    if _has_goals(report):
        columns += ["goal", "met"]
    if _has_exact(report):
        columns += ["CP-SAT solved", "CP-SAT, median", "CP-SAT : whole, median", "CP-SAT : whole, least"]
    if _has_shop(report):
        columns += ["PyJobShop solved", "PyJobShop, median"]
    return columns


def _table(report: Report) -> list[list[str]]:
    return [list(_cells(report, row)) for row in report.rows]


def _cells(report: Report, result: RowResult) -> Iterator[str]:
    row = result.row
    yield row.name
    yield str(len(result.records))
    yield _percent(result.solved, len(result.records))
    yield _NONE if result.moves is None else str(result.moves.median)
    for spread in (result.kernel_ns, result.whole_ns):
        yield _NONE if spread is None else duration_text(spread.median)
        yield _NONE if spread is None else duration_text(spread.greatest)
    if _has_paper(report):
        yield _NONE if row.paper_seconds is None else "{}..{} s".format(*row.paper_seconds)
    if _has_gaps(report):
        gaps = result.gaps_per_second
        yield _NONE if gaps is None else str(gaps.median)
    if _has_goals(report):
        share = f"{row.goal_success * 100} %"
        goal = row.goal_kernel or (f"{row.goal_whole} in all" if row.goal_whole else None)
        yield share if goal is None else f"{share}, {goal}"
        yield "yes" if result.meets_goal else "no"
    if _has_exact(report):
        yield f"{result.exact_solved} of {result.exact_tried}" if result.exact_tried else _NONE
        yield _NONE if result.exact_ns is None else duration_text(result.exact_ns.median)
        yield _ratio_text(result.median_ratio)
        yield _ratio_text(next(iter(result.ratios), None))
    if _has_shop(report):
        yield f"{result.shop_solved} of {result.shop_tried}" if result.shop_tried else _NONE
        yield _NONE if result.shop_ns is None else duration_text(result.shop_ns.median)


def _has_paper(report: Report) -> bool:
    return any(result.row.paper_seconds for result in report.rows)


def _has_gaps(report: Report) -> bool:
    return any(result.gaps_per_second is not None for result in report.rows)


def _chains(report: Report) -> list[tuple[str, ...]]:
    """Return for every chain of every row its latencies, and the forward latency published for it, if any."""
    return [
        (result.row.name, name, *latencies, str(PUBLISHED.get(name, _NONE)) if _is_waters(result) else _NONE)
        for result in report.rows
        for name, latencies in result.chains.items()
    ]


def _is_waters(result: RowResult) -> bool:
    return any(isinstance(cell, Waters2019) for cell in result.row.cells)


def _has_goals(report: Report) -> bool:
    return any((result.row.goal_kernel or result.row.goal_whole) is not None for result in report.rows)


def _has_exact(report: Report) -> bool:
    return any("exact" in record["timing"] for result in report.rows for record in result.records)


def _has_shop(report: Report) -> bool:
    return any(result.shop_tried for result in report.rows)


def _facts(report: Report) -> list[tuple[str, str]]:
    facts = [(name, str(value)) for name, value in report.about.items() if not isinstance(value, dict)]
    facts += [(name, str(value)) for name, value in report.about.get("machine", {}).items()]
    return [*facts, ("results sha256", report.results_sha256)]


def _percent(part: int, whole: int) -> str:
    tenths = part * 1000 // max(1, whole)
    return f"{tenths // 10} %" if tenths % 10 == 0 else f"{tenths // 10}.{tenths % 10} %"


def _ratio_text(ratio: Ratio | None) -> str:
    return _NONE if ratio is None else f"{'> ' if ratio.is_bound else ''}{ratio.times}"


def duration_text(nanoseconds: int) -> str:
    """Return a measured time with three digits and its unit: ``4.27ms``."""
    unit, scale = next(((u, s) for u, s in _SCALES if nanoseconds >= s), _SCALES[-1])
    digits = 0 if scale == 1 else max(0, 3 - len(str(nanoseconds // scale)))
    hundredth = (nanoseconds * 10**digits + scale // 2) // scale
    whole, part = divmod(hundredth, 10**digits)
    return f"{whole}.{part:0{digits}d}{unit}" if digits else f"{whole}{unit}"


# ------------------------------------------------------------------------------------------------ plot


@record
class _Box:
    """The spread of a sample on the plot: whiskers, quartiles, median."""

    least: str
    low: str
    width: str
    median: str
    greatest: str
    title: str


def _plot(report: Report) -> dict[str, Any]:
    first, last = _decades(report)

    def x(nanoseconds: int) -> float:
        share = (math.log10(max(1, nanoseconds)) - first) / (last - first)
        return _PLOT_LEFT + _PLOT_WIDTH * share

    lines = []
    for number, result in enumerate(report.rows):
        paper = result.row.paper_seconds
        lines.append(
            {
                "name": result.row.name,
                "success": _percent(result.solved, len(result.records)),
                "y": _TOP + number * _LINE,
                "kernel": _box(result.kernel_ns, x, "kernel"),
                "whole": _box(result.whole_ns, x, "whole command"),
                "exact": _box(result.exact_ns, x, "CP-SAT"),
                "paper": paper and _box_between(paper[0] * 10**9, paper[1] * 10**9, x),
            }
        )
    ticks = [(f"{x(10**decade):.1f}", _decade_text(decade)) for decade in range(first, last + 1)]
    height = _TOP + len(lines) * _LINE + _BOTTOM
    return {
        "lines": lines,
        "ticks": ticks,
        "left": _PLOT_LEFT,
        "width": _PLOT_LEFT + _PLOT_WIDTH + 30,
        "height": height,
        "top": _TOP,
        "floor": height - _BOTTOM,
        "has_exact": _has_exact(report),
        "has_paper": _has_paper(report),
        "title": f"benchmark {report.suite}: seconds for a schedule",
    }


def _decades(report: Report) -> tuple[int, int]:
    """Return the powers of ten, in nanoseconds, between which everything lies."""
    values = [10**6, 10**9]
    for result in report.rows:
        for spread in (result.kernel_ns, result.whole_ns, result.exact_ns):
            values += [] if spread is None else [max(1, spread.least), spread.greatest]
        values += [seconds * 10**9 for seconds in result.row.paper_seconds or ()]
    return len(str(min(values))) - 1, len(str(max(values) - 1))


def _box(spread: Spread | None, x: Any, what: str) -> _Box | None:
    if spread is None:
        return None
    low, high = x(spread.low), x(spread.high)
    title = f"{what}: {duration_text(spread.least)} to {duration_text(spread.greatest)}"
    return _Box(
        f"{x(spread.least):.1f}",
        f"{low:.1f}",
        f"{max(1.0, high - low):.1f}",
        f"{x(spread.median):.1f}",
        f"{x(spread.greatest):.1f}",
        f"{title}, median {duration_text(spread.median)}",
    )


def _box_between(low: int, high: int, x: Any) -> tuple[str, str]:
    return f"{x(low):.1f}", f"{x(high) - x(low):.1f}"


def _decade_text(decade: int) -> str:
    unit, scale = next((u, s) for u, s in _SCALES if 10**decade >= s)
    return f"{10**decade // scale} {unit}"
