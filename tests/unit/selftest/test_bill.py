"""The bill of materials: what halpipe needs at run time and nothing else, with the elements that NTIA asks for."""

import hashlib
import json
from base64 import urlsafe_b64encode

import pytest

from halpipe.selftest import bill as bills
from halpipe.selftest import evidence

HASHES = {"core/files.py": "0" * 64, "solve/native/kernel.so": "1" * 64}
MOMENT = "2026-01-02T03:04:05Z"


def made():
    return bills.bill(HASHES, MOMENT)


def test_every_component_has_the_minimum_elements():
    bill = made()
    assert bill["metadata"]["timestamp"] == MOMENT
    assert bill["metadata"]["authors"]
    refs = [part["bom-ref"] for part in (bill["metadata"]["component"], *bill["components"])]
    assert len(set(refs)) == len(refs)
    assert {entry["ref"] for entry in bill["dependencies"]} | {refs[-1]} == set(refs)
    assert {ref for entry in bill["dependencies"] for ref in entry["dependsOn"]} <= set(refs)
    for part in bill["components"]:
        assert part["supplier"]["name"]
        assert part["version"]
        assert part["hashes"]
        assert part["purl"]
        assert part["licenses"]


def test_what_only_developers_need_is_left_out():
    names = {part["name"] for part in made()["components"]}
    assert names >= {"lxml", "jinja2", "markupsafe", "typer"}
    assert not names & {"pytest", "mypy", "ruff", "sphinx", "hypothesis", "hatchling"}


@pytest.mark.slow
def test_what_is_not_installed_is_in_no_list(monkeypatch):
    def without(name):
        if name == "markupsafe":
            raise bills.PackageNotFoundError(name)
        return distribution(name)

    distribution = bills.distribution
    assert "markupsafe" in json.dumps(made())
    monkeypatch.setattr(bills, "distribution", without)
    assert "markupsafe" not in json.dumps(made())


def test_every_component_is_needed_by_halpipe():
    bill = made()
    graph = {entry["ref"]: entry["dependsOn"] for entry in bill["dependencies"]}
    reached, waiting = set(), [bill["metadata"]["component"]["bom-ref"]]
    while waiting:
        ref = waiting.pop()
        if ref not in reached:
            reached.add(ref)
            waiting += graph.get(ref, ())
    assert {part["bom-ref"] for part in bill["components"]} <= reached


def test_own_libraries_are_parts_of_halpipe():
    (part,) = made()["metadata"]["component"]["components"]
    assert part["name"] == "solve/native/kernel.so"
    assert part["hashes"] == [{"alg": "SHA-256", "content": "1" * 64}]


@pytest.mark.slow
def test_the_number_follows_from_the_contents():
    assert made() == made()
    assert made()["serialNumber"] != bills.bill(HASHES, "2026-01-02T03:04:06Z")["serialNumber"]


@pytest.fixture
def package(tmp_path):
    """An installed package as pip leaves it."""
    folder = tmp_path / "gear-1.0.dist-info"
    folder.mkdir()

    def install(*fields):
        lines = "\n".join(("Metadata-Version: 2.4", "Name: gear", "Version: 1.0", *fields))
        (folder / "METADATA").write_text(f"{lines}\n", encoding="utf-8")
        digest = urlsafe_b64encode(hashlib.sha256(b"").digest()).decode().rstrip("=")
        paths = ("gear/__init__.py", "gear/wheel.cpython-311.so", "gear-1.0.dist-info/INSTALLER", "../../bin/gear")
        record = [f"{path},sha256={digest},0" for path in paths]
        (folder / "RECORD").write_text("\n".join((*record, "gear/__pycache__/x.pyc,,", "")), encoding="utf-8")
        return bills._package("gear", bills.Distribution.at(folder))

    return install


