"""The workbench without a server: edits, pins, history, variants, saving."""

import os
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.core.files import protecting_inputs
from halpipe.exporters.native import format_model
from halpipe.exporters.report import ReportOptions
from halpipe.exporters.report import scene as drawing
from halpipe.exporters.report.scene import scene
from halpipe.importers.native import parse_model, read_model
from halpipe.models import Chain
from halpipe.pipeline.checked import verify_schedule
from halpipe.pipeline.whatif.sensitivity import sensitivities
from halpipe.starters import first_model
from halpipe.workbench.edits import Edit, Pin, edited
from halpipe.workbench.journal import EDITS_LOST
from halpipe.workbench.picture import picture
from halpipe.workbench.session import Session
from support import model, ms, task, version


@pytest.fixture
def session(tmp_path):
    path = tmp_path / "model.xml"
    path.write_bytes(first_model()["model.xml"])
    found = Session(str(path))
    found.begin()
    return found


def wcet(value, task="camera", version="full"):
    return Edit("version", task, "wcet", value, version)


def verified(session):
    """What verify says of the shown schedule for the shown model, as they would be read from files."""
    model = parse_model(format_model(session.state.model), session.path)
    return [found for found in verify_schedule(model, session.state.schedule) if found.is_error]


def test_an_edit_gives_a_verified_schedule_of_the_edited_model(session):
    session.edit(wcet("7ms"))
    assert session.state.model.task("camera").version("full").wcet == Duration.parse("7ms")
    assert session.state.is_valid
    assert verified(session) == []


def figures_of_chains(told):
    cells = [cell for form in told["forms"] if form["table"] == "chains" for cell in form["cells"]]
    return [texts for cell in cells if (texts := cell.get("by_mode"))]


def test_an_edit_is_drawn_before_it_is_solved(session):
    before = {job.index: job for job in session.state.schedule.mode("drive").jobs if job.task == "camera"}
    session.edit(wcet("7ms"))
    told = picture(session)
    assert (told["solved"], told["valid"], told["tasks"][0]["versions"][0]["wcet"]) == (False, False, "7ms")
    drawn = [job for job in session.shown.schedule.mode("drive").jobs if job.task == "camera"]
    more = Duration.parse("1ms")
    expected = {job.index: job.end + more if job.version == "full" else job.end for job in before.values()}
    assert {job.index: job.end for job in drawn} == expected
    assert any(job.version == "full" for job in drawn)
    assert figures_of_chains(told) == []  # those of the schedule before would be wrong
    session.settle()
    assert picture(session)["solved"]
    assert figures_of_chains(picture(session))
    assert session.shown.is_valid


def test_a_dragged_job_is_drawn_at_its_place_before_it_is_solved(session):
    session.pin(Pin("drive", "logging", 0, Duration.parse("3ms"), "core2"))
    [job] = [job for job in session.shown.schedule.mode("drive").jobs if job.task == "logging"]
    assert (job.start, job.units, session.shown.is_valid) == (Duration.parse("3ms"), ("core2",), False)
    assert job.end - job.start == session.shown.model.task("logging").version("only").wcet


def test_an_edit_that_no_file_can_state_is_refused_and_changes_nothing(session):
    before, revision = session.state, session.revision
    with pytest.raises(HalpipeError):
        session.edit(Edit("chain", "see-and-brake", "tasks", ""))
    assert (session.shown, session.revision) == (before, revision)
    session.edit(Edit("chain", "see-and-brake", "tasks", "camera brake"))
    session.settle()
    assert session.shown.what.endswith("tasks = camera brake")


def test_an_edit_that_is_not_solved_yet_is_solved_before_the_next_order(session):
    session.edit(wcet("7ms"))
    session.edit(wcet("2ms", "logging", "only"))
    session.undo()
    assert session.shown.is_valid
    assert session.shown.model.task("camera").version("full").wcet == Duration.parse("7ms")
    session.edit(wcet("5ms"))
    assert session.exported("report", ReportOptions())
    assert verified(session) == []


