"""``halpipe deploy``: from a bundle to what it does on its target."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.app import Group
from halpipe.cli.options import ModelFile, Output, reads, takes
from halpipe.core.diagnostics import Exit
from halpipe.core.options import Values
from halpipe.core.quantities import parse_address
from halpipe.core.suggest import counted
from halpipe.deploy.base import CheckOptions

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.exporters.riscv.prepare import Prepared

app = typer.Typer(
    cls=Group, no_args_is_help=True, rich_markup_mode=None, help="Prepare models for a target, and check bundles."
)


def prepare(model: ModelFile, output_file: Output, options: Values) -> int:
    """Compile the tasks, and give each version a load phase, and memory phases long enough, for a RISC-V target."""
    from pathlib import Path

    from halpipe.core.files import STDIO, refuse_name, write_beside, write_output
    from halpipe.exporters.native import format_model
    from halpipe.exporters.riscv import PrepareOptions
    from halpipe.flow.formats import prepare_model
    from halpipe.importers.native import read_model

    refuse_name(output_file, ".xml")
    chosen = PrepareOptions(**options)
    prepared = prepare_model(read_model(model), chosen.target, dummy=chosen.dummy)
    output.report(prepared.diagnostics)
    document = format_model(prepared.model)
    if output_file == STDIO:
        if prepared.files:
            raise typer.BadParameter("--dummy writes a source file beside the model; name a file", param_hint="-o")
        write_output(STDIO, document)
        return Exit.OK
    beside = Path(chosen.sources) if chosen.sources else Path(output_file).parent
    further = {str(beside / name): text for name, text in prepared.files.items()}
    write_beside({output_file: document, **further}, output_file)
    output.inform(f"{output_file}: {_what(prepared)}")
    return Exit.OK


app.command("prepare")(takes("halpipe.exporters.riscv:PrepareOptions")(prepare).made())


def _what(prepared: Prepared) -> str:
    grown = sum(found.code == "HAL0864" for found in prepared.diagnostics)
    return f"longer phases now: {counted(grown, 'version')}" if grown else "all phases are long enough"


def check(
    bundle: Annotated[str, typer.Argument(metavar="BUNDLE", help="Folder that an export wrote.")],
    options: Values,
    trace: Annotated[str, typer.Option(metavar="FILE", help="Write the executions that were seen (CSV).")] = "",
    bandwidth: Annotated[
        str, typer.Option(metavar="FILE", help="Write what memory phases are promised, granted and use (CSV).")
    ] = "",
) -> int:
    """Play a bundle and compare what runs with its schedule; any deviation is an error."""
    from halpipe.core.files import refuse_name, write_beside
    from halpipe.flow.formats import check_bundle

    if trace and trace == bandwidth:
        raise typer.BadParameter("give another file than for --trace", param_hint="--bandwidth")
    for file in (trace, bandwidth):
        refuse_name(file, ".csv")
    checked = check_bundle(bundle, CheckOptions(**options))
    for line in checked.lines:
        output.result(line)
    output.report(checked.diagnostics)
    wanted = _traces(trace, checked.files) if trace else {}
    if bandwidth:
        wanted[bandwidth] = _phases(bundle, checked.files)
    if wanted:
        write_beside(wanted, trace, bandwidth)
    return Exit.FINDINGS if any(found.is_error for found in checked.diagnostics) else Exit.OK


app.command("check")(takes("halpipe.deploy.base:CheckOptions")(check).made())


Base = Annotated[
    int | None, reads(parse_address, metavar="ADDRESS", help="Address of a binary dump; by default main memory's.")
]


def trace(
    bundle: Annotated[str, typer.Argument(metavar="BUNDLE", help="Folder that an export wrote.")],
    memory: Annotated[
        str, typer.Argument(metavar="DUMP", help="Memory after a run, binary or as a debugger prints it.")
    ],
    output_file: Output,
    base: Base = None,
) -> int:
    """Read what the runtime of a RISC-V bundle recorded on a board, and write the jobs as a trace for `compare`."""
    from halpipe.core.files import read_bytes, write_output
    from halpipe.deploy.riscv.judge.board import board_trace
    from halpipe.deploy.riscv.run.recording import read_board
    from halpipe.flow.formats import open_target

    target = open_target(bundle)
    recording = read_board(target.bundle, read_bytes(memory), memory, base)
    content, lines = board_trace(target, recording, memory)
    write_output(output_file, content)
    for line in lines:
        output.inform(line)
    return Exit.OK


app.command("trace")(takes()(trace).made())


def calibrate(
    bundle: Annotated[str, typer.Argument(metavar="BUNDLE", help="Folder that export riscv --calibrate wrote.")],
    memory: Annotated[
        str, typer.Argument(metavar="RESULT", help="Memory after its run, as for trace, or what the runtime printed.")
    ],
    output_file: Output,
    base: Base = None,
) -> int:
    """Write a target profile with the bandwidths, times and cycles that a bundle measured on its target."""
    from halpipe.core.files import read_bytes, refuse_name, write_output
    from halpipe.deploy.riscv.judge.calibration import calibrate as constants
    from halpipe.flow.formats import open_target

    refuse_name(output_file, ".yaml")
    content, lines = constants(open_target(bundle), read_bytes(memory), memory, base)
    write_output(output_file, content)
    for line in lines:
        output.inform(line)
    return Exit.OK


app.command("calibrate")(takes()(calibrate).made())


def _traces(file: str, files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the traces of a check: the first as `file`, further ones beside it."""
    return {_beside(file, n.removeprefix("trace")): content for n, content in files.items() if n.startswith("trace")}


def _phases(bundle: str, files: Mapping[str, bytes]) -> bytes:
    """Return the memory phases of a check; it is wrong to ask for them where no regulators were played."""
    if "bandwidth" not in files:
        text = f"{bundle} was not played with regulators that grant bytes in windows: export riscv --regulator"
        raise typer.BadParameter(text, param_hint="--bandwidth")
    return files["bandwidth"]


def _beside(file: str, suffix: str) -> str:
    """Return the name of a further file: ``seen-2.csv`` beside ``seen.csv``."""
    from pathlib import Path

    return str(Path(file).with_stem(Path(file).stem + suffix)) if suffix else file
