"""Plants and drivers: the closed loop with the computer, and the calls that a check plans and holds a bundle to."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.core.settings import Fields
from halpipe.deploy.riscv.board.elf import Program, offset_of
from halpipe.deploy.riscv.codes import BROKEN_TARGET
from halpipe.models import Access, AccessKind

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from halpipe.core.bundles import Bundle
    from halpipe.deploy.riscv.target import Site


class Board(Protocol):
    """Access of a plant to the target: the buffers in main memory, and the request for another mode."""

    def read(self, buffer: str) -> bytes:
        """Return what a buffer holds."""
        ...

    def write(self, buffer: str, data: bytes) -> None:
        """Put `data` at the beginning of a buffer, as a sensor's driver does."""
        ...

    def request(self, mode: str) -> None:
        """Ask for another mode; the runtime takes it at the end of the hyperperiod."""
        ...

    def stop(self) -> None:
        """End the run now."""
        ...


class Plant:
    """The world that stands still; real ones override what they need. Instants count from the beginning of the run."""

    def start(self, board: Board) -> None:
        """Prepare the inputs; nothing has been executed yet."""

    def cycle(self, board: Board, now: Duration, cycle: int, table: str) -> None:
        """The `cycle`-th table begins: a mode, or ``a->b``; nothing of it has happened yet."""

    def reads(self, board: Board, now: Duration, buffer: str) -> None:
        """A read phase is about to move `buffer` into a scratchpad; what is written now is what the job sees."""

    def written(self, board: Board, now: Duration, buffer: str) -> None:
        """A write phase has put new bytes into `buffer`."""


class Recorded(Plant):
    """Recorded inputs: the contents of buffers, one for each table that begins, from the first one on again."""

    def __init__(self, samples: Mapping[str, Sequence[bytes]]) -> None:
        self.samples = samples

    def start(self, board: Board) -> None:
        """Put the first of each into its buffer."""
        self.cycle(board, ZERO, 0, "")

    def cycle(self, board: Board, now: Duration, cycle: int, table: str) -> None:
        """Put the next of each into its buffer."""
        for buffer, contents in self.samples.items():
            board.write(buffer, contents[cycle % len(contents)])


INPUTS = "inputs/"


def recorded_inputs(bundle: Bundle, site: Site) -> dict[str, list[bytes]]:
    """Return the recorded contents of buffers; raise `HalpipeError` where one does not fit its buffer."""
    found = {}
    for name in sorted(name for name in bundle.files if name.startswith(INPUTS)):
        buffer, data = name.removeprefix(INPUTS).removesuffix(".bin"), bundle.files[name]
        size = site.buffers[buffer].size if buffer in site.buffers else 0
        if not size or not data or len(data) % size:
            message = f'{len(data)} bytes are no contents of a buffer "{buffer}"'
            raise HalpipeError(BROKEN_TARGET(message, at=bundle.at(name), help=_HELP))
        found[buffer] = [data[at : at + size] for at in range(0, len(data), size)]
    return found


FILE = "drivers.yaml"
REQUEST = "hp_request_mode"
RETURN = (0x8082).to_bytes(2, "little")  # the two bytes that the shortest function has
_HELP = "export the bundle again; edit the file of drivers, not the bundle"


@record
class Driver:
    """A function that is called with a buffer when a phase of `kind` begins or ends, of all tasks or of one."""

    buffer: str
    function: str
    kind: AccessKind
    task: str

    def serves(self, task: str, access: Access) -> bool:
        """Whether it is called in a phase of a task."""
        moves = any(transfer.buffer == self.buffer for transfer in access.transfers)
        return moves and access.kind is self.kind and self.task in ("", task)


@record(kw_only=True)
class PlannedCall:
    """A call of a driver at tick `begin`, with the area of a buffer."""

    driver: Driver
    data: int
    size: int
    begin: int

    @property
    def what(self) -> str:
        """Name in messages."""
        return f'driver {self.driver.function} of buffer "{self.driver.buffer}"'


@record
class Call:
    """A call that was seen, in units of the machine's time."""

    function: str
    data: int
    size: int
    now: int


def read_drivers(bundle: Bundle) -> tuple[Driver, ...]:
    """Return the drivers of a bundle in their order, none if it has no file of them."""
    if FILE not in bundle.files:
        return ()
    findings = Findings()
    top = Fields.sealed(bundle.files[FILE], str(bundle.at(FILE).file), findings, BROKEN_TARGET, _HELP)
    kinds = {"inputs": AccessKind.READ, "outputs": AccessKind.WRITE, "requests": AccessKind.WRITE}
    found = tuple(
        Driver(
            row.text("buffer"),
            REQUEST if key == "requests" else row.text("function"),
            kind,
            row.text("task") if "task" in row else "",
        )
        for key, kind in kinds.items()
        if key in top
        for row in top.items(key)
    )
    findings.stop_on_errors()
    return found


def places(bundle: Bundle, program: Program, drivers: Iterable[Driver]) -> dict[int, str]:
    """Return the functions of drivers by their addresses in the program."""
    names = dict.fromkeys(driver.function for driver in drivers)
    absent = [name for name in names if name not in program.symbols]
    if absent:
        message = f"the program does not define {', '.join(absent)}"
        raise HalpipeError(BROKEN_TARGET(message, at=bundle.at(FILE), help=_HELP))
    return {program.symbols[name][0]: name for name in names}


def without_drivers(program: bytes, addresses: Iterable[int]) -> bytes:
    """Return a program whose drivers return at once, for simulators that have not their devices."""
    changed = bytearray(program)
    for address in addresses:
        at = offset_of(program, address, len(RETURN))
        if at is not None:
            changed[at : at + len(RETURN)] = RETURN
    return bytes(changed)
