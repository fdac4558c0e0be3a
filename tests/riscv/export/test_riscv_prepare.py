"""Prepared models: load phases as long as the images need, and nothing else changed."""

import json
from dataclasses import replace

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.exporters.riscv import RiscvOptions, codes
from halpipe.exporters.riscv.prepare import FILE
from halpipe.exporters.riscv.profile import FOLDER
from halpipe.flow.formats import export, prepare_model
from riscv_models import PHASES, deployed, moving, on_disk, single
from support import access, after, model, task, version

OPTIONS = RiscvOptions(toolchain="zig")
US = Duration.parse("1us")


@pytest.fixture
def prepare(tmp_path):
    """Prepare a model for a management core that takes 1.5 us for an operation."""

    def run(system, tables=None, dummy=False, **sources):
        from halpipe.models import Schedule

        read, _ = on_disk(tmp_path, system, tables or Schedule(model=system.name, model_sha256=""), **sources)
        brisk = FOLDER.joinpath("vcu118.yaml").read_text().replace("service: 6500ns", "service: 1500ns")
        tmp_path.joinpath("vcu118.yaml").write_text(brisk)
        options = replace(OPTIONS, profile=str(tmp_path / "vcu118.yaml"))
        return prepare_model(read, options, dummy=dummy)

    return run


def phases(prepared, index=0):
    found = prepared.model.tasks[index].versions[0]
    return [(str(a.start), str(a.end), str(a.kind)) for a in found.accesses], str(found.wcet)


def codes_of(prepared):
    return [found.code for found in prepared.diagnostics]


def test_a_model_that_fits_stays(prepare):
    system, tables = single()
    prepared = prepare(system, tables)
    assert prepared.model.tasks == system.tasks
    assert codes_of(prepared) == []


def test_without_a_load_phase_the_job_grows_at_its_front(prepare):
    prepared = prepare(*single(deployed(phases=PHASES[1:])))
    # 24 us for the management core's other operations; the image has code, which takes a transfer of 3 us
    added = US * 27
    old = [(Duration.parse(a), Duration.parse(b)) for a, b in (("0.1ms", "0.2ms"), ("0.9ms", "1ms"))]
    shifted = [(str(a + added), str(b + added)) for a, b in old]
    found, wcet = phases(prepared)
    assert found[0] == ("0ms", "27us", "load")
    assert [(a, b) for a, b, _ in found[1:]] == shifted
    assert wcet == "1.027ms"
    assert codes_of(prepared) == [codes.GREW.id]


def test_a_short_load_phase_is_prolonged(prepare):
    short = (
        moving("memory", "0ms", "10us", "load"),
        moving("memory", "10us", "0.2ms", "read", ("input", "numbers", 64)),
    )
    found, wcet = phases(prepare(*single(deployed(phases=(*short, PHASES[2])))))
    assert found == [("0ms", "27us", "load"), ("27us", "217us", "read"), ("917us", "1.017ms", "write")]
    assert wcet == "1.017ms"


def test_memory_phases_grow_to_what_they_move(prepare):
    tight = moving("memory", "0.9ms", "0.91ms", "write", ("output", "scaled", 64))
    found, wcet = phases(prepare(*single(deployed(phases=(*PHASES[:2], tight)))))
    assert found == [("0ms", "100us", "load"), ("100us", "200us", "read"), ("900us", "927us", "write")]
    assert wcet == "1.017ms"


def test_the_growth_depends_on_the_image(prepare):
    big = "const uint32_t table[10000] = {1};\n"
    text = "#include <stdint.h>\n" + big + single_source().replace("* 3", "* ((volatile const uint32_t *)table)[i]")
    found, _ = phases(prepare(*single(deployed(phases=PHASES[1:])), scale_c=text))
    assert found[0][1] == "129us"  # 24, 3 for the code, and 2 + 100 for 40 000 bytes at 400 MB/s


def single_source():
    from riscv_models import SCALE

    return SCALE


