"""What is not imported warns, unless it stands on the list of harmless kinds and features; each of these is changed."""

import re
from pathlib import Path

import pytest
from amalthea_case import call, found, read, refusal, runnable, task, ticks, write
from lxml import etree

from halpipe.core.diagnostics import Exit, Severity
from halpipe.exporters.native.model import format_model
from halpipe.importers.amalthea import FORMAT, codes
from halpipe.importers.amalthea.build import HARMLESS, READ, RULES, UNREACHED
from halpipe.importers.common.base import ImportOptions

XSI = "{http://www.w3.org/2001/XMLSchema-instance}type"
WIDE = Path(__file__).parent / "amalthea_fixtures" / "wide.amxmi"
PLACES = {
    "Tag": "commonElements/tags",
    "Namespace": "commonElements/namespaces",
    "CoreClassifier": "commonElements/coreClassifiers",
    "MemoryClassifier": "commonElements/memoryClassifiers",
    "CustomProperty": "swModel/customProperties",
    "SchedulerDefinition": "osModel/schedulerDefinitions",
    "SchedulingParameterDefinition": "osModel/schedulingParameterDefinitions",
    "PowerDomain": "hwModel/domains",
    "Quartz": "hwModel/system/quartzes",
    "CoreType": "hwModel/coreTypes",
    "DataTypeDefinition": "swModel/typeDefinitions",
    "BaseTypeDefinition": "swModel/typeDefinitions",
    "Channel": "swModel/channels",
    "ComponentsModel": "componentsModel",
    "ConfigModel": "configModel",
    "EventConfig": "configModel/eventsToTrace",
    "MeasurementModel": "measurementModel",
    "LocalModeLabelAssignment": "swModel/runnables/activityGraph/items",
    "Semaphore": "osModel/semaphores",
    "SemaphoreAccess": "swModel/runnables/activityGraph/items",
    "PhysicalSectionMapping": "mappingModel/physicalSectionMapping",
    "VariableRateStimulus": "stimuliModel/stimuli",
}
WORDS = sorted(word for words in HARMLESS.values() for word in words.split())


def wide():
    text = WIDE.read_text(encoding="utf-8").replace("RELEASE", "3.3.0").replace("am:SWITCH", "am:Switch")
    return etree.fromstring(text.replace("am:MODECONDITION", "am:ModeValueCondition").encode())


def outcome(tmp_path, root):
    imported = FORMAT.read(
        [write(tmp_path, etree.tostring(root, encoding="unicode"))], ImportOptions(name="wide")
    ).completed()
    warnings = [d.message for d in imported.diagnostics if d.severity is Severity.WARNING]
    return re.sub(rb"<origin[^>]*/>", b"", format_model(imported.model)), warnings


def place(root, kind):
    """Add an element of a kind where it may stand."""
    *above, tag = PLACES[kind].split("/")
    owner = root
    for name in above:
        inner = owner.find(name)
        owner = etree.SubElement(owner, name) if inner is None else inner
    element = etree.SubElement(owner, tag)
    element.set(XSI, f"am:{kind}")
    element.set("name", f"new {kind}")
    return element


def elements(root, kind):
    """The elements of a kind, by its class, its tag, or as a class that belongs to a tag."""
    tags = {"HwPort": "ports", "HwAccessElement": "accessElements", "Task": "tasks", "ISR": "isrs"}
    tags |= {"Runnable": "runnables", "Label": "labels", "ModeLabel": "modeLabels", "HwStructure": "structures"}
    tags |= {"HwFeatureCategory": "featureCategories", "MappingModel": "mappingModel", "Cache": "caches"}
    tags |= {
        "TaskScheduler": "taskSchedulers",
        "InterruptController": "interruptControllers",
        "EventChain": "eventChains",
    }
    untyped = [e for e in root.iter("*") if e.get(XSI) is None and e.tag in (kind, tags.get(kind))]
    return untyped + [e for e in root.iter("*") if e.get(XSI) == f"am:{kind}"] or [place(root, kind)]


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    root = wide()
    for kind in PLACES:
        if kind not in ("Channel", "SemaphoreAccess"):
            place(root, kind)
    return outcome(tmp_path_factory.mktemp("plain"), wide()), outcome(tmp_path_factory.mktemp("all"), root)


def test_the_model_has_no_warning_and_all_harmless_kinds_change_nothing(plain):
    (model, warnings), with_all = plain
    assert warnings == []
    assert with_all == (model, warnings)


@pytest.mark.parametrize("word", WORDS)
def test_what_is_harmless_changes_nothing(word, plain, tmp_path):
    kind, _, feature = word.partition(".")
    root = wide()
    expected = plain[0]
    if not feature:
        place(root, kind)
    elif kind in PLACES:
        elements(root, kind)
        expected = outcome(tmp_path, root)
    for element in list(root.iter("*")) if kind == "*" else elements(root, kind) if feature else []:
        if feature != "name":
            element.set(feature, "7")
            etree.SubElement(element, feature, name="new", value="7")
    assert outcome(tmp_path, root) == expected


