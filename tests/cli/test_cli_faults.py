"""Every call that a verb makes for its files fails once: the old output is whole, or the new one, and nothing else."""

import errno
import shutil

import pytest
from test_cli_regulator import PLATFORM

from command_line import run_here
from faults import Faults, failing
from limits import GRAPH, OVERLAY, PIPELINE

VERBS = {
    "schedule": ("schedule model.xml -o out/s.xml -q", ["s.xml"]),
    "a search that fails": ("schedule hopeless.xml --budget 5 -o out/h.xml -q", ["h.best.xml", "h.resume"]),
    "generate": ("generate -o out/g.xml --witness out/w.xml --tasks 3 -q", ["g.xml", "w.xml"]),
    "export a file": ("export report model.xml s.xml -o out/r.html -q", ["r.html"]),
    "export a folder": ("export regulator model.xml s.xml --platform platform.yaml -o out/cfg -q", ["cfg"]),
    "import": ("import amalthea a.amxmi -o out/m.xml --report out/i.json -q", ["m.xml", "i.json"]),
    "run": ("run pipe.yaml -q", ["s.xml", "r.html"]),
    "new": ("new out/first", ["first"]),
    "schedule a fleet": ("schedule one.xml model.xml -o out/fleet -q", ["fleet/one.xml", "fleet/model.xml"]),
    "import a graph": ("import ros a.dot --overlay o.yaml -o out/m.xml --report out/i.json -q", ["m.xml", "i.json"]),
    "export to a diagram": ("export graph model.xml s.xml -o out/g.dot -q", ["g.dot"]),
}
KNOWN = (0, 1, 3)


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """A folder with an input for each verb, and what each verb writes."""
    from halpipe.exporters.native import format_model
    from support import hopeless_model, small_model

    folder = tmp_path_factory.mktemp("sources")
    (folder / "model.xml").write_bytes(format_model(small_model()))
    (folder / "hopeless.xml").write_bytes(format_model(hopeless_model()))
    (folder / "platform.yaml").write_text(PLATFORM)
    (folder / "pipe.yaml").write_text(PIPELINE)
    (folder / "one.xml").write_bytes((folder / "model.xml").read_bytes())
    (folder / "a.dot").write_text(GRAPH)
    (folder / "o.yaml").write_text(OVERLAY)
    assert run_here(folder, "schedule", "model.xml", "-o", "s.xml", "-q").returncode == 0
    assert run_here(folder, "export", "amalthea", "model.xml", "s.xml", "-o", "a.amxmi", "-q").returncode == 0
    return folder


def contents(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def whole(found, name, one, other):
    """Whether an output, a file or a folder, is entirely that of `one` or of `other`."""
    parts = [{key: value for key, value in state.items() if key == name or key.startswith(f"{name}/")} for state in
             (found, one, other)]  # fmt: skip
    return parts[0] in parts[1:]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EACCES])
@pytest.mark.parametrize(
    "verb",  # test_files_directory.py has the quicker one for folders
    [pytest.param(verb, marks=pytest.mark.slow) if "folder" in verb else verb for verb in VERBS],
)
def test_whichever_call_fails_outputs_are_whole(sources, tmp_path, verb, code):
    command, outputs = VERBS[verb]

    def fresh(name):
        place = tmp_path / name
        shutil.copytree(sources, place)
        (place / "out").mkdir()
        return place

    place = fresh("good")
    counting = Faults()
    with failing(counting):
        assert run_here(place, *command.split()).returncode in KNOWN
    good = contents(place / "out")
    assert counting.calls, "the seam is met"
    missing = [name for name in outputs if not any(key == name or key.startswith(f"{name}/") for key in good)]
    assert not missing, "it does its work where nothing fails"
    for number in range(1, len(counting.calls) + 1):
        site = f"{verb}: call {number}, {counting.calls[number - 1]}"
        place = fresh(str(number))
        before = {}
        if number % 2:  # every other time, over older output
            shutil.copytree(tmp_path / "good" / "out", place / "out", dirs_exist_ok=True)
            before = contents(place / "out")
        inputs = {name: data for name, data in contents(place).items() if not name.startswith("out/")}
        with failing(Faults(number, code)):
            run = run_here(place, *command.split())
        assert run.returncode in KNOWN, (site, run.stderr)
        assert "Traceback" not in run.stderr, site
        assert "internal error" not in run.stderr, site
        after = contents(place / "out")
        for output in outputs:
            assert whole(after, output, before, good), site
        if run.returncode == 0:
            assert all(whole(after, output, good, good) for output in outputs), site
        left = {name for name in after if name.split("/")[0] not in {output.split("/")[0] for output in outputs}}
        # An older output that could not be read may be the user's own: the new one stands beside it, by a number.
        left -= {name for name in left if after[name] == good.get(name.replace("-2.", "."))}
        assert not left or "unlink" in site or "rmtree" in site or "former" in str(left), (site, left)
        assert {name: data for name, data in contents(place).items() if not name.startswith("out/")} == inputs, site
        shutil.rmtree(place)
