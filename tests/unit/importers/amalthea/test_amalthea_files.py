"""Which files are read, how references across them are followed, and what is said of all others."""

import pytest
from amalthea_case import HARDWARE, document, files, found, read, refusal, runnable, task, ticks, write

from halpipe.core.diagnostics import Exit
from halpipe.importers.amalthea import codes

SW = task("T", '<items xsi:type="am:RunnableCall" runnable="R?type=Runnable"/>') + runnable("R", ticks(5))
STIMULI = '<stimuli xsi:type="am:PeriodicStimulus" name="p10"><recurrence value="10" unit="ms"/></stimuli>'


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("<AUTOSAR/>", 'root element "AUTOSAR" without a namespace'),
        ('<x:model xmlns:x="urn:x"/>', 'root element "model" in the namespace "urn:x"'),
        ('<e:EPackage xmlns:e="http://app4mc.eclipse.org/amalthea/1.2.0"/>', "metamodel"),
        ('<am:Other xmlns:am="http://app4mc.eclipse.org/amalthea/1.2.0"/>', 'root element "Other"'),
    ],
)
def test_other_files_are_named_for_what_they_are(tmp_path, content, words):
    failure = refusal(files, write(tmp_path, content))
    assert [d.code for d in failure.diagnostics] == [codes.NOT_AMALTHEA.id]
    assert words in failure.diagnostics[0].message


def test_a_compressed_model_must_be_unpacked_first(tmp_path):
    path = tmp_path / "model.amxmi"
    path.write_bytes(b"PK\x03\x04rest")
    (diagnostic,) = refusal(files, path).diagnostics
    assert (diagnostic.code, "unpack" in diagnostic.help) == (codes.NOT_AMALTHEA.id, True)


def test_broken_xml_names_its_line(tmp_path):
    failure = refusal(files, write(tmp_path, "<a>\n<b>\n</a>"))
    assert failure.diagnostics[0].code == "HAL0010"


def test_nothing_named_and_nothing_found(tmp_path):
    for paths in ((), (tmp_path,)):
        assert [d.code for d in refusal(files, *paths).diagnostics] == [codes.NO_INPUT.id]


def test_a_folder_is_one_model_and_other_files_in_it_are_skipped(tmp_path):
    write(tmp_path, document(sw=SW), "sw.amxmi")
    write(tmp_path, document(hw=HARDWARE, stimuli=STIMULI), "rest.amxmi")
    write(tmp_path, "<other/>", "other.amxmi")
    imported = files(tmp_path)
    assert [str(v.wcet) for v in imported.model.task("T").versions] == ["50ns", "25ns"]
    assert [d.at.file for d in found(imported.diagnostics, codes.SKIPPED_FILE)] == [str(tmp_path / "other.amxmi")]
    assert imported.model.name == tmp_path.name


def test_references_across_files_may_be_children_with_a_href(tmp_path):
    sw = (
        '<tasks name="T"><stimuli xsi:type="am:PeriodicStimulus" href="amlt:/#p10%3Ftype%3DPeriodicStimulus"/>'
        "<activityGraph>" + ticks(5) + "</activityGraph></tasks>"
    )
    paths = (
        write(tmp_path, document(sw=sw), "a.amxmi"),
        write(tmp_path, document(hw=HARDWARE, stimuli=STIMULI), "b.amxmi"),
    )
    assert str(files(*paths).model.task("T").period) == "10ms"


def test_files_of_different_versions_are_not_mixed(tmp_path):
    paths = [write(tmp_path, document(v, sw=SW), f"{v}.amxmi") for v in ("1.0.0", "0.9.5", "1.0.0")]
    failure = refusal(files, *dict.fromkeys(paths))
    assert [(d.code, d.at.file) for d in failure.diagnostics] == [(codes.MIXED_VERSIONS.id, paths[1])]


def test_an_element_in_two_files_means_two_models(tmp_path):
    paths = [write(tmp_path, document(sw=SW, stimuli=STIMULI, hw=HARDWARE), name) for name in ("a.amxmi", "b.amxmi")]
    failure = refusal(files, *paths)
    assert {d.path for d in found(failure.diagnostics, codes.DUPLICATE)} >= {'Task "T"', 'Runnable "R"'}


def test_a_name_used_twice_in_a_file_is_told(tmp_path):
    imported = read(tmp_path, sw=SW + runnable("R", ticks(9)))
    assert [d.path for d in found(imported.diagnostics, codes.REPEATED)] == ['Runnable "R"']
    assert str(imported.model.task("T").versions[0].wcet) == "50ns"


@pytest.mark.parametrize("version", ["9.9.9", "0.6.0"])
def test_an_unknown_version_is_read_with_a_warning(tmp_path, version):
    imported = read(tmp_path, version=version, sw=SW)
    assert len(found(imported.diagnostics, codes.UNKNOWN_VERSION)) == 1