def test_most_jobs_stay_where_they_are(session):
    session.edit(wcet("9ms", "logging", "only"))
    session.settle()
    assert session.answered.jobs == 13
    assert session.answered.stayed in (12, 13)


@pytest.mark.parametrize(
    ("edit", "word"),
    [
        (wcet("fast"), "duration"),
        (wcet("1ms", "kamera"), "camera"),
        (wcet("1ms", version="fool"), "full"),
        (Edit("task", "camera", "colour", "red"), "period"),
        (Edit("mode", "limp", "tasks", " "), "name the tasks"),
        (Edit("access", "logging", "bound", "0.5", "only", "bus"), "choose"),
        (Edit("access", "logging", "bound", "half", "only", "memory"), "half"),
        (Edit("mode", "limp", "tasks", "kamera"), "camera"),
        (Edit("mode", "limp", "edge", "closed"), "tasks"),
        (Edit("chain", "see-and-brake", "tasks", "camera brakes"), "brake"),
        (Edit("moon", "camera", "period", "1ms"), "moon"),
        (Edit("task", "camera", "binding", "often"), "job, mode, system"),
        (Edit("window", "detection", "max", "1ms", "fine", "logging"), "logging"),
    ],
)
def test_what_cannot_stand_there_changes_nothing(session, edit, word):
    before, revision = session.state, session.revision
    with pytest.raises(HalpipeError) as refused:
        session.edit(edit)
    (found,) = refused.value.diagnostics
    assert found.code == "HAL0951"
    assert word in found.message + found.help + found.path
    assert (session.state, session.revision) == (before, revision)


def test_a_model_without_schedule_keeps_the_last_one_in_sight(session):
    shown = session.state.schedule
    session.edit(wcet("21ms"))
    assert not session.state.is_valid
    assert session.state.findings
    assert session.state.schedule == shown
    session.undo()
    assert session.state.is_valid


def test_a_pinned_job_stays_and_the_rest_gives_way(session):
    start = Duration.parse("20ms")
    session.pin(Pin("drive", "logging", 0, start))
    session.edit(wcet("7ms"))
    (job,) = [job for job in session.state.schedule.mode("drive").jobs if job.task == "logging"]
    assert job.start == start
    assert session.state.is_valid
    assert verified(session) == []


def test_a_task_is_pinned_once_and_beside_others(session):
    first, last = Duration.parse("20ms"), Duration.parse("22ms")
    limp = next(job for job in session.state.schedule.mode("limp").jobs if job.task == "brake")
    for pin in (
        Pin("drive", "logging", 0, first),
        Pin("limp", "brake", 0, limp.start),
        Pin("drive", "logging", 0, last),
    ):
        session.pin(pin)
    assert picture(session)["pins"].count(["drive", "logging", 0]) == 1
    assert ["limp", "brake", 0] in picture(session)["pins"]
    [job] = [job for job in session.state.schedule.mode("drive").jobs if job.task == "logging"]
    assert job.start == last
    assert session.state.is_valid


def test_only_the_pinned_job_of_a_task_with_slack_moves(tmp_path):
    steer = task("steer", "10ms", version("v", "1ms", "u1"), slack="1/2")
    lights = task("lights", "20ms", version("v", "1ms", "u1"))
    path = tmp_path / "slack.xml"
    path.write_bytes(format_model(model(steer, lights, units="u1")))
    session = Session(str(path))
    session.begin()

    def starts():
        return {job.index: job.start for job in session.state.schedule.modes[0].jobs if job.task == "steer"}

    before = starts()
    session.pin(Pin("all", "steer", 1, before[1] + ms(2)))
    assert session.state.is_valid, session.state.findings
    assert starts() == {0: before[0], 1: before[1] + ms(2)}


