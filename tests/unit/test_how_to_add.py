"""The pages on how to add an option and a format, executed: a changed copy of the package, and a package beside it."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import halpipe
from halpipe.starters import first_model

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "add-an-option.md"
FORMAT = PAGE.with_name("add-a-format.md")
PACKAGE = Path(halpipe.__file__).parent


def changes():
    """The files that the page changes: of each, pairs of lines before and after."""
    files = {}
    for block in re.findall(r"^```diff\n(.*?)^```", PAGE.read_text(), re.MULTILINE | re.DOTALL):
        for name, text in re.findall(r"^\+\+\+ b/src/(\S+)\n@@.*\n((?:(?!--- ).*\n)*)", block, re.MULTILINE):
            lines = text.splitlines()
            before = [line[1:] for line in lines if not line.startswith("+")]
            after = [line[1:] for line in lines if not line.startswith("-")]
            files.setdefault(name, []).append(("\n".join(before), "\n".join(after)))
    return files


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    root = tmp_path_factory.mktemp("copy")
    shutil.copytree(PACKAGE, root / "halpipe", ignore=shutil.ignore_patterns("__pycache__"))
    for name, replacements in changes().items():
        text = (root / name).read_text()
        for before, after in replacements:
            assert text.count(before) == 1, f"the page does not fit {name}"
            text = text.replace(before, after)
        (root / name).write_text(text)
    for name, content in first_model().items():
        (root / name).parent.mkdir(exist_ok=True)
        (root / name).write_bytes(content)
    (root / "p.yaml").write_text(
        "halpipe-pipeline: 1\nimport: {format: ros, inputs: graph.dot, overlay: overlay.yaml, vehicle: truck}\n"
        "model: m.xml\nschedule: {output: s.xml}\nexports: [{format: btf, output: t.btf, note: nightly}]\n"
    )
    return root


def run(copy, *arguments):
    environment = os.environ | {"PYTHONPATH": str(copy)}
    return subprocess.run(
        [sys.executable, *arguments], cwd=copy, env=environment, capture_output=True, text=True, check=False
    )


def test_two_places_are_enough_for_each():
    assert sorted(changes()) == [
        "halpipe/exporters/btf/__init__.py",
        "halpipe/exporters/btf/events.py",
        "halpipe/importers/ros/build.py",
        "halpipe/importers/ros/options.py",
    ]


def test_the_command_line_has_them(copy):
    imported = run(copy, "-m", "halpipe", "import", "ros", "-h").stdout
    assert "--vehicle car|truck" in imported
    assert "--note TEXT" in run(copy, "-m", "halpipe", "export", "btf", "-h").stdout
    words = ("import", "ros", "graph.dot", "--overlay", "overlay.yaml", "-o", "x.xml", "--vehicle", "truk")
    refused = run(copy, "-m", "halpipe", *words)
    assert (refused.returncode, 'did you mean "truck"?' in refused.stderr) == (2, True), refused.stderr
    assert run(copy, "-m", "halpipe", "export", "trace", "m.xml", "-o", "x.json", "--note", "n").returncode == 2


def test_a_pipeline_file_has_them(copy):
    done = run(copy, "-m", "halpipe", "run", "p.yaml", "-q")
    assert done.returncode == 0, done.stderr
    assert re.search(r'name="[^"]+-truck"', (copy / "m.xml").read_text())
    assert "\n# nightly\n" in (copy / "t.btf").read_text()


def test_python_has_them(copy):
    program = (
        "import halpipe\n"
        "model = halpipe.import_model('ros', 'graph.dot', overlay='overlay.yaml', vehicle='truck').model\n"
        "schedule = halpipe.schedule(model)\n"
        "trace = halpipe.export('btf', model, schedule, note='nightly')['']\n"
        "print(model.name, b'\\n# nightly\\n' in trace)\n"
    )
    done = run(copy, "-c", program)
    assert done.stdout.split() == [done.stdout.split()[0], "True"], done.stderr
    assert done.stdout.split()[0].endswith("-truck")


@pytest.fixture(scope="module")
def plugin(tmp_path_factory):
    """A folder with the package of the page, installed as pip leaves it: modules, and metadata beside them."""
    root = tmp_path_factory.mktemp("plugin")
    blocks = dict.fromkeys(("toml", "python"), "")
    for language, text in re.findall(r"^```(toml|python)\n(.*?)^```$", FORMAT.read_text(), re.MULTILINE | re.DOTALL):
        blocks[language] += text + "\n\n"
    (root / "halpipe_lines.py").write_text(blocks["python"])
    project = tomllib.loads(blocks["toml"])["project"]
    metadata = root / f"halpipe_lines-{project['version']}.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: 1.0\n")
    groups = (
        f"[{group}]\n" + "".join(f"{name} = {target}\n" for name, target in points.items())
        for group, points in project["entry-points"].items()
    )
    (metadata / "entry_points.txt").write_text("\n".join(groups))
    (root / "tasks.txt").write_text("camera 20ms 5ms core0\nplan 40ms 12ms core1\n")
    return root


def test_a_package_adds_an_importer_and_an_exporter(plugin):
    def halpipe_(*words):
        done = run(plugin, "-m", "halpipe", *words)
        assert done.returncode == 0, done.stderr
        return done

    assert "--unit NAME" in halpipe_("import", "lines", "-h").stdout
    halpipe_("import", "lines", "tasks.txt", "--unit", "core0", "-o", "model.xml")
    halpipe_("schedule", "model.xml", "-o", "schedule.xml")
    halpipe_("export", "starts", "model.xml", "schedule.xml", "-o", "starts.txt")
    lines = [line.split() for line in (plugin / "starts.txt").read_text().splitlines()]
    assert sorted((mode, task) for _, mode, task in lines) == [("default", "camera")] * 2 + [("default", "plan")]


def test_the_importer_of_the_page_reports_every_fault(plugin):
    (plugin / "bad.txt").write_text("a 10ms 1ms u more\nb 10ms\nc soon 1ms u\n")
    done = run(plugin, "-m", "halpipe", "import", "lines", "bad.txt", "-o", "bad.xml")
    assert (done.returncode, [done.stderr.count(f"LINES00{n}") for n in (1, 2)]) == (1, [2, 1]), done.stderr
    (plugin / "odd.txt").write_text("a 10ms 1ms u more\n")
    assert run(plugin, "-m", "halpipe", "import", "lines", "odd.txt", "-o", "o.xml", "--strict").returncode == 5
