"""What the documentation shows is what happens: its commands are run and its output lines looked for.

A block marked ``console`` holds commands after ``$`` with the output that is shown of each; ``...`` stands for output
left out, within a line for its rest. A comment ``# exit code N`` after a command says how it ends. Blocks marked
``yaml`` and ``xml`` must be read without a complaint; those in how-to guides are saved as the text says.
"""

import re
import shlex
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import halpipe.cli
from ctf_writer import ros_trace
from halpipe.exporters.regulator.platform import read_platform
from halpipe.flow.plan import read_plan
from halpipe.importers.native import read_model, read_schedule
from halpipe.importers.overlay import read_overlays
from halpipe.pipeline.checked import validate_model, verify_schedule
from halpipe.starters import first_table

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
ARXML = ROOT / "tests" / "unit" / "importers" / "arxml_fixtures" / "findings" / "HAL0541-unmapped.arxml"
ENGINE = ROOT / "tests" / "unit" / "importers" / "arxml_fixtures" / "preemptive.arxml"
AMXMI = ROOT / "tests" / "unit" / "importers" / "amalthea" / "amalthea_fixtures" / "camera.amxmi"

AUTOWARE = ROOT / "tests" / "unit" / "importers" / "ros_fixtures" / "autoware.yaml"

BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
SAVED_AS = re.compile(r"[Ss]ave (?:it|the overlay) as `([\w.-]+)`")


def pages():
    return [ROOT / "README.md", *sorted(DOCS.rglob("*.md")), *sorted((ROOT / "examples").rglob("README.md"))]


def blocks(page, kind):
    return [text for found, text in BLOCK.findall(page.read_text(encoding="utf-8")) if found == kind]


def name_of(page):
    return page.relative_to(ROOT).as_posix()


WITH_COMMANDS = [page for page in pages() if blocks(page, "console")]

IN_A_WORKING_COPY = {"docs/how-to/build-from-source.md"}
SLOW = {"docs/tutorial/drive-roboracer.md", "docs/how-to/check-riscv.md", "docs/how-to/deploy-riscv.md"}
"""Pages whose commands compile and simulate for seconds; riscv/ and roboracer/ do so in the fast tier, too."""


def params(chosen):
    return [pytest.param(p, id=name_of(p), marks=[pytest.mark.slow] * (name_of(p) in SLOW)) for p in chosen]


def commands(text):
    """The commands of a block as (command, exit code, lines shown)."""
    found = []
    for line in text.splitlines():
        if line.startswith("$ "):
            command, _, comment = line[2:].partition("     # ")
            found.append((command, int(comment.removeprefix("exit code ") or 0), []))
        else:
            found[-1][2].append(line)
    return found


def run(command, capfd):
    """Run a command in this process if it is one of ours without the shell's help; it starts faster."""
    words = shlex.split(command)
    if words[0] == "halpipe" and not {">", "|", "&&"} & set(words):
        capfd.readouterr()
        code = halpipe.cli.invoke(words[1:])
        return code, "".join(capfd.readouterr())
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False, timeout=300)
    return done.returncode, done.stdout + done.stderr


