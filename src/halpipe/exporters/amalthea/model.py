"""The whole document: the model as one mode or all modes of it, with the schedule that was chosen."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.embedding import pieces, properties_hash
from halpipe.exporters.amalthea.document import (
    Written,
    add,
    add_property,
    definitions_of,
    document,
    write_hardware,
    write_mapping,
    write_system,
)
from halpipe.exporters.amalthea.software import Software
from halpipe.exporters.amalthea.stimuli import Events, stimuli_of, write_constraints, write_stimuli
from halpipe.exporters.common.frozen import serialise
from halpipe.exporters.common.names import refuse_dangling
from halpipe.exporters.common.selection import select
from halpipe.exporters.native import format_model
from halpipe.models.modes import require_mode

if TYPE_CHECKING:
    from lxml import etree

    from halpipe.exporters.amalthea import AmaltheaOptions
    from halpipe.models import Schedule, TaskModel


def format_amalthea(model: TaskModel, schedule: Schedule | None, options: AmaltheaOptions) -> bytes:
    """Return the document; raise `HalpipeError` for an unknown mode, or names of what is not there."""
    if options.mode:
        require_mode(options.mode, model.modes)
        model = model.alone(options.mode)
    refuse_dangling(model)
    chosen = None if schedule is None else select(model, schedule, options.mode, "amalthea")
    written = Written()
    root = _document(model, chosen, options.release, written)
    return serialise(root, written.texts)


def _document(model: TaskModel, schedule: Schedule | None, release: str, written: Written) -> etree._Element:
    root = document(release)
    definitions = definitions_of(model)
    stimuli = stimuli_of(model, schedule)
    software = Software(model, release, {unit.name: definitions[unit.type] for unit in model.units}, written)
    software.write(add(root, "swModel"), stimuli)
    write_hardware(add(root, "hwModel"), model, definitions)
    write_system(add(root, "osModel"), model, release)
    write_stimuli(add(root, "stimuliModel"), model, stimuli, written)
    events = Events(add(root, "eventModel"), written)
    write_constraints(add(root, "constraintsModel"), model, events, software.runnables, written)
    write_mapping(add(root, "mappingModel"), model, stimuli, written)
    _embed(root, model)
    return root


def _embed(root: etree._Element, model: TaskModel) -> None:
    """Put the native model before the standard elements, with their hash."""
    last = len(root)
    add_property(root, "hash", properties_hash(root))
    for number, text in enumerate(pieces(format_model(model))):
        add_property(root, f"model.{number}", text)
    for place, element in enumerate(root[last:]):
        root.insert(place, element)
