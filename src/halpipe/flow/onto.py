"""A schedule put onto the project that its model was imported from: read again, verified, and written beside it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings
from halpipe.core.files import find_inputs, read_bytes
from halpipe.pipeline.checked import refuse_invalid

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.exporters.arxml.onto import Onto
    from halpipe.importers.arxml.options import ArxmlImportOptions
    from halpipe.models import Schedule, TaskModel


WITHOUT_ONTO = "export a configuration of its own, without --onto, or schedule without split"


def export_onto(
    model: TaskModel,
    schedule: Schedule,
    directory: str,
    options: ArxmlImportOptions,
    definitions: Sequence[str] = (),
) -> Onto:
    """Return delta, changed files and list of changes; raise `HalpipeError` with all reasons not to make them.

    What is added has to fit the `definitions` of modules (files), or those that the project has itself.
    """
    from dataclasses import replace

    from halpipe.exporters.arxml.definitions import check, read_definitions
    from halpipe.exporters.arxml.onto.export import put_onto
    from halpipe.exporters.common.selection import refuse_early_phases, select
    from halpipe.importers.arxml.project import read_project

    refuse_invalid(model, schedule)
    chosen = select(model, schedule, "", "arxml")
    refuse_early_phases(model, chosen, "the OsTasks of the project do not wait for them", WITHOUT_ONTO)
    findings = Findings()
    project = read_project([directory], model, options, findings)
    files = {
        name: (str(Path(name).relative_to(directory)) if Path(directory).is_dir() else Path(name).name, name)
        for name in find_inputs([directory], (".arxml", ".xdm"))
    }
    contents = _Contents(files)
    onto = put_onto(model, chosen, project, contents)
    paths = definitions or project.definitions
    if paths:
        findings.extend(check(onto.additions, read_definitions(paths), is_part=True))
    return replace(onto, findings=(*findings.items, *onto.findings))


class _Contents(dict[str, tuple[str, bytes]]):
    """The files of a project, read when they are asked for."""

    def __init__(self, names: dict[str, tuple[str, str]]) -> None:
        super().__init__()
        self._names = names

    def __missing__(self, key: str) -> tuple[str, bytes]:
        inside, name = self._names[key]
        self[key] = (inside, read_bytes(name))
        return self[key]