def test_the_lists_do_not_contradict_each_other():
    for kind, features in RULES.read.items():
        assert [f for f in features if f"{kind}.{f}" in RULES.harmless] == []
    assert not set(RULES.harmless) & set(RULES.unreached)
    assert all(lists for lists in (READ, HARMLESS, UNREACHED))


MAPPED = task("T", call("R")) + '<labels name="L"/>'
ACCESS = '<items xsi:type="am:LabelAccess" data="L?type=Label" access="read"{}/>'


def test_an_element_that_is_not_read_warns_with_its_kind_count_and_places(tmp_path):
    step = '<items xsi:type="am:EnforcedMigration"/>'
    imported = read(tmp_path, sw=MAPPED + runnable("R", ticks(5), step, step))
    [finding] = found(imported.diagnostics, codes.NOT_READ)
    where = 'EnforcedMigration in Runnable "R" (line 19)'
    assert finding.message == f"2 of EnforcedMigration are not imported: {where}, {where}"


@pytest.mark.parametrize(
    ("access", "message"),
    [
        (ACCESS.format(' implementation="later"'), 'implementation="later" of LabelAccess is not imported'),
        (
            ACCESS.format(' dataStability="automaticProtection"'),
            'dataStability="automaticProtection" of LabelAcc',
        ),
        (ACCESS.format(' invented="7"'), "invented of LabelAccess is not imported"),
        (
            '<items xsi:type="am:LabelAccess" data="L?type=Label"><transmissionPolicy transmitRatio="0.5"/></items>',
            "transmissionPolicy is not imported",
        ),
    ],
)
def test_an_attribute_or_a_value_that_is_not_read_warns(tmp_path, access, message):
    imported = read(tmp_path, sw=MAPPED + runnable("R", ticks(5), access))
    [finding] = found(imported.diagnostics, codes.NOT_READ)
    assert message in finding.message


@pytest.mark.parametrize("value", ["implicit", "explicit", "_undefined_"])
def test_values_that_are_understood_do_not_warn(tmp_path, value):
    imported = read(tmp_path, sw=MAPPED + runnable("R", ticks(5), ACCESS.format(f' implementation="{value}"')))
    assert found(imported.diagnostics, codes.NOT_READ) == []


def test_what_no_task_reaches_does_not_warn(tmp_path):
    step = '<items xsi:type="am:EnforcedMigration"/>'
    imported = read(tmp_path, sw=task("T", ticks(5)) + runnable("R", step))
    assert found(imported.diagnostics, codes.NOT_READ) == []


def test_strict_refuses_what_is_not_read(tmp_path):
    sw = MAPPED + runnable("R", ticks(5), ACCESS.format(' implementation="later"'))
    failure = refusal(read, tmp_path, sw=sw, strict=True)
    assert failure.exit is Exit.UNSUPPORTED
    assert found(failure.diagnostics, codes.NOT_READ)


def test_a_warning_of_its_own_is_enough(tmp_path):
    loop = f'<items xsi:type="am:WhileLoop">{ticks(5)}</items>'
    imported = read(tmp_path, sw=task("T", loop))
    assert found(imported.diagnostics, codes.LOOP)
    assert found(imported.diagnostics, codes.NOT_READ) == []


def test_a_stimulus_of_a_task_that_is_not_read_warns_beside_others(tmp_path):
    stimuli = (
        '<stimuli xsi:type="am:PeriodicStimulus" name="p10"><recurrence value="10" unit="ms"/></stimuli>'
        '<stimuli xsi:type="am:CustomStimulus" name="c"/><stimuli xsi:type="am:CustomStimulus" name="idle"/>'
    )
    sw = task("T", ticks(5), stimuli="p10?type=PeriodicStimulus c?type=CustomStimulus")
    [finding] = found(read(tmp_path, sw=sw, stimuli=stimuli).diagnostics, codes.NOT_READ)
    assert finding.message == "CustomStimulus is not imported: c (line 16)"


def test_an_unused_way_to_a_memory_that_is_accessed_warns(tmp_path):
    sw = task("T", ticks(500), ACCESS.format("")) + '<labels name="L"><size value="64" unit="bit"/></labels>'
    hw = """
<definitions xsi:type="am:ProcessingUnitDefinition" name="A"/>
<structures name="S">
 <modules xsi:type="am:ProcessingUnit" name="a0" frequencyDomain="F?type=FrequencyDomain"
  definition="A?type=ProcessingUnitDefinition">
  <accessElements name="one" destination="M?type=Memory"><dataRate value="1" unit="MBPerSecond"/></accessElements>
  <accessElements name="other" destination="M?type=Memory"/>
 </modules>
 <modules xsi:type="am:Memory" name="M"/>
</structures>
<domains xsi:type="am:FrequencyDomain" name="F"><defaultValue value="1.0" unit="MHz"/></domains>"""
    mapping = '<memoryMapping abstractElement="L?type=Label" memory="M?type=Memory"/>'
    [finding] = found(read(tmp_path, sw=sw, hw=hw, mapping=mapping).diagnostics, codes.NOT_READ)
    assert "HwAccessElement is not imported: other" in finding.message
