"""The pages on how to add an option, a format, a rule and a device, executed on changed copies."""

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
FORMAT, RULE, DEVICE = map(PAGE.with_name, ("add-a-format.md", "add-a-rule.md", "write-a-backend.md"))
PACKAGE = Path(halpipe.__file__).parent


def changes(page):
    """The files that a page changes: of each, pairs of lines before and after; of a new one, nothing and its text."""
    files, text = {}, page.read_text()
    for block in re.findall(r"^```diff\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        for name, hunks in re.findall(r"^\+\+\+ b/src/(\S+)\n((?:(?!--- ).*\n)*)", block, re.MULTILINE):
            for hunk in re.split(r"^@@.*\n", hunks, flags=re.MULTILINE)[1:]:
                lines = hunk.splitlines()
                before = [line[1:] for line in lines if not line.startswith("+")]
                after = [line[1:] for line in lines if not line.startswith("-")]
                files.setdefault(name, []).append(("\n".join(before), "\n".join(after)))
    for name, code in re.findall(r"^`src/(\S+)`:\n\n```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        files[name] = [("", code)]
    return files


def changed(root, page):
    """Copy the package, with the changes of a page."""
    shutil.copytree(PACKAGE, root / "halpipe", ignore=shutil.ignore_patterns("__pycache__"))
    for name, replacements in changes(page).items():
        path = root / name
        text = path.read_text() if path.exists() else ""
        for before, after in replacements:
            assert not before or text.count(before) == 1, f"the page does not fit {name}"
            text = text.replace(before, after) if before else after
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    return root


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    root = changed(tmp_path_factory.mktemp("copy"), PAGE)
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
    assert sorted(changes(PAGE)) == [
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


LATE = """
from dataclasses import replace
import halpipe
from halpipe.core.durations import Duration
from halpipe.models import Mode, Run, Task, TaskModel, Unit, Version

def task(name, period, wcet, **further):
    versions = [Version(name="v", wcet=wcet, units=["u"])]
    return Task(name=name, period=period, offset="0ms", slack="0.9", versions=versions, **further)

def system(latest):
    tasks = [task("a", "20ms", "3ms", latest=latest), task("b", "20ms", "6ms")]
    runs = [Run(task=each.name, versions=["v"]) for each in tasks]
    return TaskModel(name="m", units=[Unit(name="u")], tasks=tasks, modes=[Mode(name="m", runs=runs)])

def start(schedule, name):
    return next(str(job.start) for job in schedule.modes[0].jobs if job.task == name)

bound = system("0ms")
for engine in ("anneal", "exact"):
    found = halpipe.schedule(bound, engine=engine)
    assert (start(found, "a"), halpipe.verify(bound, found)) == ("0ms", []), engine
jobs = [replace(job, start=Duration.parse(at), end=Duration.parse(end)) for job, at, end in zip(
    sorted(found.modes[0].jobs, key=lambda job: job.task), ("6ms", "0ms"), ("9ms", "6ms"))]
late = replace(found, modes=(replace(found.modes[0], jobs=tuple(jobs)),))
assert not [x for x in halpipe.verify(system("6ms"), late) if x.code == "HAL0325"]
print([x.code for x in halpipe.verify(system("5999us"), late) if x.code == "HAL0325"])
saved = halpipe.save(bound, "saved.xml")
assert saved.tasks[0].latest == Duration(0) and not halpipe.diff(bound, saved)
found = halpipe.validate(replace(bound, tasks=(replace(bound.tasks[0], period=None, offset=None), *bound.tasks[1:])))
assert any('the latest 0ms but no period' in x.message for x in found), found
"""


def test_a_rule_takes_seven_files_and_is_kept_by_every_search_and_by_verify(tmp_path):
    pytest.importorskip("ortools")
    copy = changed(tmp_path, RULE)
    assert len(changes(RULE)) == 7
    done = run(copy, "-c", LATE)
    assert (done.returncode, done.stdout) == (0, "['HAL0325']\n"), done.stderr
    (copy / "graph.dot").write_bytes(first_model()["graph.dot"])
    overlay = first_model()["overlay.yaml"].decode().replace("wcet: 6ms", "wcet: 6ms, latest: 1ms")
    (copy / "overlay.yaml").write_text(overlay)
    done = run(copy, "-m", "halpipe", "import", "ros", "graph.dot", "--overlay", "overlay.yaml", "-o", "m.xml")
    assert (done.returncode, (copy / "m.xml").read_text().count('latest="1ms"')) == (0, 1), done.stderr


METER = """halpipe-regulator: 1
name: sample
resource: memory
clock: 100MHz
bus: 64bit
burst: 64B
window: 1000
guaranteed: 400MB/s
capacity: 800MB/s
backend: meter
units: {core1: {manager: 0}, core2: {manager: 1}}
meter: {step: 200000}
"""


def test_a_device_takes_three_places_and_its_model_finds_what_is_changed(tmp_path):
    copy = changed(tmp_path, DEVICE)
    assert sorted(changes(DEVICE)) == [
        "halpipe/deploy/regulator/meter.py",
        "halpipe/devices/__init__.py",
        "halpipe/exporters/regulator/meter/writer.py",
    ]
    for name, content in first_model().items():
        if name == "model.xml":
            (copy / name).write_bytes(content)
    (copy / "p.yaml").write_text(METER)
    assert run(copy, "-m", "halpipe", "schedule", "model.xml", "-o", "s.xml").returncode == 0
    export = ("-m", "halpipe", "export", "regulator", "model.xml", "s.xml", "--platform", "p.yaml", "-o", "b")
    done = run(copy, *export)
    assert done.returncode == 0, done.stderr
    done = run(copy, "-m", "halpipe", "deploy", "check", "b")
    assert (done.returncode, "meter grants what is promised" in done.stdout) == (0, True), done.stdout + done.stderr
    one_less = (
        "from pathlib import Path\n"
        "import halpipe.core.bundles as bundles, sys\n"
        "bundle = bundles.open_bundle('b')\n"
        "name = next(name for name in sorted(bundle.files) if name.startswith('meter/0-'))\n"
        "lines = bundle.files[name].decode().splitlines()\n"
        "unit, value = next(line for line in lines[1:] if not line.endswith(' 0')).split()\n"
        "text = '\\n'.join(f'{unit} {int(value) - 1}' if line.startswith(unit) else line for line in lines) + '\\n'\n"
        "files = bundles.seal(bundle.kind, {**bundle.files, name: text.encode()}, bundle.facts)\n"
        "[Path('b', each).write_bytes(content) for each, content in files.items()]\n"
    )
    assert run(copy, "-c", one_less).returncode == 0
    done = run(copy, "-m", "halpipe", "deploy", "check", "b")
    assert (done.returncode, "are granted, promised are" in done.stderr) == (1, True), done.stdout + done.stderr


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
