"""Use cases of halpipe, their malfunctions, detection and confidence: ISO 26262-8, clause 11.

TI2: a malfunction can put a fault into the item, or hide one. TD1: it is found or prevented with high confidence, TD2
with medium, TD3 otherwise. TI2 with TD1 is TCL1, with TD2 TCL2, with TD3 TCL3. The level holds with the measure of its
row only.
"""

from __future__ import annotations

from halpipe.core.records import record

LEVELS = {("TI1", degree): "TCL1" for degree in ("TD1", "TD2", "TD3")}
LEVELS |= {("TI2", "TD1"): "TCL1", ("TI2", "TD2"): "TCL2", ("TI2", "TD3"): "TCL3"}


@record
class Use:
    """One use case with the malfunction that matters; `name` is that of the command."""

    name: str
    malfunction: str
    measure: str
    detection: str = "TD2"
    impact: str = "TI2"

    @property
    def level(self) -> str:
        """The tool confidence level."""
        return LEVELS[self.impact, self.detection]


_REVIEW = (
    "review the coverage report (`--report`: elements are mapped, ignored or defaulted), or import with `--strict`"
)
_COMPARE = "compare a recording of the target with the schedule (`halpipe compare`)"
_ROUND_TRIP = "import the file again and `halpipe diff`"

USES = (
    Use("import amalthea", "an element is lost, misread or invented", _REVIEW),
    Use("import arxml", "an element is lost, misread or invented", _REVIEW),
    Use("import ros", "a callback, a period or a flow of data is lost, misread or invented", _REVIEW),
    Use("import table", "a row or a column is lost or misread", _REVIEW),
    Use(
        "import --overlay", "a value is put on the wrong element", "every replaced value is reported; review the report"
    ),
    Use("validate", "a contradiction of the model is not reported", "verify judges the schedule all the same", "TD1"),
    Use("schedule", "a schedule that is not valid", "`halpipe verify` and the second checker on the files", "TD1"),
    Use(
        "schedule --quantise",
        "phases or limits are rounded to the unsafe side",
        "verify against the model as it is",
        "TD1",
    ),
    Use("schedule --freeze", "a shipped job is moved", "`halpipe diff` of both schedules", "TD1"),
    Use(
        "verify",
        "a schedule that is not valid is accepted",
        "the second checker: its own code, but the same project and page of rules (common-causes.md); review the page",
    ),
    Use(
        "explain",
        "a model is called infeasible that is not",
        "the witness, which a person can check; nothing is released",
        impact="TI1",
    ),
    Use("size, sensitivity", "a wrong figure", "schedule and verify the changed model", "TD1"),
    Use("compare", "a deviation of the target is not reported", "inspect the recording with another tool"),
    Use("export amalthea", "the file differs from the schedule", _ROUND_TRIP),
    Use("export arxml", "an expiry point, an offset or a priority is wrong", f"{_ROUND_TRIP}; {_COMPARE}"),
    Use("export btf", "an event is wrong", "`halpipe compare` of the file with the schedule", "TD1"),
    Use("export feo", "an order of the table is not kept", _COMPARE),
    Use("export graph", "the picture misleads", "pictures are no basis of a release", impact="TI1"),
    Use("export launch-manager", "a mode or a recovery action is wrong", "the project's validator and a review"),
    Use("export linux", "the dispatcher plays another table", f"`halpipe deploy check`; {_COMPARE}"),
    Use(
        "export regulator",
        "a budget is larger than the schedule allows",
        "`halpipe deploy check`, which computes it again",
        "TD1",
    ),
    Use("export report", "the page misleads", "verify decides; the page is for people", impact="TI1"),
    Use("export riscv", "the bundle plays another table, or protects less", f"`halpipe deploy check`; {_COMPARE}"),
    Use("export ros", "the package starts something else", _COMPARE),
    Use("export timpani", "a release time, a CPU or a budget is wrong", _COMPARE),
    Use("export trace", "the picture misleads", "pictures are no basis of a release", impact="TI1"),
    Use("export xlsx", "the workbook misleads", "verify decides; the workbook is for people", impact="TI1"),
    Use("deploy check", "a faulty bundle is accepted", _COMPARE),
    Use("run", "a step is left out", "every step is reported; run verify on what was written", "TD1"),
)


def table() -> str:
    """Return the uses as a page."""
    head = "# Tool confidence\n\n" + (__doc__ or "").partition("\n\n")[2].strip()
    rows = (f"| {u.name} | {u.malfunction} | {u.measure} | {u.impact} | {u.detection} | {u.level} |" for u in USES)
    return "\n".join(
        (head, "", "| use | malfunction | measure | TI | TD | TCL |", "|---|---|---|---|---|---|", *rows, "")
    )