def test_a_pin_that_the_task_does_not_allow_is_refused(tmp_path):
    """The job would start later than its slack lets it; the search places it elsewhere, which nobody asked for."""
    path = tmp_path / "model.xml"
    steer = task("steer", "10ms", version("v", "1ms", "u1"), slack="1/2", offset="0ms")
    path.write_bytes(format_model(model(steer, units="u1")))
    session = Session(str(path))
    session.begin()
    before = session.state.schedule
    session.pin(Pin("all", "steer", 0, ms(6)))
    assert (session.state.is_valid, session.state.schedule) == (False, before)
    assert [(d.code, d.path) for d in session.state.findings] == [("HAL0962", 'mode "all" task "steer"')]
    session.edit(Edit("task", "steer", "slack", "1"))
    assert session.state.is_valid
    assert session.state.schedule.modes[0].jobs[0].start == ms(6)


def test_a_task_that_is_gone_is_drawn_and_cannot_be_pinned(tmp_path):
    """The chain of the schedule before has jobs of a task that the model has not any more."""
    path = tmp_path / "model.xml"
    a, b = (task(name, "10ms", version("v", "1ms", "u1")) for name in "ab")
    path.write_bytes(format_model(replace(model(a, b, units="u1"), chains=(Chain(name="c", tasks=("a", "b")),))))
    session = Session(str(path))
    session.begin()
    session.edit(Edit("version", "b", "wcet", "20ms", "v"))
    session.edit(Edit("remove", "a", "task", ""))
    assert not session.state.is_valid
    assert figures_of_chains(picture(session)) == []
    with pytest.raises(HalpipeError) as refused:
        session.pin(Pin("all", "a", 0, ms(1)))
    assert refused.value.diagnostics[0].code == "HAL0954"


def test_jobs_without_slack_move_with_the_pinned_one(session):
    before = {job.index: job.start for job in session.state.schedule.mode("drive").jobs if job.task == "camera"}
    session.pin(Pin("drive", "camera", 1, before[1] + Duration.parse("1ms")))
    after = {job.index: job.start for job in session.state.schedule.mode("drive").jobs if job.task == "camera"}
    assert session.state.is_valid, session.state.findings
    assert {n: after[n] - before[n] for n in before} == {n: Duration.parse("1ms") for n in before}
    assert 0 < session.answered.stayed < session.answered.jobs


def test_a_job_is_pinned_to_another_unit_and_keeps_its_start(session):
    job = next(job for job in session.state.schedule.mode("drive").jobs if job.task == "logging")
    other = next(unit.name for unit in session.state.model.units if unit.name not in job.units)
    session.pin(Pin("drive", "logging", job.index, job.start, other))
    moved = next(job for job in session.state.schedule.mode("drive").jobs if job.task == "logging")
    assert session.state.is_valid, session.state.findings
    assert (moved.units, moved.start) == ((other,), job.start)
    assert verified(session) == []


def test_a_mode_takes_other_tasks(session):
    limp = session.state.model.mode("limp").runs
    session.edit(Edit("mode", "limp", "tasks", "logging detection"))
    runs = session.state.model.mode("limp").runs
    assert [run.task for run in runs] == ["logging", "detection"]
    assert runs[1] in limp, "what stays keeps its versions"
    with pytest.raises(HalpipeError, match="of a mode were changed"):
        session.save(str(session.path) + ".yaml")


def test_an_access_takes_another_share(session):
    session.edit(Edit("access", "logging", "bound", "0.5", "only", "memory"))
    assert session.state.model.task("logging").version("only").accesses[0].bound * 2 == 1
    assert verified(session) == []
    with pytest.raises(HalpipeError, match="an access of version"):
        session.save(str(session.path) + ".yaml")


def test_a_window_that_two_share_is_not_guessed(session):
    model = session.state.model
    task = model.task("detection")
    twice = replace(task.versions[0], precedences=task.versions[0].precedences * 2)
    changed = replace(task, versions=(twice, *task.versions[1:]))
    model = replace(model, tasks=tuple(changed if t is task else t for t in model.tasks))
    with pytest.raises(HalpipeError, match="has 2 windows"):
        edited(model, Edit("window", "detection", "max", "3ms", "fine", "camera"))


def test_names_may_stand_between_commas(session):
    session.edit(Edit("chain", "see-and-brake", "tasks", "camera, brake"))
    assert session.state.model.chains[0].tasks == ("camera", "brake")


