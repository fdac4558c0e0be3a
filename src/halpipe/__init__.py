"""halpipe: from vehicle software models to verified time-triggered schedules and what hardware loads.

The whole tool in a few functions; each raises `halpipe.diagnostics.HalpipeError` with every finding when it cannot
go on. What they take and return are the frozen values of `halpipe.models`. See docs/how-to/use-from-python.md.

    model = halpipe.load("model.xml")
    schedule = halpipe.schedule(model, seed=1)
    assert not halpipe.verify(model, schedule)
    page = halpipe.export("report", model, schedule)[""]
"""

from halpipe.api import (
    compare,
    diff,
    explain,
    export,
    import_model,
    jobs,
    latencies,
    load,
    load_schedule,
    loads,
    save,
    schedule,
    sensitivity,
    size,
    validate,
    verify,
)

__version__ = "0.1.0"

__all__ = [
    "__version__",
    "compare",
    "diff",
    "explain",
    "export",
    "import_model",
    "jobs",
    "latencies",
    "load",
    "load_schedule",
    "loads",
    "save",
    "schedule",
    "sensitivity",
    "size",
    "validate",
    "verify",
]