def test_a_reference_to_nothing_suggests_what_there_is(tmp_path):
    both = "p10?type=PeriodicStimulus p11?type=PeriodicStimulus"
    imported = read(tmp_path, sw=SW.replace("p10?type=PeriodicStimulus", both))
    (diagnostic,) = found(imported.diagnostics, codes.DANGLING)
    assert ('"p11"' in diagnostic.message, diagnostic.help) == (True, 'did you mean "p10"?')


def test_names_are_encoded_in_references_and_made_legal_in_the_model(tmp_path):
    sw = task("My task*", '<items xsi:type="am:RunnableCall" runnable="R+%2B%2F1?type=Runnable"/>')
    imported = read(tmp_path, sw=sw + runnable("R +/1", ticks(7)))
    assert [str(v.wcet) for v in imported.model.task("My_task_").versions] == ["70ns", "35ns"]
    assert [d.path for d in found(imported.diagnostics, codes.RENAMED)] == ['task "My task*"']


def test_opaque_ids_of_itea_are_followed(tmp_path):
    text = """<c:AMALTHEA xmlns:c="http://www.amalthea.itea2.org/model/1.1.0/central" xmlns:xmi="http://www.omg.org/XMI"
 xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xmlns:sw="http://www.amalthea.itea2.org/model/1.1.0/sw"
 xmlns:common="http://www.amalthea.itea2.org/model/1.1.0/common">
<swModel><tasks xmi:id="_t" name="T" stimuli="_s"><deadline value="8" unit="ms"/><callGraph>
<graphEntries xsi:type="sw:CallSequence"><calls xsi:type="sw:TaskRunnableCall" runnable="_r"/></graphEntries>
</callGraph></tasks>
<runnables xmi:id="_r" name="R"><runnableItems xsi:type="sw:InstructionsDeviation"><deviation>
<lowerBound xsi:type="common:LongObject" value="100"/><upperBound xsi:type="common:LongObject" value="400"/>
</deviation></runnableItems></runnables></swModel>
<hwModel><coreTypes xmi:id="_ct" name="Tri" instructionsPerCycle="4"/><system><ecus>
<quartzes xmi:id="_q" name="Q" frequency="100000000"/><microcontrollers><cores xmi:id="_c" name="C0" coreType="_ct">
<prescaler clockRatio="0.5" quartz="_q"/></cores></microcontrollers></ecus></system></hwModel>
<stimuliModel><stimuli xsi:type="stimuli:Periodic" xmlns:stimuli="http://www.amalthea.itea2.org/model/1.1.0/stimuli"
 xmi:id="_s" name="S"><offset unit="ms"/><recurrence value="20" unit="ms"/></stimuli></stimuliModel></c:AMALTHEA>"""
    task_ = files(write(tmp_path, text)).model.task("T")
    # 400 instructions at 4 per cycle are 100 cycles of a 50 MHz core.
    assert [(v.name, str(v.wcet), v.units) for v in task_.versions] == [("Tri", "2us", ("C0",))]
    assert [str(t) for t in (task_.period, task_.offset, task_.deadline)] == ["20ms", "0ms", "8ms"]


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ('value="ten" unit="ms"', "value='ten' is not a number"),
        ('value="-10" unit="ms"', "value='-10' is negative"),
        ('value="1E999" unit="ms"', "is not a number"),
        ('value="10" unit="min"', "unit='min' is unknown"),
        ('value="10"', "has no unit"),
        ('value="1E40" unit="ms"', "longer than a task model can state"),
    ],
)
def test_values_of_a_wrong_form_are_errors_with_their_line(tmp_path, bad, words):
    failure = refusal(read, tmp_path, sw=SW, stimuli=STIMULI.replace('value="10" unit="ms"', bad))
    (diagnostic,) = found(failure.diagnostics, codes.BAD_VALUE)
    assert words in diagnostic.message
    assert diagnostic.at.line > 0


def test_strict_turns_warnings_into_errors(tmp_path):
    bad = SW + task("U", ticks(1), stimuli="")
    failure = refusal(read, tmp_path, sw=bad, strict=True)
    assert failure.exit is Exit.UNSUPPORTED
    assert [d.is_error for d in found(failure.diagnostics, codes.NO_PERIOD)] == [True]


def test_every_element_is_counted_once_with_a_reason(tmp_path):
    sw = SW + runnable("unused", ticks(1)) + '<labels name="L"/>'
    imported = read(tmp_path, sw=sw)
    rows = {kind: (total, mapped, ignored) for kind, total, mapped, ignored in imported.coverage.rows()}
    assert rows["Runnable"] == (2, 1, 1)
    assert rows["Task"] == (1, 1, 0)
    assert {e.name: e.reason for e in imported.coverage.ignored_elements if e.kind in ("Runnable", "Label")} == {
        "unused": "no task calls it",
        "L": "no access to it in a memory is known",
    }
