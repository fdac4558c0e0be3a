"""How long transfers take behind a regulator: as the Verilog of its gate says, to the cycle."""

import random
import shutil
import subprocess
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.deploy.riscv.board.bus import Bus, Opening
from halpipe.deploy.riscv.board.devices import Transfer
from halpipe.deploy.riscv.board.hart import NEVER
from halpipe.exporters import regulator

GATE = Path(regulator.__file__).parent / "table/rtl/halpipe_regulator_gate.v"
BENCH = Path(__file__).parent / "gate_bench.v"
BURST, BEAT, WIDTH = 64, 8, 40


@dataclass(frozen=True)
class Listed:
    """A gate with a budget for each window of 40 cycles; none after the last."""

    budgets: tuple[int, ...]
    burst: int = BURST
    beat: int = BEAT
    overshoot: int = 0

    def openings(self, since):
        for number, budget in enumerate(self.budgets):
            if budget and (number + 1) * WIDTH > since:
                yield Opening(Fraction(number * WIDTH), Fraction((number + 1) * WIDTH), budget)


def take(bus, begin, size, gate=None, bandwidth=BEAT):
    moved = Transfer(0, 0, 0, size, begin, begin)
    bus.take(moved, begin, bandwidth, gate)
    return moved


def drawn(seed):
    """Budgets of 0 to 6 bursts, and transfers that begin when the one before them is over, or later."""
    rng = random.Random(seed)
    budgets = tuple(BURST * rng.choice((0, 0, 1, 1, 2, 3, 6)) for _ in range(60))
    return budgets, [(rng.randrange(3 * WIDTH), rng.randrange(1, 90 * BEAT)) for _ in range(12)]


def ends_on_the_bus(budgets, transfers):
    bus, gate, now, ends = Bus(rate=1), Listed(budgets), 0, []
    for pause, size in transfers:
        moved = take(bus, now + pause, size, gate)
        if moved.end == NEVER:
            break
        now = moved.end
        ends.append(now)
    return ends


def ends_in_verilog(budgets, transfers, folder):
    folder.joinpath("budgets.hex").write_text("\n".join(f"{budget:x}" for budget in budgets))
    folder.joinpath("transfers.hex").write_text("\n".join(f"{pause:x} {size:x}" for pause, size in transfers))
    counts = [f"+windows={len(budgets)}", f"+transfers={len(transfers)}"]
    done = subprocess.run(
        ["vvp", "bench", *counts], cwd=folder, capture_output=True, text=True, check=True, timeout=300
    )
    return [int(line) for line in done.stdout.split()]


@pytest.mark.skipif(not shutil.which("iverilog"), reason="apt install iverilog")
def test_transfers_end_when_the_verilog_of_the_gate_says(tmp_path):
    subprocess.run(["iverilog", "-o", tmp_path / "bench", BENCH, GATE], check=True, timeout=300)
    finished = 0
    for seed in range(20):
        budgets, transfers = drawn(seed)
        ends = ends_on_the_bus(budgets, transfers)
        assert ends == ends_in_verilog(budgets, transfers, tmp_path), seed
        finished += len(ends)
    assert finished > 100


def test_a_transfer_is_held_back_by_what_it_waits_for():
    moved = take(Bus(rate=1), 35, 3 * BURST, Listed((BURST, 0, 2 * BURST)))
    # 8 cycles for the first burst from 35 on, the other two in the third window
    assert (moved.end, moved.held) == (80 + 16, 96 - 35 - 24)


def test_a_partial_beat_costs_a_whole_one():
    """61 and 3 bytes are a burst together, and nine beats: the budget of a burst covers eight."""
    bus, gate = Bus(rate=1), Listed((BURST, BURST))
    first = take(bus, 0, 61, gate)
    second = take(bus, first.end, 3, gate)
    assert (first.end, second.end) == (8, WIDTH + 1)


def test_the_first_budget_is_spent_once():
    bus, gate = Bus(rate=1), Listed((2 * BURST, BURST))
    first = take(bus, 0, BURST + 8, gate)
    second = take(bus, first.end, BURST, gate)
    assert (first.end, second.end) == (9, WIDTH + 8)


def test_a_gate_that_stays_shut_lets_nothing_end():
    moved = take(Bus(rate=1), 0, BURST, Listed((0, 0)))
    assert (moved.end, moved.held) == (NEVER, NEVER)


def test_what_is_on_its_way_ends_by_the_budgets_that_come():
    @dataclass(eq=False)
    class Changing:
        budgets: tuple[int, ...]
        burst: int = BURST
        beat: int = BEAT
        overshoot: int = 0

        def openings(self, since):
            return Listed(self.budgets).openings(since)

    bus, gate = Bus(rate=1), Changing((BURST, BURST))
    moved = take(bus, 0, 2 * BURST, gate)
    assert moved.end == WIDTH + 8
    gate.budgets = (BURST, 0, 0, BURST)
    bus.replan(WIDTH // 2)
    assert moved.end == 3 * WIDTH + 8
    bus.replan(moved.end)  # it is over
    assert moved.end == 3 * WIDTH + 8


def test_an_overshoot_lets_one_more_burst_begin():
    moved = take(Bus(rate=1), 0, 3 * BURST, Listed((BURST + 8, 0, BURST), overshoot=BURST))
    assert moved.end == 80 + 8


def test_without_a_gate_only_the_rate_counts():
    moved = take(Bus(rate=3), 5, 1000, bandwidth=7)
    assert (moved.end, moved.held) == (5 + 429, 0)  # 3000 / 7 = 428.6


def test_channels_share_the_bus_in_equal_parts():
    """10 bytes in a unit of time for all: first 8 alone, then 5 each, then 3 of the slow one and 7, then 7 alone."""
    bus = Bus(rate=1, capacity=10)
    first = take(bus, 0, 80)
    assert first.end == 10
    second = take(bus, 5, 50)
    assert (first.end, second.end) == (5 + 8, 5 + 8 + 2)  # 40 bytes at 5; then 10 bytes at 8
    third = take(bus, 13, 30, bandwidth=3)
    assert (second.end, third.end) == (13 + 2, 13 + 10)
    assert (first.held, second.held, third.held) == (3, 4, 0)


def test_a_transfer_that_waits_leaves_the_bus_to_others():
    bus = Bus(rate=1, capacity=10)
    waits = take(bus, 0, 2 * BURST, Listed((BURST, BURST)))
    moves = take(bus, 0, 240)
    # 64 bytes each at 5 until 12.8, then the other alone at 8 until 34.8
    assert (waits.end, moves.end) == (WIDTH + 8, 35)


@given(st.lists(st.tuples(st.integers(0, 60), st.integers(1, 300), st.integers(1, 12)), min_size=1, max_size=6))
def test_sharing_loses_no_byte_and_exceeds_nothing(wanted):
    """Nobody is over earlier than alone, all no earlier than the bus allows, and where it suffices none waits."""
    bus, moved = Bus(rate=1, capacity=12), []
    for begin, size, bandwidth in sorted(wanted):
        moved.append((begin, size, bandwidth, take(bus, begin, size, bandwidth=bandwidth)))
    for begin, size, bandwidth, each in moved:
        assert each.end >= begin - (-size // bandwidth)
    until = max(each.end for *_, each in moved)
    first = min(begin for begin, *_ in moved)
    assert sum(size for _, size, _, _ in moved) <= 12 * (until - first)
    alone = len(moved) == 1 or sum(bandwidth for _, _, bandwidth, _ in moved) <= 12
    if alone:
        assert all(each.held == 0 for *_, each in moved)
