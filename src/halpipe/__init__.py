"""halpipe: from vehicle software models to verified time-triggered schedules and what hardware loads.

The whole tool in a few functions; each raises `HalpipeError` with every finding when it cannot go on. What they
take and return are the frozen values of `halpipe.models`. See docs/how-to/use-from-python.md.

    model = halpipe.load("model.xml")
    schedule = halpipe.schedule(model, seed=1)
    assert not halpipe.verify(model, schedule)
    page = halpipe.export("report", model, schedule)[""]
"""

TYPE_CHECKING = False  # as typing has it, which need not be loaded before Ctrl-C is answered
if TYPE_CHECKING:
    from halpipe.api import (
        check,
        compare,
        diff,
        explain,
        export,
        import_model,
        jobs,
        latencies,
        learn,
        load,
        load_schedule,
        save,
        schedule,
        sensitivity,
        size,
        utilisation,
        validate,
        verify,
    )
    from halpipe.core.diagnostics import HalpipeError

__version__ = "0.1.0"

__all__ = [
    "HalpipeError",
    "__version__",
    "check",
    "compare",
    "diff",
    "explain",
    "export",
    "import_model",
    "jobs",
    "latencies",
    "learn",
    "load",
    "load_schedule",
    "save",
    "schedule",
    "sensitivity",
    "size",
    "utilisation",
    "validate",
    "verify",
]


def __getattr__(name: str) -> object:
    """Load the functions when one of them is asked for."""
    if name in __all__:
        from halpipe import api

        return getattr(api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
