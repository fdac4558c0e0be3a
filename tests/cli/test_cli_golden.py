"""A session of commands on one model and schedule: all that they print, with exit codes.

Golden files hold columns, counts, plurals and what is shown of many; each file is one chapter of the session. Nothing
in it depends on what a search finds.
"""

import shutil
from functools import partial
from pathlib import Path

import pytest

from command_line import run_here
from golden_file import assert_golden

FIXTURES = Path(__file__).parents[1] / "fixtures" / "session"

CHAPTERS = {
    "schedules": [
        "show schedule.xml",
        "show schedule.xml --mode limp --model model.xml",
        "show schedule.xml --mode limp --format csv",
        "show many.xml --mode drive",
        "show schedule.xml --mode lim",
        "verify model.xml schedule.xml",
        "verify model.xml moved.xml",
        "verify model.xml moved.xml -v",
        "diff schedule.xml schedule.xml",
        "diff schedule.xml moved.xml",
        "diff model.xml slower.xml",
        "diff model.xml slower.xml --format json",
        "diff model.xml model.xml",
        "diff model.xml schedule.xml",
        "sensitivity model.xml schedule.xml",
        "export report model.xml moved.xml -o r.html",
        "export graph model.xml schedule.xml -o g.dot",
        "export btf model.xml schedule.xml -o t.btf --mode all",
    ],
    "models": [
        "validate model.xml",
        "validate broken.xml",
        "validate broken.xml -v",
        "validate broken.xml -q",
        "validate slower.xml --format json",
        "schedule broken.xml -o b.xml",
        "schedule model.xml slower.xml absent.xml -o many",
        "import ros graph.dot --overlay overlay.yaml -o imported.xml",
        "import ros graph.dot --overlay overlay.yaml -o imported.xml --coverage",
        "import ros graph.dot -o imported.xml",
        "new book --table",
        "new book --table",
        "generate -o g.xml --tasks 5 --units 2 --access-windows 40 --seed 3",
        "generate -o g.xml --period 10ms --period 20ms --units 1 --unit-types 1 --seed 3 --witness w.xml",
    ],
    "recordings": [
        "compare schedule.xml late.csv --mode drive --model model.xml",
        "compare schedule.xml late.csv --mode drive --model model.xml --origin 0ms --tolerance 3ms --histogram",
        "compare schedule.xml late.csv",
        "deploy check nothing",
    ],
}

LATE = """task,unit,start,end
camera,core1,0,7000000
detection,core2,7000000,12000000
brake,core1,8000000,9000000
other,core1,9000000,9500000
brake,core2,22000000,23000000
"""


@pytest.fixture
def session(tmp_path):
    """Run commands in a folder with a model and its schedule, and both with faults."""
    for path in FIXTURES.iterdir():
        shutil.copy(path, tmp_path)
    model, schedule = (FIXTURES.joinpath(name).read_text() for name in ("model.xml", "schedule.xml"))
    mode = '<mode name="drive" hyperperiod="40ms" status="valid" margin="1/3" margin-bound="1.5">'
    extra = '<job task="x" index="{}" start="39ms" end="40ms" version="v" units="core3"/>'
    assert mode in schedule
    for name, text in {
        "slower.xml": model.replace('wcet="6ms"', 'wcet="7ms"'),
        "broken.xml": model.replace('task="camera"', 'task="camara"').replace('names="core1', 'names="core'),
        "moved.xml": schedule.replace('units="core2"', 'units="core1"'),
        "many.xml": schedule.replace(mode, mode + "".join(map(extra.format, range(192)))),
        "late.csv": LATE,
    }.items():
        (tmp_path / name).write_text(text)
    return partial(run_here, tmp_path)


@pytest.mark.parametrize("chapter", CHAPTERS)
def test_a_chapter_prints_what_its_golden_file_holds(session, chapter, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    lines = []
    for command in CHAPTERS[chapter]:
        done = session(*command.split())
        lines += [f"$ halpipe {command}  # exit code {done.returncode}", done.stdout + done.stderr]
    assert_golden(f"{chapter}.txt", "\n".join(lines), "cli")


def test_two_outputs_of_a_check_are_two_files(session):
    done = session("deploy", "check", "nothing", "--trace", "t.csv", "--bandwidth", "t.csv")
    assert (done.returncode, "give another file than for --trace" in done.stderr) == (2, True)
