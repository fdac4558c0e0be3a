"""What a runtime prints and measures on the simulated board: the check finds where that is not so."""

import pytest

from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT, codes
from halpipe.deploy.riscv.board.machine import Budget
from halpipe.deploy.riscv.judge import check
from halpipe.deploy.riscv.judge.calibration import wrong_measurements
from halpipe.deploy.riscv.judge.report import wrong_reports


def test_what_is_printed_is_what_is_recorded(sound):
    assert list(wrong_reports(sound, Budget())) == []


@pytest.mark.parametrize(
    ("what", "instead", "path"),
    [
        ("* 4U)) & 15U;", "* 4U)) & 7U;", "report"),
        ("sizeof(hp_fault) / 8U", "sizeof(hp_record) / 8U", "report"),
        pytest.param("count = CONTROL->faults;", "count = CONTROL->traced;", "report", marks=pytest.mark.slow),
        ("{APPLICATION_EXIT, status}", "{APPLICATION_EXIT, 1U}", "exit"),
        ("first = count - capacity;", ";", "report"),
        pytest.param("text[i] != '\\0'; i++", "text[0] != '\\0'; i++", "", marks=pytest.mark.slow),
    ],
)
def test_a_console_that_prints_something_else_is_found(mutant, what, instead, path):
    found = list(wrong_reports(mutant("console.c", what, instead), Budget(calls=10**6)))
    assert {d.code for d in found} == {codes.TRACE_DISAGREES.id if path else codes.SPENT.id}
    assert all(d.path == path for d in found)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("profile", "what"),
    [
        ("vcu118", "(*transmit & 0x80000000U) != 0U"),
        ("virt", "(registers[LINE_STATUS] & LINE_EMPTY) == 0U"),
        ("mpfs", "registers[LINE_STATUS]"),
    ],
)
def test_a_console_that_does_not_wait_for_the_line_is_found(mutant, export, profile, what):
    assert list(wrong_reports(export(profile=profile), Budget())) == []
    instead = "registers[0]" if profile == "mpfs" else "HP_CONTROL == 0U"
    found = list(wrong_reports(mutant("console.c", what, instead, profile=profile), Budget(calls=10**6)))
    assert found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "instead", "profile"),
    [("0x5555U", "0x5556U", "virt"), ("slli x0, x0, 0x1f", "slli x0, x0, 0x20", "vcu118")],
)
def test_an_end_that_no_emulator_takes_is_found(mutant, what, instead, profile):
    found = wrong_reports(mutant("console.c", what, instead, profile=profile), Budget(traps=1000))
    assert (codes.TRACE_DISAGREES.id, "exit") in {(d.code, d.path) for d in found}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "what", "instead"),
    [
        ("start.S", "sd t2, 136(t1)", "sd t2, 137(t1)"),
        ("monitor.c", "mailbox()->ready = has_user_mode();", "mailbox()->ready = 1U;"),
    ],
)
def test_a_runtime_that_does_not_tell_why_it_stops_is_found(mutant, file, what, instead):
    found = list(wrong_reports(mutant(file, what, instead), Budget(traps=1000)))
    assert [(d.code, d.path) for d in found] == [(codes.TRACE_DISAGREES.id, "state")]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "what", "instead", "code"),
    [
        ("monitor.S", "csrc mstatus, t0", "nop", codes.OPEN_CORE),  # after an interrupt in machine mode
        ("monitor.c", "box->status = FLAG_OVERRUN;", "box->status = FLAG_FAULT;", codes.TRACE_DISAGREES),
    ],
)
def test_a_monitor_whose_job_is_overdue_when_it_begins(mutant, file, what, instead, code):
    found = list(wrong_reports(mutant(file, what, instead), Budget(traps=1000)))
    assert {d.code for d in found} == {code.id}


@pytest.mark.slow
def test_a_calibrating_bundle_that_measures_nothing_is_found(mutant):
    target = mutant("runtime.c", "    calibrate();\n", "", calibrate=True)
    found = {d.code for d in DEPLOYMENT.check(target, CheckOptions(inject="none")).diagnostics if d.is_error}
    assert codes.NO_CALIBRATION.id in found


@pytest.mark.parametrize(
    ("what", "instead", "said"),
    [
        ("    traced++;", "    traced--;", "records"),
        ("boxes[o->unit]->restart = 1U;\n            fence();", "boxes[o->unit]->restart = 1U;", "without a fence"),
        pytest.param("box->request + 1U;\n        fence();", "box->request + 1U;", "without", marks=pytest.mark.slow),
        ("uint32_t is_trap = 0U;", "uint32_t is_trap = 1U;", "did not trap"),
        pytest.param("        fence();\n        at->begin", "        at->begin", "without", marks=pytest.mark.slow),
        pytest.param("((now + 1U) << 2U)", "((now + 3U) << 2U)", "sleeps", marks=pytest.mark.slow),
    ],
)
def test_a_runtime_that_only_other_machines_or_rings_would_show_is_found(mutant, what, instead, said):
    rules = '    <rule task="act" on="fault" count="1" cycles="1" action="restart"/>'
    change = lambda text: text.replace("</task-model>", f"  <health>\n{rules}\n  </health>\n</task-model>")  # noqa: E731
    found = DEPLOYMENT.check(mutant("runtime.c", what, instead, change=change), CheckOptions()).diagnostics
    assert any(said in d.message for d in found if d.is_error)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "what", "instead", "said"),
    [
        ("calibrate.c", "    CALIBRATION->count = 0U;\n", "", "are missing"),
        ("calibrate.c", "(box->end - box->begin)", "(box->end - box->begin) * 2U", "cycles (jobs)"),
        ("calibrate.c", "note(kind, (state == DMA_IDLE) ? size : 0U,", "note(kind, 2U * size,", "bandwidth (ispm)"),
    ],
)
def test_a_runtime_that_measures_something_else_is_found(mutant, file, what, instead, said):
    target = mutant(file, what, instead, calibrate=True)
    (tour,) = check.tours(target.schedule, 2)
    found = list(wrong_measurements(target, check.simulate(target, tour).run))
    assert {d.code for d in found} == {codes.NO_CALIBRATION.id}
    assert said in " ".join(d.message for d in found)