def test_a_chain_takes_another_way(session):
    session.edit(Edit("chain", "see-and-brake", "tasks", "camera  brake"))
    assert session.state.model.chains[0].tasks == ("camera", "brake")
    assert verified(session) == []


def test_there_is_no_job_to_pin(session):
    with pytest.raises(HalpipeError, match="no job 7") as refused:
        session.pin(Pin("drive", "camera", 7, Duration(0)))
    assert refused.value.diagnostics[0].code == "HAL0954"


def test_undo_and_redo_show_the_very_states(session):
    states = [session.state]
    for value in ("7ms", "8ms"):
        session.edit(wcet(value))
        states.append(session.state)
    session.undo()
    session.undo()
    assert session.state is states[0]
    session.redo()
    assert session.state is states[1]
    session.edit(wcet("5ms"))
    assert not session.future


def test_two_windows_do_not_overwrite_each_other(session):
    old = session.revision
    session.check(old)
    session.edit(wcet("7ms"))
    with pytest.raises(HalpipeError, match="another window"):
        session.check(old)


@pytest.mark.parametrize("force", [False, True])
def test_the_model_is_saved_into_plain_files_only(session, tmp_path, force):
    """A pipe without a reader would block every later order."""
    os.mkfifo(tmp_path / "pipe")
    for place in (tmp_path / "pipe", tmp_path, Path("/dev/null")):
        with pytest.raises(HalpipeError) as refused:
            session.save(str(place), force=force)
        assert [found.code for found in refused.value.diagnostics] == ["HAL0003"]


def test_variants_are_kept_and_shown_again(session):
    session.keep("before")
    session.edit(wcet("7ms"))
    session.take("before")
    assert session.state.model.task("camera").version("full").wcet == Duration.parse("6ms")
    session.undo()
    assert session.state.model.task("camera").version("full").wcet == Duration.parse("7ms")
    with pytest.raises(HalpipeError, match="no variant") as refused:
        session.take("after")
    assert refused.value.diagnostics[0].code == "HAL0956"


def test_the_source_is_overwritten_only_on_purpose(session, tmp_path):
    source = tmp_path / "model.xml"
    before = source.read_bytes()
    session.edit(wcet("7ms"))
    for path in ("", str(source), str(tmp_path / "." / "model.xml")):
        with pytest.raises(HalpipeError, match="is there already") as refused:
            session.save(path)
        assert refused.value.diagnostics[0].code == "HAL0953"
    assert source.read_bytes() == before
    session.save(str(tmp_path / "other.xml"))
    assert read_model(str(tmp_path / "other.xml")).task("camera").version("full").wcet == Duration.parse("7ms")
    session.save("", force=True)
    assert not session.changed_on_disk()
    source.write_bytes(before)
    assert session.changed_on_disk()


def test_exports_are_of_what_is_shown_and_valid(session):
    assert b"see-and-brake" in session.exported("report", ReportOptions())[""]
    session.edit(wcet("21ms"))
    with pytest.raises(HalpipeError, match="no valid schedule") as refused:
        session.exported("report", ReportOptions())
    assert refused.value.diagnostics[0].code == "HAL0957"


def test_margins_are_shares_of_the_wcet(session):
    shares = defaultdict(set)
    for row in sensitivities(session.state.model, session.state.schedule, frozenset()):
        if row.growth is not None:
            shares[row.task].add(float(row.growth / row.wcet))
    assert any(len(each) > 1 for each in shares.values())
    assert session.margins() == {task: min(each) for task, each in shares.items()}


def test_why_there_is_no_schedule(session):
    session.edit(Edit("chain", "see-and-brake", "max_reaction", "5ms"))
    assert any("see-and-brake" in found.message + found.path for found in session.why("drive"))


def test_a_question_is_answered_until_it_is_cancelled(session, monkeypatch):
    goes_on = []

    def explain(model, options, is_asked):
        goes_on.append(is_asked())
        session.cancel()
        goes_on.append(is_asked())
        return SimpleNamespace(diagnostics=())

    monkeypatch.setattr("halpipe.pipeline.explain.explanation.explain", explain)
    session.why("drive")
    session.why("drive")
    assert goes_on == [True, False, True, False]