def check_shown(shown, output, command):
    """Each line shown stands in the output, in order; without ``...`` between two, they follow each other.

    The width of white space does not count: that of columns depends on what a search finds.
    """
    lines, place, skipped = [" ".join(line.split()) for line in output.splitlines()], 0, False
    for text in shown:
        if text.strip() == "...":
            skipped = True
            continue
        wanted, *rest = " ".join(text.split()).split("...")
        for number in range(place, len(lines)):
            if lines[number] == wanted or (rest and lines[number].startswith(wanted.rstrip())):
                break
            assert skipped, f"{command}: after {lines[max(0, place - 1)]!r} comes {lines[number]!r}, not {text!r}"
        else:
            pytest.fail(f"{command} does not print {text!r}, but:\n{output}")
        place, skipped = number + 1, False
    assert skipped or place == len(lines) or not shown, f"{command} prints more: {lines[place:]}"


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    """A copy of the example, with what a reader of the how-to guides would have besides."""
    shutil.copytree(ROOT / "examples" / "roboracer", tmp_path / "w", ignore=shutil.ignore_patterns("out"))
    shutil.copytree(ROOT / "examples" / "platforms", tmp_path / "platforms")
    for folder in ("extract", "ecuc"):
        (tmp_path / "w" / folder).mkdir()
    text = ARXML.read_text()
    cut = text.index("<SHORT-NAME>Ecu</SHORT-NAME>")
    begin = text.rindex("<AR-PACKAGE>", 0, cut)
    end = text.rindex("</AR-PACKAGES>")
    head = text[: text.index("<AR-PACKAGE>")]
    (tmp_path / "w" / "extract" / "pump.arxml").write_text(text[:begin] + text[end:])
    (tmp_path / "w" / "ecuc" / "cores.arxml").write_text(head + text[begin:])
    shutil.copy(AMXMI, tmp_path / "w" / "camera.amxmi")
    shutil.copy(ENGINE, tmp_path / "w" / "engine.arxml")
    (tmp_path / "w" / "autoware").mkdir()
    shutil.copy(AUTOWARE, tmp_path / "w" / "autoware" / "architecture.yaml")
    ros_trace(switches=True).write(tmp_path / "w" / "drive")
    monkeypatch.chdir(tmp_path / "w")
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}:{ROOT}:/usr/bin:/bin")
    return tmp_path / "w"


@pytest.mark.parametrize("page", params(WITH_COMMANDS))
def test_commands_do_what_the_page_shows(page, workplace, capfd):
    if name_of(page) in IN_A_WORKING_COPY:
        copy_sources(workplace)
    text = page.read_text(encoding="utf-8")
    saved = SAVED_AS.findall(text)
    for name, content in zip(saved, blocks(page, "yaml"), strict=False):
        (workplace / name).write_text(content)
    for block in blocks(page, "console"):
        for command, code, shown in commands(block):
            ended, output = run(command, capfd)
            assert ended == code, f"{command} ends with {ended}:\n{output}"
            check_shown(shown, output, command)


def copy_sources(folder):
    for name in ("build_native.py", "pyproject.toml"):
        shutil.copy(ROOT / name, folder)
    shutil.copytree(DOCS, folder / "docs", ignore=shutil.ignore_patterns("__pycache__", "pictures", "safety"))
    nothing_made = shutil.ignore_patterns("__pycache__", "*.so", "out")
    shutil.copytree(ROOT / "src" / "halpipe", folder / "src" / "halpipe", ignore=nothing_made)


LISTS = [
    # Four seconds: the pages of each command, above, are tried one by one in the fast tier.
    pytest.param(ROOT / "README.md", id="README.md", marks=pytest.mark.slow),
    pytest.param(ROOT / "examples" / "roboracer" / "README.md", id="examples/roboracer/README.md"),
]


@pytest.mark.parametrize("page", LISTS)
def test_commands_that_are_listed_work_one_after_another(page, workplace, capfd):
    (workplace / "wcets.yaml").write_text('halpipe-overlay: 1\ntasks: {"*": {wcet: 1ms}}\n')
    shutil.copy(AMXMI, workplace / "system.amxmi")
    for name, table in first_table().items():
        (workplace / name).write_bytes(table)
    shutil.copy(ROOT / "examples" / "platforms" / "cores-table.yaml", workplace / "cores.yaml")
    tried = 0
    for command in commands_listed(page):
        if command.split()[1] == "VERB" or (".svg" in command and shutil.which("dot") is None):
            continue
        if {"riscv", "bundle/", "trace.csv"} & set(command.split()) and find_spec("unicorn") is None:
            continue  # the extra [riscv]
        ended, output = run(command, capfd)
        assert ended == 0, f"{command} ends with {ended}:\n{output}"
        tried += 1
    assert tried >= 5


