"""Reference bases: the packages in which relative references of a package, and of those inside it, begin."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, Location
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.words import NS, path_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lxml import etree

    from halpipe.importers.arxml.files.sniff import Document


class Bases:
    """The bases of all files by package and label, which is empty for the default base of a package."""

    def __init__(self, documents: Sequence[Document], findings: Findings) -> None:
        self._findings = findings
        self._known: dict[tuple[str, str], tuple[tuple[str, str], Location]] = {}
        for document in documents:
            for base in document.root.iter(NS + "REFERENCE-BASE"):
                self._add(base, Location(document.name, base.sourceline or 0))

    def _add(self, base: etree._Element, at: Location) -> None:
        """Enter the package of a base, with the base that the path of this package is relative to."""
        holder, ref = path_of(base), base.find(NS + "PACKAGE-REF")
        if _is_true(base, "BASE-IS-THIS-PACKAGE"):
            target = holder, ""
        elif ref is not None and _path(ref):
            target = _path(ref), (ref.get("BASE") or "").strip()
        else:
            return
        label = (base.findtext(NS + "SHORT-LABEL") or "").strip()
        for each in (label, "") if _is_true(base, "IS-DEFAULT") else (label,):
            known, where = self._known.setdefault((holder, each), (target, at))
            if known != target:
                what = f'reference base "{each}"' if each else "default reference base"
                message = f'{what} is "{target[0]}" here, but "{known[0]}" at {where}'
                help = "import one of the two, or make them agree"
                self._findings.report(codes.CONFLICT, message, at=at, path=holder, help=help)

    def absolute(self, ref: etree._Element, holder: str | None = None) -> tuple[str, str]:
        """Return the path of a reference, and how it is written if that is relative; `holder` is where it stands."""
        path = _path(ref)
        if not path or path.startswith("/"):
            return path, ""
        label = (ref.get("BASE") or "").strip()
        package = self._package(path_of(ref) if holder is None else holder, label)
        return f"{package}/{path}", f'"{path}" of the {f"base {label}" if label else "default base"}'

    def _package(self, holder: str, label: str) -> str:
        """Return the package that a label stands for: what the nearest package round `holder` that knows it says."""
        while holder:
            outer = holder.rpartition("/")[0]
            if (holder, label) in self._known:
                (target, base), _ = self._known[holder, label]
                return target if target.startswith("/") else f"{self._package(outer, base)}/{target}"
            holder = outer
        return ""


def _path(ref: etree._Element) -> str:
    return "".join((ref.text or "").split())


def _is_true(element: etree._Element, tag: str) -> bool:
    return (element.findtext(NS + tag) or "").strip() in ("true", "1")