def test_forms_have_the_values_of_the_model_and_none_where_it_has_none(session):
    forms = {(form["table"], form["edit"]["name"]): form["cells"] for form in picture(session)["forms"]}
    chain, mode = session.state.model.chains[0], session.state.model.modes[0]
    tasks, *limits = [cell for cell in forms["chains", chain.name] if "field" in cell]
    assert tasks == {"field": "tasks", "value": " ".join(chain.tasks), "wide": True}
    stated = {each["field"]: getattr(chain, each["field"]) for each in limits}
    assert {value is None for value in stated.values()} == {True, False}
    words = {field: "" if value is None else str(value) for field, value in stated.items()}
    assert limits == [{"field": field, "value": value, "wide": False} for field, value in words.items()]
    assert forms["modes", mode.name][1]["wide"]


def test_the_page_edits_windows_and_accesses_that_their_names_identify(session):
    def rows():
        forms = [form for form in picture(session)["forms"] if form["table"] == "windows"]
        return {tuple(form["edit"].values()): form["cells"][2]["text"] for form in forms}

    windows = {("detection", name, "window", "camera"): "after the end of camera" for name in ("fine", "coarse")}
    accesses = {
        ("camera", "full", "access", "memory"): "access to memory: from, to, share",
        ("logging", "only", "access", "memory"): "access to memory: from, to, share",
    }
    assert rows() == windows | accesses
    opened = session.state.model
    camera = opened.task("camera")
    twice = replace(camera.versions[0], accesses=camera.versions[0].accesses * 2)
    tasks = (replace(camera, versions=(twice,)), *opened.tasks[1:])
    session.shown = replace(session.shown, model=replace(opened, tasks=tasks))
    assert rows().keys() == (windows | accesses).keys() - {("camera", "full", "access", "memory")}


def test_the_page_states_the_time_of_an_answer_in_milliseconds(session):
    session.answered = replace(session.answered, seconds=1.25)
    assert picture(session)["answered"]["milliseconds"] == 1250


def test_an_answer_takes_the_time_between_its_begin_and_its_end(session, monkeypatch):
    clock = SimpleNamespace(monotonic=iter((5.0, 5.25)).__next__)
    monkeypatch.setattr("halpipe.workbench.session.time", clock)
    session.edit(wcet("7ms"))
    session.settle()
    assert picture(session)["answered"]["milliseconds"] == 250


def test_a_source_that_is_gone_was_changed_and_is_written_again(session):
    os.unlink(session.path)
    assert picture(session)["changed_on_disk"]
    session.save("")
    assert not picture(session)["changed_on_disk"]


@pytest.mark.parametrize(
    ("edit", "what"),
    [
        (wcet("7ms"), 'task "camera" version "full" wcet = 7ms'),
        (Edit("mode", "limp", "tasks", "logging"), 'mode "limp" tasks = logging'),
        (Edit("chain", "see-and-brake", "max_age", ""), 'chain "see-and-brake" max-age = nothing'),
        (Edit("window", "detection", "max", "3ms", "fine", "camera"), 'task "detection" version "fine" max = 3ms'),
        (Edit("remove", "logging", "task", ""), 'remove task "logging"'),
    ],
)
def test_the_history_names_edits_in_words(session, edit, what):
    session.edit(edit)
    assert session.shown.what == what


def test_the_picture_has_every_job_once(session):
    drawn = picture(session)
    assert [len(mode["jobs"]) for mode in drawn["modes"]] == [9, 4]
    assert drawn["valid"] is True
    assert drawn["tasks"][0]["figures"][0]["response"] == "6ms"


def test_only_tasks_that_changed_are_drawn_anew(session, monkeypatch):
    picture(session)
    made = []
    original = drawing._facts
    monkeypatch.setattr(drawing, "_facts", lambda task, *rest: made.append(task.name) or original(task, *rest))
    session.edit(wcet("7ms"))
    told = picture(session)
    assert "camera" in made
    assert len(made) <= session.answered.jobs - session.answered.stayed + 1
    assert told["tasks"] == scene(session.state.model, session.state.schedule)["tasks"]


