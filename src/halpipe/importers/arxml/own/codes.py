"""The diagnostics of reading models that halpipe wrote as ARXML: HAL0590 to HAL0592."""

from halpipe.core.diagnostics import error, warning

SECOND_MODEL = error(
    "HAL0590",
    "Several models of halpipe in one import",
    "A file that `halpipe export arxml` wrote holds a whole model. Models cannot be added to each other.",
)
BESIDE_MODEL = warning(
    "HAL0591",
    "Components beside a model of halpipe",
    "The input holds a whole model that halpipe wrote, which is imported, and component types that do not belong to "
    "it.",
)
EDITED = warning(
    "HAL0592",
    "Exported ARXML was edited",
    "Standard elements carry most of a model; special data groups carry what they round, and what they lack. Where "
    "both disagree, the standard element counts. Where special data cannot be read, they are left out.",
)