def test_a_gang_is_loaded_one_after_the_other(prepare):
    version = deployed(units="u1 u2", gang=2, phases=PHASES[1:])
    found, _ = phases(prepare(*single(version, units="u1 u2")))
    assert found[0] == ("0ms", "30us", "load")


def test_prepared_again_nothing_changes(prepare):
    once = prepare(*single(deployed(phases=PHASES[1:])))
    twice = prepare(once.model)
    assert twice.model.tasks == once.model.tasks
    assert codes_of(twice) == []


def test_a_model_without_resources_gets_the_main_memory(prepare):
    prepared = prepare(*single(deployed(phases=()), resources=""))
    assert [(r.name, r.bandwidth) for r in prepared.model.resources] == [("main-memory", 400_000_000)]
    assert prepared.model.tasks[0].versions[0].accesses[0].resource == "main-memory"


def test_windows_from_the_start_of_what_grew_are_told(prepare):
    first = task("first", "5ms", deployed(phases=PHASES[1:]))
    second = task("second", "5ms", replace(deployed(), precedences=(after("first", "1ms", "2ms"),)))
    third = task("third", "5ms", replace(deployed(), precedences=(after("first", "0ms", "1ms", "end"),)))
    prepared = prepare(model(first, second, third, units="u1", resources="memory"))
    [told] = [found for found in prepared.diagnostics if found.code == codes.WINDOW_FROM_START.id]
    assert told.path.startswith('task "second"')
    assert "27us" in told.message


def test_phases_that_move_nothing_are_told(prepare):
    prepared = prepare(*single(deployed(phases=(*PHASES, access("memory", "0.5ms", "0.6ms")))))
    assert codes_of(prepared) == [codes.IDLE_PHASE.id]


def test_growth_beyond_the_deadline_is_refused(prepare):
    with pytest.raises(HalpipeError) as caught:
        prepare(*single(deployed(wcet="5ms", phases=PHASES[1:])))
    assert any(found.code == "HAL0231" or found.code == "HAL0232" for found in caught.value.diagnostics)


def test_dummies_can_be_deployed(prepare, tmp_path):
    """A set without sources becomes a bundle; its model names the sources that were made."""
    windows = version("v", "1ms", "u1", access("memory", "0.4ms", "0.6ms"))
    prepared = prepare(model(task("a", "5ms", windows), units="u1", resources="memory"), dummy=True)
    assert list(prepared.files) == [FILE]
    tmp_path.joinpath(FILE).write_bytes(prepared.files[FILE])
    owner = prepared.model.tasks[0]
    system, tables = single(owner.versions[0])
    read, schedule = on_disk(tmp_path, system, tables)
    bundle = export("riscv", read, schedule, OPTIONS)
    [image] = json.loads(bundle["target.json"])["images"]
    assert len(image["entries"]) == 2
    assert prepare(prepared.model, dummy=True).model.tasks == prepared.model.tasks


def test_without_sources_and_without_dummies(prepare):
    with pytest.raises(HalpipeError) as caught:
        prepare(model(task("a", "5ms", version("v", "1ms", "u1")), units="u1"))
    assert [found.code for found in caught.value.diagnostics] == [codes.NO_SOURCE.id]


def test_a_task_with_a_let_reads_when_its_copies_are_complete(prepare):
    """Of a turn, 3 us are for other operations and 2 for set-up: 6 us to write 64 bytes, 105 to read 40 000."""
    long = (PHASES[0], moving("memory", "0.1ms", "0.3ms", "read", ("input", "numbers", 40_000)), PHASES[2])
    owner = replace(task("scale", "5ms", deployed(phases=long), offset="0ms"), let=Duration.parse("4ms"))
    text = single_source().replace("numbers[16]", "numbers[10000]")
    found, _ = phases(prepare(model(owner, units="u1", resources="memory"), scale_c=text))
    assert [end for _, end, _ in found] == ["111us", "311us", "1.011ms"]