def test_what_was_proven_before_is_not_told_as_answered_now(session):
    session.edit(wcet("7ms"))
    session.settle()
    assert picture(session)["answered"]["jobs"] == 13
    session.undo()
    assert picture(session)["answered"] == {"stayed": 0, "jobs": 0, "milliseconds": None}
    session.redo()
    assert picture(session)["answered"]["milliseconds"] is None


def test_edits_outlive_the_server(tmp_path, session):
    session.edit(wcet("7ms"))
    path = session.path
    again = Session(path)
    again.begin()
    assert again.state.model == session.state.model
    assert again.state.is_valid
    again.undo()
    assert again.state.model == again.opened
    assert not os.path.exists(f"{path}.edits")  # nothing is left that the file does not have


def test_pins_outlive_the_server(session):
    job = next(job for job in session.state.schedule.modes[0].jobs if job.task == "camera")
    session.pin(Pin(session.state.schedule.modes[0].name, "camera", job.index, job.start))
    assert Session(session.path).state.pins == session.state.pins


@pytest.mark.parametrize("between", ["", "21ms"])
def test_pinned_jobs_stay_over_an_end_of_the_server(session, between):
    """Also where no schedule is found between: the first that is found again has them."""
    start = Duration.parse("20ms")
    session.pin(Pin("drive", "logging", 0, start))
    if between:
        session.edit(wcet(between))
    again = Session(session.path)
    again.begin()
    assert again.state.is_valid == (not between)
    assert again.state.pins == session.state.pins
    if between:
        again.edit(wcet("6ms"))
    [job] = [job for job in again.state.schedule.mode("drive").jobs if job.task == "logging"]
    assert (job.start, again.state.is_valid) == (start, True)


def test_restored_edits_are_announced_until_they_are_saved_or_undone(session):
    session.edit(wcet("7ms"))
    assert not picture(session)["restored"]
    again = Session(session.path)
    again.begin()
    assert picture(again)["restored"]
    again.undo()
    assert not picture(again)["restored"]
    again.redo()
    assert picture(again)["restored"]
    again.save("", force=True)
    assert not picture(again)["restored"]


def test_saved_edits_leave_no_journal(session):
    session.edit(wcet("7ms"))
    session.save("", force=True)
    assert not os.path.exists(f"{session.path}.edits")
    assert Session(session.path).state.model == session.state.model


def test_the_command_that_read_them_writes_model_and_journal_again(session):
    """No command writes over what it has read, but for what it keeps itself."""
    session.edit(wcet("7ms"))
    with protecting_inputs():
        again = Session(session.path)
        again.begin()
        again.edit(wcet("6ms"))
        assert again.journal.fault == ""
        assert Session(session.path).state.model == again.state.model
        again.save("", force=True)
    assert Session(session.path).opened == again.state.model


SPOILT = {
    "another journal": ('"model"', '}"model"'),
    "repeated": ('"pins"', '"pins": [], "pins"'),
    "more": ('"pins"', '"edits": [], "pins"'),
    "pin": ('"pins": []', '"pins": [["all", "fusion", 0.5, "1ms", ""]]'),
}


@pytest.mark.parametrize("spoil", ["another model", *SPOILT])
def test_a_journal_of_another_model_is_neither_used_nor_lost(session, spoil):
    session.edit(wcet("7ms"))
    journal = f"{session.path}.edits"
    if spoil == "another model":
        Path(session.path).write_bytes(Path(session.path).read_bytes() + b"<!-- changed -->")
    else:
        Path(journal).write_text(Path(journal).read_text().replace(*SPOILT[spoil]))
    kept = Path(journal).read_bytes()
    with pytest.raises(HalpipeError) as refused:
        Session(session.path)
    assert refused.value.diagnostics[0].code == "HAL0961"
    assert Path(journal).read_bytes() == kept


