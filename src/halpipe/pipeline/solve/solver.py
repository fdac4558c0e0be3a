"""CP-SAT of OR-Tools, an optional part that is loaded when it is needed."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.util import find_spec, module_from_spec
from types import ModuleType
from typing import Any

from halpipe.pipeline.solve.workers import once


@once
def solver_library() -> Any:
    """Import CP-SAT without pandas, whose types its interface names: that takes a third of a short command."""
    spec = find_spec("ortools.sat.python.cp_model")
    if "pandas" not in sys.modules and spec is not None and spec.loader is not None:
        module = module_from_spec(spec)
        sys.modules["pandas"] = stand_in = ModuleType("pandas")
        vars(stand_in).update({name: type(name, (), {}) for name in ("Index", "Series", "DataFrame")})
        try:
            spec.loader.exec_module(module)
        except (AttributeError, ImportError, TypeError):  # another version, which does more with pandas
            pass
        else:
            return module
        finally:
            del sys.modules["pandas"]
    return import_module("ortools.sat.python.cp_model")
