"""Every diagnostic of the overlay: HAL0701 to 0709 its form, 0710 to 0719 its meaning, 0720 to 0729 what it changed."""

from __future__ import annotations

from halpipe.core.diagnostics import error, note, warning

NOT_AN_OVERLAY = error(
    "HAL0701",
    "File is no overlay",
    'An overlay is a YAML mapping whose first key is "halpipe-overlay: 1", the version of the format.',
)
DUPLICATE = error(
    "HAL0706",
    "Overlay states an element twice",
    "Two units, resources, chains or transitions of one file have the same name. A later file may replace them.",
)
MATCHES_NOTHING = error(
    "HAL0710",
    "Overlay entry matches nothing",
    "No imported element has the name or fits the glob. Most often the name is misspelt, or the source was renamed.",
)
UNKNOWN_NAME = error(
    "HAL0711",
    "Overlay names an unknown element",
    "A value refers to a task, version, unit, resource or mode that neither the source nor the overlay has.",
)
NAMES_DROPPED = error(
    "HAL0712",
    "Overlay names a dropped task",
    "A mode, chain or precedence constraint of the overlay refers to a task that the overlay itself drops.",
)
DOES_NOT_FIT = error(
    "HAL0713",
    "Values do not fit together",
    "Each value is in its range, but not in view of another one: an access phase ends after the WCET, or a gang is "
    "larger than the version's set of units.",
)
MOVED_INSIDE = warning(
    "HAL1422",
    "Overlay changes a job, but not what lies inside it",
    "Access phases, critical sections, preemption points and triggers lie at positions of the execution, which follow "
    "from the times of the source. With another WCET they are elsewhere, and a version of the overlay has only those "
    "that the overlay states, so a lock may be held outside of its phase.",
)
OVERRIDDEN = note(
    "HAL0720",
    "Value of the source was replaced",
    "The source states a value and the overlay another one; the overlay wins. Both are given.",
)
REPLACED = note(
    "HAL0721",
    "Part of the imported model was replaced",
    "The overlay states its own platform, modes, transitions or chain, and the imported ones gave way.",
)
REMOVED = note(
    "HAL0722",
    "Imported element was removed",
    "An imported chain, constraint or transition refers to a task or mode that the overlay removed, and went with it.",
)
