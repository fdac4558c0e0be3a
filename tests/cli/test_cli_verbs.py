"""What every verb prints, writes and leaves with."""

import json

import pytest

from halpipe.cli.app import GROUPS, VERBS, build
from halpipe.importers.native import read_schedule
from halpipe.models import Status


def test_model_to_verified_schedule_and_report(halpipe, halpipe_process, folder):
    assert halpipe("validate", "model.xml").returncode == 0
    made = halpipe_process("schedule", "model.xml", "-o", "schedule.xml")
    assert (made.returncode, made.stdout) == (0, "")
    assert "verified" in made.stderr
    assert "valid; least margin of a WCET" in made.stderr
    checked = halpipe("verify", "model.xml", "schedule.xml")
    assert checked.returncode == 0
    assert "no violation" in checked.stdout
    for format, name in (("report", "r.html"), ("graph", "g.dot"), ("trace", "t.json")):
        assert halpipe("export", format, "model.xml", "schedule.xml", "-o", name).returncode == 0
        assert (folder / name).stat().st_size > 100


def test_standard_input_and_output(halpipe_process, folder):
    text = (folder / "model.xml").read_text()
    made = halpipe_process("schedule", "-", "-o", "-", stdin=text)
    assert made.returncode == 0
    assert made.stdout.startswith('<?xml version="1.0" encoding="UTF-8"?>\n<schedule')
    (folder / "schedule.xml").write_text(made.stdout)
    assert halpipe_process("verify", "model.xml", "schedule.xml").returncode == 0


def test_same_seed_same_bytes_and_the_seed_is_recorded(halpipe, folder):
    for name in ("a.xml", "b.xml"):
        halpipe("schedule", "model.xml", "--seed", "7", "-o", name)
    assert (folder / "a.xml").read_bytes() == (folder / "b.xml").read_bytes()
    assert read_schedule(str(folder / "a.xml")).seed == 7


def test_a_failed_search_keeps_the_old_output_and_saves_its_best(halpipe, folder):
    (folder / "schedule.xml").write_text("precious")
    failed = halpipe("schedule", "hopeless.xml", "--budget", "50", "-o", "schedule.xml")
    assert failed.returncode == 3
    assert "HAL0401" in failed.stderr
    assert "HAL0407" in failed.stderr
    assert (folder / "schedule.xml").read_text() == "precious"
    best = read_schedule(str(folder / "schedule.best.xml"))
    assert [mode.status for mode in best.modes] == [Status.NOT_FOUND]
    assert best.modes[0].cost.total > 0
    assert halpipe("verify", "hopeless.xml", "schedule.best.xml").returncode == 1
    assert halpipe("export", "report", "hopeless.xml", "schedule.best.xml", "-o", "r.html").returncode == 1
    assert not (folder / "r.html").exists()


def test_exporters_refuse_the_schedule_of_another_model(halpipe, folder):
    halpipe("schedule", "model.xml", "-o", "schedule.xml")
    text = (folder / "model.xml").read_text()
    (folder / "changed.xml").write_text(text.replace('wcet="3ms"', 'wcet="2.5ms"'))
    refused = halpipe("export", "report", "changed.xml", "schedule.xml", "-o", "r.html")
    assert refused.returncode == 1
    assert not (folder / "r.html").exists()


def test_a_time_limit_ends_the_search(halpipe):
    failed = halpipe("schedule", "hopeless.xml", "--budget", "100000000", "--time-limit", "0.5", "-o", "s.xml")
    assert failed.returncode == 3


def test_one_mode_only(halpipe):
    assert halpipe("schedule", "model.xml", "--mode", "all", "-o", "s.xml").returncode == 0
    unknown = halpipe("schedule", "model.xml", "--mode", "al", "-o", "s.xml")
    assert unknown.returncode == 2
    assert 'did you mean "all"' in unknown.stderr


@pytest.mark.parametrize("tick", ["0.3ms", "nonsense", "0ms"])
def test_a_tick_that_does_not_fit(halpipe, folder, tick):
    failed = halpipe("schedule", "model.xml", "--tick", tick, "-o", "s.xml")
    assert failed.returncode == (1 if tick == "0.3ms" else 2)
    assert not (folder / "s.xml").exists()


def test_a_coarse_tick_that_fits(halpipe):
    assert halpipe("schedule", "model.xml", "--tick", "2ms", "-o", "s.xml").returncode == 0
    assert halpipe("verify", "model.xml", "s.xml").returncode == 0


def test_validate_proves_that_a_tick_is_too_coarse(halpipe):
    refused = halpipe("validate", "model.xml", "--tick", "20ms")
    assert (refused.returncode, "HAL0415" in refused.stdout) == (1, True)
    assert halpipe("validate", "model.xml", "--tick", "1us").returncode == 0
    assert halpipe("validate", "model.xml", "--tick", "0ms").returncode == 2


def test_show_prints_every_job(halpipe):
    halpipe("schedule", "model.xml", "-o", "s.xml")
    shown = halpipe("show", "s.xml")
    assert shown.returncode == 0
    for word in ("sense", "act", "c1", "mem", "chain c"):
        assert word in shown.stdout