def test_the_hash_is_that_of_the_record_without_what_the_installer_adds(package):
    empty = hashlib.sha256(b"").hexdigest()
    lines = f"{empty}  gear/__init__.py\n{empty}  gear/wheel.cpython-311.so\n"
    part = package()
    assert part["hashes"] == [{"alg": "SHA-256", "content": hashlib.sha256(lines.encode()).hexdigest()}]
    assert [file["name"] for file in part["components"]] == ["gear/wheel.cpython-311.so"]


@pytest.mark.parametrize(
    ("fields", "licenses"),
    [
        (["License-Expression: mit or apache-2.0"], [{"expression": "MIT OR Apache-2.0"}]),
        (["License: BSD-3-Clause"], [{"expression": "BSD-3-Clause"}]),
        (["License: as is"], [{"license": {"name": "as is"}}]),
        (
            [f"License: {'x' * 101}", "Classifier: License :: OSI Approved :: MIT License"],
            [{"license": {"name": "MIT License"}}],
        ),
        (["License-File: COPYING"], [{"license": {"name": "see COPYING"}}]),
        ([], [{"license": {"name": "not stated"}}]),
    ],
)
def test_licences(package, fields, licenses):
    assert package(*fields)["licenses"] == licenses


@pytest.mark.parametrize(
    ("fields", "supplier"),
    [
        (["Author: A. Smith", "Maintainer: B"], {"name": "A. Smith"}),
        (["Author-email: A. Smith <a@gear.example>, b@gear.example"], {"name": "A. Smith, b@gear.example"}),
        (["Maintainer: B", "Home-page: https://gear.example"], {"name": "B", "url": ["https://gear.example"]}),
        (
            ["Project-URL: Changelog, https://gear.example/c", "Project-URL: Homepage, https://gear.example"],
            {"name": "not stated", "url": ["https://gear.example"]},
        ),
        (["Project-URL: Changelog, https://gear.example/c"], {"name": "not stated"}),
        (["Project-URL: Source, https://gear.example/s"], {"name": "not stated", "url": ["https://gear.example/s"]}),
    ],
)
def test_suppliers(package, fields, supplier):
    assert package(*fields)["supplier"] == supplier


def test_the_schema_of_cyclonedx_accepts_the_bill():
    """The outside judge: the schema of CycloneDX 1.5, strict, by the library of that project."""
    validation = pytest.importorskip("cyclonedx.validation.json", reason="pip install cyclonedx-python-lib")
    from cyclonedx.schema import SchemaVersion

    validator = validation.JsonStrictValidator(SchemaVersion.V1_5)
    bill = bills.bill(evidence._hashes(), MOMENT)
    assert validator.validate_str(json.dumps(bill)) is None
    assert validator.validate_str(json.dumps(bill | {"moment": MOMENT})) is not None


@pytest.mark.parametrize(("text", "models"), [("model name\t: A\nmodel name\t: B\nmodel name\t: A\n", "A, B")])
def test_the_processor_is_known_by_its_models(tmp_path, monkeypatch, text, models):
    (tmp_path / "cpuinfo").write_text(text, encoding="utf-8")
    monkeypatch.setattr(evidence, "CPUINFO", tmp_path / "cpuinfo")
    assert evidence._processor() == models
    monkeypatch.setattr(evidence, "CPUINFO", tmp_path / "none")
    assert models not in evidence._processor()


def test_a_checkout_is_known_by_its_commit(tmp_path, monkeypatch):
    from halpipe.core import programs

    def git(*words):
        names = ["-c", "user.name=a", "-c", "user.email=a@gear.example"]
        assert programs.run(["git", "-C", str(tmp_path), *names, *words]).returncode == 0

    monkeypatch.setattr(evidence, "ROOT", tmp_path)
    assert evidence._commit() is None
    git("init", "-q")
    assert evidence._commit() is None
    git("commit", "-q", "--allow-empty", "--date=@1", "-m", "one")
    commit = evidence._commit()
    assert len(commit.id) == 40
    assert not commit.changed
    assert evidence._timestamp(evidence.Commit("", 86400, False)) == "1970-01-02T00:00:00Z"
    (tmp_path / "new").touch()
    assert evidence._commit().changed