def test_edits_that_cannot_be_kept_are_made_and_named(session, monkeypatch):
    session.journal.path = os.path.join(session.path, "no folder")
    session.edit(wcet("7ms"))
    assert session.state.is_valid
    assert picture(session)["unkept"]
    with pytest.raises(HalpipeError) as lost:
        session.close()
    assert lost.value.diagnostics[0].code == EDITS_LOST.id
    session.undo()  # then there is nothing to lose
    assert not picture(session)["unkept"]
    session.close()


def marks(session):
    return {box[4] for table in picture(session)["modes"] for box in (table["strip"] or {"boxes": ()})["boxes"]}


def test_a_variant_is_drawn_under_the_schedule_also_after_edits(session):
    session.keep("first")
    session.draw_under("variant", "first")
    assert marks(session) == {""}
    session.edit(wcet("7ms"))
    session.settle()
    assert "off" in marks(session)
    assert picture(session)["beside"]["name"] == 'variant "first"'
    assert picture(session)["beside"]["kind"] == "variant"
    assert any('task "camera"' in text for text in picture(session)["beside"]["found"])
    session.draw_under("nothing", "")
    assert marks(session) == set()
    with pytest.raises(HalpipeError) as refused:
        session.draw_under("variant", "none")
    assert refused.value.diagnostics[0].code == "HAL0956"
    assert session.lower == ("nothing", "")


def test_a_recorded_run_is_drawn_under_the_schedule(session, tmp_path):
    rows = ["task,start,end,units,mode,cycle"]
    for job in session.state.schedule.modes[0].jobs:
        start, end = int(job.start.ns), int(job.end.ns) + 1000 * (job.task == "camera")
        rows.append(f"{job.task},{start},{end},{' '.join(job.units)},drive,0")
    file = tmp_path / "run.csv"
    file.write_text("\n".join(rows) + "\n")
    session.draw_under("trace", str(file))
    assert marks(session) == {"", "off", "over"}
    with pytest.raises(HalpipeError):
        session.draw_under("trace", str(tmp_path / "none.csv"))
    assert session.lower == ("trace", str(file))
    file.write_text("task,start,end\nother,0,1\n")  # another run has no job of the schedule
    assert "HAL1101" in [found["code"] for found in picture(session)["findings"]]


def test_elements_are_added_and_removed(session):
    session.edit(Edit("add", "core3", "unit", ""))
    session.edit(Edit("add", "radar", "task", "20ms 3ms"))
    session.edit(Edit("add", "far", "chain", "radar brake"))
    model = session.state.model
    assert session.state.is_valid
    assert session.state.what == 'add chain "far" = radar brake'
    assert model.units[2].type == "core"
    assert model.task("radar").versions[0].units == ("core1", "core2", "core3")
    assert all("radar" in {run.task for run in mode.runs} for mode in model.modes)
    assert [len(mode["jobs"]) for mode in picture(session)["modes"]] == [11, 5]
    with pytest.raises(HalpipeError, match="units were added"):
        session.save(f"{session.path}.yaml")
    for kind, name in (("chain", "far"), ("task", "radar"), ("unit", "core3")):
        session.edit(Edit("remove", name, kind, ""))
    assert [session.state.model.units, session.state.model.modes] == [session.opened.units, session.opened.modes]
    session.edit(Edit("remove", "camera", "task", ""))
    assert "camera" in {word for found in session.state.findings for word in found.message.split('"')}


@pytest.mark.parametrize(
    ("edit", "text"),
    [
        (Edit("add", "camera", "task", "20ms 3ms"), "is there already"),
        (Edit("add", "radar", "task", "20ms"), "has no period and WCET"),
        (Edit("add", "radar", "task", "20 3ms"), "is not a duration"),
        (Edit("add", "far", "chain", "camera radar"), 'there is no "radar"'),
        (Edit("add", "x", "mode", ""), 'has no "mode"'),
        (Edit("remove", "radar", "task", ""), 'there is no "radar"'),
    ],
)
def test_elements_that_cannot_be_are_refused(session, edit, text):
    with pytest.raises(HalpipeError, match=text) as refused:
        session.edit(edit)
    assert refused.value.diagnostics[0].code == "HAL0951"
