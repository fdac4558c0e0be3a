"""Elements that are almost ones which the importer reads: misspelt, in another case, or without their name."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Location
from halpipe.importers.arxml import codes

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Findings
    from halpipe.importers.arxml.files.sniff import Document

# Elements that need a SHORT-NAME to have an effect, and the lists that hold them.
NAMED = (
    "APPLICATION-SW-COMPONENT-TYPE",
    "ASSEMBLY-SW-CONNECTOR",
    "BACKGROUND-EVENT",
    "BSW-INTERNAL-BEHAVIOR",
    "BSW-MODULE-DESCRIPTION",
    "BSW-SCHEDULABLE-ENTITY",
    "BSW-TIMING-EVENT",
    "COMPOSITION-SW-COMPONENT-TYPE",
    "DATA-RECEIVED-EVENT",
    "DELEGATION-SW-CONNECTOR",
    "ECU-INSTANCE",
    "ECUC-CONTAINER-VALUE",
    "ECUC-MODULE-CONFIGURATION-VALUES",
    "EOC-EVENT-REF",
    "EOC-EXECUTABLE-ENTITY-REF",
    "EOC-EXECUTABLE-ENTITY-REF-GROUP",
    "EXECUTION-ORDER-CONSTRAINT",
    "LATENCY-TIMING-CONSTRAINT",
    "MACHINE",
    "MODE-DECLARATION",
    "MODE-DECLARATION-GROUP",
    "MODE-DECLARATION-GROUP-PROTOTYPE",
    "OFFSET-TIMING-CONSTRAINT",
    "PERIODIC-EVENT-TRIGGERING",
    "PROCESS",
    "PROCESSOR",
    "PROCESSOR-CORE",
    "RUNNABLE-ENTITY",
    "SPORADIC-EVENT-TRIGGERING",
    "SW-COMPONENT-PROTOTYPE",
    "SWC-INTERNAL-BEHAVIOR",
    "TD-EVENT-SWC-INTERNAL-BEHAVIOR",
    "TIMING-DESCRIPTION-EVENT-CHAIN",
    "TIMING-EVENT",
    "VARIABLE-ACCESS",
)
_LISTS = (
    "AR-PACKAGE",
    "AR-PACKAGES",
    "COMPONENTS",
    "CONNECTORS",
    "CONTAINERS",
    "DATA-READ-ACCESSS",
    "DATA-WRITE-ACCESSS",
    "ELEMENTS",
    "EVENTS",
    "EXECUTION-TIMES",
    "INTERNAL-BEHAVIORS",
    "MODE-DECLARATIONS",
    "ORDERED-ELEMENTS",
    "PARAMETER-VALUES",
    "PERIOD",
    "REFERENCE-VALUES",
    "RUNNABLES",
    "SHORT-NAME",
    "START-ON-EVENT-REF",
    "STARTS-ON-EVENT-REF",
    "SUB-CONTAINERS",
    "SUCCESSOR-REF",
    "SUCCESSOR-REFS",
    "TIMING-DESCRIPTIONS",
    "TIMING-REQUIREMENTS",
    "TYPE-TREF",
)
KNOWN = frozenset((*NAMED, *_LISTS))
# Elements of AUTOSAR that are one slip away from those above, and no slips.
_OTHERS = frozenset({"TYPE-IREF", "TYPE-REF"})
_LETTERS = "ABCDEFGHIJKLMNOPQRSTUVWXYZ-_"


def report_misspelt(document: Document, namespace: str, findings: Findings) -> None:
    """Report every tag of a file that is one slip away from one that is read, at its first use."""
    for tag in document.tags:
        space, _, name = tag.rpartition("}")
        meant = _meant(name)
        if meant or space.lstrip("{") != namespace:
            why = "" if meant else f' of the namespace "{space.lstrip("{")}"'
            found = list(document.root.iter(tag))
            findings.add(
                codes.UNKNOWN_ELEMENT(
                    f'the element "{name}"{why} is not read, {len(found)} in all',
                    at=Location(document.name, found[0].sourceline or 0),
                    help=f"did you mean {meant}?" if meant else f"put them into {namespace}",
                )
            )


@lru_cache(maxsize=4096)  # thousands of files use the same few hundred tags
def _meant(name: str) -> str:
    """Return the known tag that `name` is a slip of, empty if it is one itself or resembles none."""
    if name in KNOWN or name in _OTHERS:
        return ""
    folded = name.upper().replace("_", "-")
    if folded in KNOWN:
        return folded
    if name.rstrip("S") in KNOWN or f"{name}S" in KNOWN:
        return ""  # plural and singular are elements of their own
    return next((near for near in _neighbours(folded) if near in KNOWN), "")


def _neighbours(word: str) -> Iterator[str]:
    """Yield every word that is one letter left out, put in, replaced or exchanged with the next away."""
    for index in range(len(word) + 1):
        head, tail = word[:index], word[index:]
        if tail:
            yield head + tail[1:]
        if len(tail) > 1:
            yield head + tail[1] + tail[0] + tail[2:]
        for letter in _LETTERS:
            yield head + letter + tail
            if tail:
                yield head + letter + tail[1:]
