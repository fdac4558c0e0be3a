"""Diagnostics of ARXML files that halpipe exported: HAL0590 to HAL0592."""

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
    "An exported file holds the native model once, with a hash of the standard elements. Where these were changed "
    "since, they are imported, as of any other tool: what AUTOSAR rounds or lacks is then lost.",
)