def test_doctor_names_versions_and_formats(halpipe):
    said = halpipe("doctor")
    assert said.returncode == 0
    assert "importers: amalthea, arxml, ros" in said.stdout
    (exporters,) = [line for line in said.stdout.splitlines() if line.strip().startswith("exporters:")]
    assert {"amalthea", "graph", "report", "trace"} <= set(exporters.partition(":")[2].replace(",", " ").split())


def test_findings_as_json_and_sarif(halpipe, folder):
    text = (folder / "model.xml").read_text()
    (folder / "bad.xml").write_text(text.replace('<precedence task="sense"', '<precedence task="sens"'))
    found = json.loads(halpipe("validate", "bad.xml", "--format", "json").stdout)
    assert any("sens" in d["message"] and d["file"] == "bad.xml" and d["line"] > 0 for d in found)
    log = json.loads(halpipe("validate", "bad.xml", "--format", "sarif").stdout)
    assert {r["ruleId"] for r in log["runs"][0]["results"]} == {d["code"] for d in found}


def test_errors_before_the_verb_itself_come_as_json_too(halpipe):
    found = json.loads(halpipe("validate", "absent.xml", "--format", "json").stderr)
    assert [d["code"] for d in found] == ["HAL0001"]


def test_notes_are_counted_and_shown_on_request(halpipe, folder):
    text = (folder / "model.xml").read_text()
    (folder / "odd.xml").write_text(text.replace("</platform>", '<resource name="unused"/></platform>'))
    few, all = halpipe("validate", "odd.xml"), halpipe("validate", "odd.xml", "--verbose")
    assert (few.returncode, all.returncode) == (0, 0)
    assert "note" in few.stdout
    assert "unused" not in few.stdout
    assert "unused" in all.stdout


@pytest.mark.parametrize("asked", [[], ["-h"], ["--help"]])
def test_the_overview_is_that_of_the_whole_command_line(halpipe, asked, monkeypatch):
    shown = halpipe(*asked)
    monkeypatch.setattr("halpipe.cli.app.app_for", lambda arguments: build(VERBS))
    whole = halpipe(*asked)
    assert shown.returncode == whole.returncode
    said, all_said = shown.stdout + shown.stderr, whole.stdout + whole.stderr
    assert sorted(said.splitlines()) == sorted(all_said.splitlines())  # typer itself has groups last
    places = [said.index(f"\n  {verb} ") for verb in VERBS]
    assert places == sorted(places)


def test_every_verb_has_help(halpipe):
    app = build(VERBS)
    assert [group.name for group in app.registered_groups] == list(GROUPS)
    verbs = [((), command) for command in app.registered_commands]
    verbs += [((group.name,), c) for group in app.registered_groups for c in group.typer_instance.registered_commands]
    assert len(verbs) > len(app.registered_commands)
    for group, command in verbs:
        helped = halpipe(*group, command.name, "--help")
        assert helped.returncode == 0
        assert command.callback.__doc__.split(".")[0].split(":")[0] in " ".join(helped.stdout.split())


def test_usage_errors(halpipe):
    assert halpipe("schedule").returncode == 2
    assert halpipe("nonsense").returncode == 2
    assert halpipe("export", "report", "model.xml", "-o", "r.html").returncode == 1  # needs a schedule
    unknown = halpipe("export", "raport", "model.xml", "-o", "r.html")
    assert unknown.returncode == 2
    assert 'did you mean "report"' in unknown.stderr


def test_compare_a_trace_with_the_schedule(halpipe, folder):
    assert halpipe("schedule", "model.xml", "-o", "schedule.xml").returncode == 0
    assert halpipe("export", "btf", "model.xml", "schedule.xml", "-o", "run.btf").returncode == 0
    clean = halpipe("compare", "schedule.xml", "run.btf")
    assert (clean.returncode, clean.stderr) == (0, "")
    lines = (folder / "run.btf").read_text().splitlines()
    last = next(number for number, line in reversed([*enumerate(lines)]) if line.endswith("terminate"))
    time, _, rest = lines[last].partition(",")
    lines[last] = f"{int(time) + 7},{rest}"
    (folder / "late.btf").write_text("\n".join(lines))
    late = halpipe("compare", "schedule.xml", "late.btf", "--format", "json")
    assert late.returncode == 1
    assert {"HAL1106", "HAL1107"} <= {found["code"] for found in json.loads(late.stdout)}
    assert halpipe("compare", "schedule.xml", "late.btf", "--tolerance", "7ns").returncode == 0
    assert halpipe("compare", "schedule.xml", "late.btf", "--tolerance", "soon").returncode == 2
    assert halpipe("compare", "schedule.xml", "model.xml").returncode == 1


def test_show_draws_every_mode_and_lists_the_switches(halpipe, folder):
    assert halpipe("schedule", "model.xml", "-o", "schedule.xml").returncode == 0
    shown = halpipe("show", "schedule.xml")
    planned = read_schedule(str(folder / "schedule.xml"))
    assert shown.returncode == 0
    for table in planned.modes:
        assert f"mode {table.name}: {len(table.jobs)} jobs" in shown.stdout
        one = halpipe("show", "schedule.xml", "--mode", table.name).stdout
        assert [m.name for m in planned.modes if f"mode {m.name}:" in one] == [table.name]
    assert halpipe("show", "schedule.xml", "--mode", "nonsense").returncode == 2
