"""Nothing of an AMALTHEA model is dropped in silence: every class, attribute and value of the official metamodels.

A model with one more element or attribute, made from the metamodel alone, gives another task model, or a warning, or
the addition stands on the list of what is harmless. The judge is the .ecore file of the release.
"""

import re
from itertools import islice, product
from pathlib import Path

import pytest

from amalthea_metamodel import Additions, Metamodel
from halpipe.core.diagnostics import HalpipeError, Severity
from halpipe.exporters.native.model import format_model
from halpipe.importers.amalthea import FORMAT
from halpipe.importers.amalthea.build import RULES
from halpipe.importers.common.base import ImportOptions
from profiles import in_turn

DATA = Path(__file__).parents[2].parent / "shared" / "data" / "amalthea"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="the metamodels of AMALTHEA are not part of the project")
FIXTURES = Path(__file__).parents[1] / "unit" / "importers" / "amalthea" / "amalthea_fixtures"
RELEASES = ("1.2.0", "2.0.0", "2.1.0", "2.2.0", "3.0.0", "3.1.0", "3.2.0", "3.3.0")

# What is read, but says the same again in this model.
SAME = {
    "Amalthea": ("commonElements", "propertyConstraintsModel"),  # empty ones
    "HWModel": ("structures",),
    "HwStructure": ("structures",),
    "OSModel.operatingSystems": ("OperatingSystem", "VendorOperatingSystem"),
    "OperatingSystem.osDataConsistency": ("OsDataConsistency",),
    "MappingModel": ("schedulerAllocation", "isrAllocation"),  # repeats one that is there
    "Switch": ("entries",),  # a shorter branch, or one that the mode does not take
    "SwitchEntry": ("condition",),
    "SwitchDefault": ("items",),
    "ModeSwitch": ("entries",),
    "ModeSwitchEntry": ("condition",),
    "ModeSwitchDefault": ("items",),
    "ProbabilitySwitch": ("entries",),
    "PeriodicBurstStimulus": ("burstLength",),  # the least distance is stated
    "ArrivalCurveStimulus": ("entries",),  # the distance of two arrivals is stated, and the least
    "ModeConditionDisjunction": ("entries",),
    "ConditionDisjunction": ("entries",),  # or something that never holds
    "ActivityGraph.items": ("SchedulePoint",),  # within a runnable or interrupt, it would only allow more
    "Group.items": ("SchedulePoint",),
    "SwitchEntry.items": ("SchedulePoint",),
    "ModeSwitchEntry.items": ("SchedulePoint",),
    "ProbabilitySwitchEntry.items": ("SchedulePoint",),
    "Group.interruptible": ("true",),
    "MemoryDefinition": ("accessLatency",),  # the access elements state the whole way
    "CacheDefinition": ("accessLatency",),
    "HwAccessElement": ("accessPath",),
    "TimeBoundaries": ("upperBound",),  # the least distance of arrivals counts
    "DiscreteValueStatistics": ("lowerBound", "average"),  # the upper bound counts
    "ModeValueCondition.relation": ("EQUAL",),
    "ModeValue.relation": ("EQUAL",),
    "HwPort": ("bitWidth",),  # the unit has a data rate
    "ProcessingUnitDefinition": ("features",),  # the one that is there
    "TaskScheduler": ("parentAssociation",),
    "SchedulerAssociation": ("parent",),
    "SchedulerAllocation": ("scheduler", "executingPU"),  # a child or the parent of the scheduler
    "TaskAllocation": ("scheduler",),
    "RunnableEvent": ("entity", "process"),  # another runnable of the same task
    "LabelEvent": ("runnable", "process"),
    "EventChain": ("stimulus", "response", "itemType"),  # another event of the same task
    "SubEventChain": ("stimulus", "response", "itemType", "items"),
    "DataAgeConstraint": ("runnable",),
    "RunnableEntityGroup": ("runnables",),
    "SetEvent.process": ("B?type=Task",),
    "RelativePeriodicStimulus": ("executionCondition",),  # interrupts are reserved for in every mode
}


def metamodel(release):
    name = f"amalthea-{release}.ecore"
    return Metamodel(DATA / name if (DATA / name).exists() else DATA / "ecore" / name)


def base(release, known):
    text = (FIXTURES / "wide.amxmi").read_text(encoding="utf-8").replace("RELEASE", release)
    switch = "am:Switch" if "Switch" in known.classes else "am:ModeSwitch"
    condition = "am:ModeValueCondition" if "ModeValueCondition" in known.classes else "am:ModeValue"
    return text.replace("am:SWITCH", switch).replace("am:MODECONDITION", condition).encode()


def outcome(folder, data):
    """What an import gives: the model without places, the warnings, and the reasons of what is ignored."""
    path = folder / "model.amxmi"
    path.write_bytes(data)
    try:
        imported = FORMAT.read([str(path)], ImportOptions()).completed()
    except HalpipeError as failure:
        return None, {(d.code, d.message) for d in failure.diagnostics}, set()
    model = re.sub(rb"<origin[^>]*/>", b"", format_model(imported.model))
    warnings = {(d.code, d.message) for d in imported.diagnostics if d.severity is Severity.WARNING}
    return model, warnings, {(e.kind, e.reason) for e in imported.coverage.ignored_elements}


def silent(folder, release, additions, every=1):
    """The additions that change nothing, are not warned of and not listed as harmless; of all, or some of them."""
    known = metamodel(release)
    maker = Additions(known, base(release, known))
    model, warnings, _ = outcome(folder, base(release, known))
    listed = set(RULES.harmless.values()) | set(RULES.unreached.values())
    for owners, feature, kind, data in islice(additions(maker), 0, None, every):
        changed, found, ignored = outcome(folder, data)
        if changed != model or not found <= warnings:
            continue
        if any(RULES.reason(owner, feature) or RULES.reason(owner) for owner in owners) or RULES.reason(kind):
            continue
        if any(k in (kind, *owners) and reason in listed for k, reason in ignored):
            continue
        if any(kind in RULES.read.get(owner, {}).get(feature, ()) for owner in owners):
            continue  # a value that says what the import assumes
        if feature in SAME.get(owners[0], ()) or kind in SAME.get(f"{owners[0]}.{feature}", ()):
            continue
        yield f"{owners[0]}.{feature}: {kind}"


KINDS = {"elements": Additions.elements, "inner": Additions.inner, "attributes": Additions.attributes}


def test_the_base_model_has_no_warning(tmp_path):
    known = metamodel("3.3.0")
    _, warnings, _ = outcome(tmp_path, base("3.3.0", known))
    assert warnings == set()


@pytest.mark.parametrize("kind", list(KINDS))
def test_some_of_all_additions_are_not_dropped_in_silence(kind, tmp_path):
    assert list(silent(tmp_path, "3.3.0", KINDS[kind], every=20)) == []


@pytest.mark.parametrize("release", RELEASES)
def test_every_class_of_the_metamodel_is_made(release):
    known = metamodel(release)
    maker = Additions(known, base(release, known))
    made = set(maker.kinds.values()) | {kind for _, _, kind, _ in (*maker.elements(), *maker.inner())}
    assert known.concrete_classes() - made == {"ModeValueMapEntry"}  # no class has a feature that holds one


@pytest.mark.slow  # all of them in all releases; above, some in the last
@pytest.mark.parametrize(("release", "kind"), in_turn(product(RELEASES, KINDS), 4))
def test_nothing_is_dropped_in_silence(release, kind, tmp_path):
    assert list(silent(tmp_path, release, KINDS[kind])) == []
