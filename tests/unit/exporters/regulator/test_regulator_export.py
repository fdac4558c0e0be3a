"""The export as one bundle: what is in it, that it stands alone, and what is refused."""

import json

import pytest
from regulator_samples import FULL, PLATFORM, platform_file, switching, two_units

from halpipe.core.bundles import open_bundle
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import sha256, write_directory
from halpipe.exporters.common.base import ExportOptions
from halpipe.exporters.regulator import FORMAT, RegulatorOptions, codes
from halpipe.exporters.regulator.platform import BACKENDS
from halpipe.importers.native import parse_model, parse_schedule
from halpipe.pipeline.verify import verify
from stated_options import stated

SHARED = {"manifest.json", "model.xml", "schedule.xml", "platform.yaml", "tables.json", "report.json", "report.txt"}


def export(tmp_path, sample=two_units, text=PLATFORM, **options):
    platform = platform_file(tmp_path, text, **({} if "capacity" in text else FULL))
    return FORMAT.write(*sample(), RegulatorOptions(platform=platform, **options))


def test_a_bundle_stands_alone(tmp_path):
    contents = export(tmp_path)
    assert {name for name in contents if "/" not in name} == SHARED
    assert {name.partition("/")[0] for name in contents} - SHARED == {"table"}
    write_directory(str(tmp_path / "cfg"), contents)
    bundle = open_bundle(str(tmp_path / "cfg"))
    assert (bundle.kind, bundle.facts) == (
        "regulator", {"backend": "table", "platform": "platform", "model": "two-units"},
    )  # fmt: skip
    model = parse_model(bundle.files["model.xml"], "model.xml")
    schedule = parse_schedule(bundle.files["schedule.xml"], "schedule.xml")
    assert schedule.model_sha256 == model.digest == sha256(bundle.files["model.xml"])
    assert bundle.files["platform.yaml"] == (tmp_path / "platform.yaml").read_bytes()
    tables = json.loads(bundle.files["tables.json"])
    assert tables["schedule_sha256"] == sha256(bundle.files["schedule.xml"])
    assert tables["schedule_sha256"].encode() in bundle.files["table/bw_tables.h"]


@pytest.mark.parametrize("name", BACKENDS[:2])
def test_every_back_end_writes_into_a_folder_of_its_own(tmp_path, name):
    text = PLATFORM + "capacity: 7.4MB/s\n"
    contents = export(tmp_path, switching, text, backend=name)
    assert {n.partition("/")[0] for n in contents} - SHARED == {name}
    assert contents == export(tmp_path, switching, text + f"backend: {name}\n") | {
        "platform.yaml": contents["platform.yaml"], "manifest.json": contents["manifest.json"],
    }  # fmt: skip


def test_no_place_of_this_machine_is_in_a_bundle(tmp_path):
    contents = export(tmp_path, text=PLATFORM.replace("u2: {manager: 2", "u9: {manager: 9}\n  u2: {manager: 2"))
    assert not any(str(tmp_path).encode() in content for content in contents.values())
    (found,) = json.loads(contents["report.json"])["findings"]
    assert (found["code"], found["file"], found["path"]) == (codes.UNKNOWN_UNIT.id, "platform.yaml", 'unit "u9"')


def test_one_mode_is_a_bundle_of_a_model_with_one_mode(tmp_path):
    contents = export(tmp_path, switching, mode="slow")
    model = parse_model(contents["model.xml"], "model.xml")
    schedule = parse_schedule(contents["schedule.xml"], "schedule.xml")
    assert [mode.name for mode in model.modes] == ["slow"]
    assert [t["name"] for t in json.loads(contents["tables.json"])["tables"]] == ["slow"]
    assert json.loads(contents["tables.json"])["switches"] == []
    assert not [d for d in verify(model, schedule) if d.is_error]


def test_rounding_can_be_chosen(tmp_path):
    for rule in ("whole", "controlled"):
        tables = json.loads(export(tmp_path, rounding=rule)["tables.json"])["tables"]
        assert {table["rounding"] for table in tables} == {rule}


def test_an_export_needs_platform_and_schedule(tmp_path):
    system, schedule = two_units()
    for arguments, expected in (
        ((schedule, ExportOptions()), codes.NOT_A_PLATFORM.id),
        ((None, RegulatorOptions(platform="p.yaml")), "HAL0801"),
        ((schedule, RegulatorOptions(platform=str(tmp_path / "absent.yaml"))), "HAL0001"),
        ((schedule, RegulatorOptions(platform=platform_file(tmp_path), backend="tabel")), codes.UNKNOWN_BACKEND.id),
        ((schedule, RegulatorOptions(platform=platform_file(tmp_path), mode="none")), "HAL0802"),
    ):
        with pytest.raises(HalpipeError) as refused:
            FORMAT.write(system, *arguments)
        assert [d.code for d in refused.value.diagnostics] == [expected]


def test_errors_of_the_back_end_stop_the_export_with_the_warnings(tmp_path):
    text = PLATFORM.replace("u2: {manager: 2", "u9: {manager: 9}\n  u2: {manager: 2") + "table: {depth: 4}\n"
    with pytest.raises(HalpipeError) as refused:
        export(tmp_path, text=text)
    assert [d.code for d in refused.value.diagnostics] == [codes.UNKNOWN_UNIT.id, codes.DOES_NOT_FIT.id]


def test_pipeline_files_state_its_options():
    found, problems = stated(
        FORMAT, "platform: sub/p.yaml\nbackend: axi-realm\nrounding: controlled\n", "/base", mode="m"
    )
    assert problems == []
    assert found == RegulatorOptions(mode="m", platform="/base/sub/p.yaml", backend="axi-realm", rounding="controlled")


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("backend: table\n", "HAL0024"),
        ("platform: ''\n", "HAL0023"),
        ("platform: p.yaml\nbackend: tabel\n", "HAL0023"),
        ("platform: p.yaml\nrounding: wole\n", "HAL0023"),
    ],
)
def test_what_pipeline_files_state_wrongly(text, code):
    _, problems = stated(FORMAT, text, "/base", mode="m")
    assert [d.code for d in problems] == [code]
    assert all(d.help for d in problems)