def test_every_guide_to_an_import_is_among_them():
    assert {name_of(page) for page in WITH_COMMANDS} >= SLOW
    assert {
        "docs/tutorial/roboracer.md",
        "docs/how-to/import-a-ros-stack.md",
        "docs/how-to/import-an-ecu-extract.md",
        "docs/how-to/import-amalthea.md",
    } <= {name_of(page) for page in WITH_COMMANDS}


@pytest.mark.parametrize("page", [p for p in pages() if blocks(p, "yaml")], ids=name_of)
def test_yaml_that_is_shown_is_read(page, tmp_path):
    path = tmp_path / "shown.yaml"
    for text in blocks(page, "yaml"):
        if "halpipe-pipeline" in text:
            path.write_text(text)
            read_plan(str(path))
        elif "halpipe-regulator" in text:
            path.write_text(text)
            read_platform(str(path))
        else:
            path.write_text(text if "halpipe-overlay" in text else "halpipe-overlay: 1\n" + text)
            read_overlays([str(path)])


@pytest.mark.parametrize("page", [p for p in pages() if blocks(p, "xml")], ids=name_of)
def test_xml_that_is_shown_is_a_valid_model_and_a_valid_schedule(page, tmp_path):
    shown, schedule = blocks(page, "xml")
    (tmp_path / "model.xml").write_text(shown)
    (tmp_path / "schedule.xml").write_text(schedule)
    model = read_model(str(tmp_path / "model.xml"))
    assert validate_model(model) == []
    assert verify_schedule(model, read_schedule(str(tmp_path / "schedule.xml"))) == []


OPTION = re.compile(r"(?<![\w-])--[a-z][a-z-]+")
NAMED = re.compile(r"`(halpipe [^`]+)`|^(?:    |\$ )(halpipe [a-z].*)", re.MULTILINE)
LISTED = re.compile(r"^(halpipe [a-z].*)", re.MULTILINE)


def commands_listed(page):
    """What stands in indented lines and in blocks of no kind, without comments."""
    text = page.read_text(encoding="utf-8")
    lines = re.findall(r"^    (halpipe [a-z].*)", text, re.MULTILINE)
    lines += [line for block in blocks(page, "") for line in LISTED.findall(block)]
    return [line.partition("  #")[0].rstrip() for line in lines]


def commands_named(page):
    """What stands in code spans, in indented lines, after ``$``, and in blocks of no kind."""
    text = page.read_text(encoding="utf-8")
    found = [span or line for span, line in NAMED.findall(text)]
    return found + [line for block in blocks(page, "") for line in LISTED.findall(block)]


@pytest.mark.parametrize("page", [p for p in pages() if commands_named(p)], ids=name_of)
def test_commands_and_options_that_are_named_exist(page):
    """Every ``halpipe verb`` has its verb, and every option after it is one of that verb's."""
    reference = (DOCS / "reference" / "cli.md").read_text(encoding="utf-8")
    sections = dict(re.findall(r"^## halpipe ([\w -]+)\n(.*?)(?=^## |\Z)", reference, re.MULTILINE | re.DOTALL))
    groups = {verb.split()[0] for verb in sections if " " in verb}
    for command in commands_named(page):
        words = command.split()[1:3]
        verb = " ".join(words) if words[0] in groups else words[0]
        placeholder = {"VERB", "FORMAT", "NAME"} & set(words) or words[-1] in groups
        if verb.startswith("-") or placeholder:
            continue
        assert verb in sections, f"{name_of(page)}: there is no halpipe {verb}"
        unknown = [o for o in OPTION.findall(command) if o not in sections[verb] and o != "--help"]
        assert not unknown, f"{name_of(page)}: halpipe {verb} has no {', '.join(unknown)}"
