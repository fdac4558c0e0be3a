"""Spreadsheets: dialects of CSV, workbooks, columns by their synonyms, and what is refused."""

import io
import re
import zipfile
from contextlib import nullcontext
from dataclasses import replace
from fractions import Fraction

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.flow.formats import import_model
from halpipe.importers.common.base import ImportOptions
from halpipe.importers.table import sheets
from halpipe.models import Anchor, Match
from halpipe.starters import first_table

openpyxl = pytest.importorskip("openpyxl", reason="the extra [table]")

TASKS = "Task,Period [ms],WCET [us],Core\na,10,500,c0\n"


@pytest.fixture
def read(tmp_path):
    def imported(strict=False, **texts):
        paths = []
        for name, text in texts.items():
            path = tmp_path / f"{name}.csv"
            path.write_bytes(text if isinstance(text, bytes) else text.encode())
            paths.append(str(path))
        return import_model("table", paths, ImportOptions(strict=strict))

    return imported


def codes(failure):
    return [found.code for found in failure.value.diagnostics if found.is_error]


def task(imported, name="a"):
    return imported.model.task(name)


@pytest.mark.parametrize(
    "text",
    [
        "Task;Cycle time (ms);Execution time [µs];CPU\na;2,5;1,25;c0\n",
        "sep above\n\nAufgabe;Periode [ms];Laufzeit [µs];Kern\na;2,5;1,25;c0\n".encode("cp1252"),
        "name\tT_ms\tC [us]\tunits\na\t2.5\t1.25\tc0\n".encode("utf-16"),
        "\ufeffrunnable,period,wcet,core\r\na,2.5ms,1.25us,c0\r\n",
        "Task,Period in ms,WCET,ECU\na,2.5,1.25 µs,c0\n",
        "Task,Rate [Hz],WCET [US],ECU\na,400,1.25,c0\n",
        'Task,frequency_kHz,WCET us,ECU\na,"0,4",1.25,c0\n',
        "Task,Rate,WCET us,ECU\na,400 Hz,1.25,c0\n",
    ],
)
def test_dialects_state_the_same(read, text):
    found = task(read(tasks=text))
    version = found.versions[0]
    assert (str(found.period), str(version.wcet), version.units) == ("2.5ms", "1.25us", ("c0",))


def test_a_task_may_start_up_to_its_deadline_and_the_report_lists_that(read):
    found = read(tasks=TASKS)
    assert task(found).slack == 1
    assert [one.what for one in found.coverage.defaulted_values] == ["slack"]


def test_after_is_an_order_in_the_same_cycle_and_gives_a_period(read):
    found = read(
        tasks=TASKS + "b c,,100,,\nd,,100,c1,\n".replace(",,\n", ",c0\n"), precedences="From,To,Max\na,d,1ms\n"
    )
    assert "d" in {one.name for one in found.model.tasks}
    found = read(tasks="Task,Period,WCET,Core,After\na b,10ms,1ms,c0,\nb,20ms,1ms,c0,a b\nc,,1ms,c0,a b; b\n")
    (window,) = task(found, "b").versions[0].precedences
    assert (window.task, window.anchor, window.match, str(window.max)) == ("a_b", Anchor.END, Match.CYCLE, "50ms")
    assert str(task(found, "c").period) == "20ms"
    assert [one.task for one in task(found, "c").versions[0].precedences] == ["a_b", "b"]


def test_rows_of_one_task_are_its_versions(read):
    text = "Task,Version,Period,WCET,Core,Modes\na,fast,10ms,1ms,c0 c1,x\na,slow,,3ms,,x y\nb,,5ms,1ms,c1,\n"
    model = read(tasks=text).model
    assert [(v.name, v.units) for v in model.task("a").versions] == [("fast", ("c0", "c1")), ("slow", ("c0", "c1"))]
    runs = {mode.name: {run.task: run.versions for run in mode.runs} for mode in model.modes}
    assert runs == {"x": {"a": ("fast", "slow"), "b": ("default",)}, "y": {"a": ("slow",), "b": ("default",)}}


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("a,10,1ms,c0,\n", "HAL0023", 'write "10 ms", or "Period [ms]" as the head'),
        ("a,10ms,1 h,c0,\n", "HAL0023", "is not a duration"),
        ("a,10ms,1000 us,c0,\na,20ms,1ms,c0,\n", "HAL1485", "states period 20ms"),
        ("a,10ms,1ms,c0,\na,,1ms,c0,\n", "HAL1485", 'version "default" is there twice'),
        ("a,10ms,1ms,c0,x\n", "HAL1486", '"x" is no task'),
        (",10ms,1ms,c0,\n", "HAL0024", 'lacks the key "task"'),
        ("b,,1ms,c0,\na,10ms,1ms,c0,b\n", "HAL0023", "both need a period"),
        ('a,"1,000 ms",1ms,c0,\n', "HAL0023", "may be a decimal or thousands"),
        ('a,"2,5 ms",1ms,c0,\nb,1.000ms,1ms,c0,\n', "HAL0023", "may be a decimal or thousands"),
        ('a,1.000ms,1ms,c0,\nb,"2,5 ms",1ms,c0,\n', "HAL0023", "may be a decimal or thousands"),
        ("a,2,5 ms,1ms,c0,a\n", "HAL1485", "5 heads; write a head above each cell, several names into one"),
    ],
)
def test_faults_of_rows_are_errors_with_their_line(read, text, code, words):
    with pytest.raises(HalpipeError) as failure:
        read(tasks="Task,Period,WCET,Core,After\n" + text)
    found = [one for one in failure.value.diagnostics if one.code == code]
    assert found, codes(failure)
    assert any(words in f"{one.message}; {one.help}" for one in found)
    assert all(one.at.line >= 2 for one in found)


def test_every_fault_is_reported_at_once(read):
    with pytest.raises(HalpipeError) as failure:
        read(tasks="Task,Period,WCET,Core\na,10,1ms,c0\nb,10ms,x,c0\n", chains="Chain,Path\nc,a > z\n")
    assert codes(failure) == ["HAL0023", "HAL0023", "HAL1486"]


def test_unknown_columns_and_sheets_warn_and_strict_refuses(read):
    text = "Task,Period,WCET,Core,Priority,Comment\na,10ms,1ms,c0,3,fine\n"
    found = read(tasks=text, other="x,y\n1,2\n")
    assert [one.code for one in found.diagnostics] == ["HAL1482", "HAL1483"]
    with pytest.raises(HalpipeError) as failure:
        read(strict=True, tasks=text)
    assert failure.value.exit == 5


def test_decimal_signs_may_differ_where_none_may_mean_thousands(read):
    found = read(tasks='Task,Period,WCET,Core,\na,"2,5 ms",0.25 ms,c0,\n')  # and a row may end with a separator
    assert str(task(found).versions[0].wcet) == "250us"


def test_jitter_in_time_is_no_share(read):
    with pytest.raises(HalpipeError) as failure:
        read(tasks="Task,Period [ms],WCET [us],Jitter [ms]\na,10,500,1\n")
    assert failure.value.diagnostics[0].help == "state slack as a share, such as 0.2 or 20 %"


@pytest.mark.parametrize("head", ["WCET [cycles]", "WCET [%]", "Core [ms]"])
def test_units_that_a_column_cannot_have_are_refused(read, head):
    text = TASKS.replace("WCET [us]", head) if "WCET" in head else TASKS.replace("Core", head)
    with pytest.raises(HalpipeError) as failure:
        read(tasks=text)
    assert "HAL1484" in codes(failure)


def test_two_columns_of_one_meaning_contradict(read):
    with pytest.raises(HalpipeError) as failure:
        read(tasks="Task,Period,Cycle,WCET,Core\na,10ms,20ms,1ms,c0\n")
    assert codes(failure) == ["HAL1485"]


@pytest.mark.parametrize("data", [b"\xd0\xcf\x11\xe0", b"PK\x03\x04broken", b"a\0b", b"", b"x,y\n1,2\n"])
def test_files_without_a_table_of_tasks_are_refused(read, data):
    with pytest.raises(HalpipeError) as failure:
        read(tasks=data)
    assert codes(failure) == ["HAL1480"]


def workbook(change=lambda _: None, **sheets):
    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows in sheets.items():
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    change(book)
    packed = io.BytesIO()
    book.save(packed)
    return packed.getvalue()


def test_numbers_of_workbooks_are_exact(read):
    rows = [["Task", "Period [ms]", "WCET [ms]", "Core"], ["a", 10, 0.1, "c0"], ["b", 2.5, 1e-05, "c0"]]
    found = read(tasks=workbook(Tasks=rows))
    assert [str(task(found, name).versions[0].wcet) for name in "ab"] == ["100us", "10ns"]


def test_a_formula_without_a_value_is_an_error(read):
    rows = [["Task", "Period [ms]", "WCET [ms]", "Core"], ["a", "=5*2", 1, "c0"]]
    with pytest.raises(HalpipeError) as failure:
        read(tasks=workbook(Tasks=rows))
    assert codes(failure) == ["HAL1480"]
    assert "=5*2" in failure.value.diagnostics[0].message


@pytest.mark.parametrize(
    ("name", "content"), [("xl/evil.xml", b"<!DOCTYPE x [<!ENTITY a 'b'>]><x/>"), ("big", b"0" * 2**20)]
)
def test_workbooks_with_entities_or_beyond_the_limit_are_refused(read, monkeypatch, name, content):
    monkeypatch.setattr("halpipe.importers.table.sheets.MAX_UNPACKED", 2**20)
    packed = io.BytesIO(workbook(Tasks=[["Task", "Period", "WCET"], ["a", "1ms", "1us"]]))
    with zipfile.ZipFile(packed, "a") as package:
        package.writestr(name, content)
    with pytest.raises(HalpipeError) as failure:
        read(tasks=packed.getvalue())
    assert codes(failure) == ["HAL1480"]


@pytest.mark.parametrize(("value", "text"), [(2.5, "2.5"), (100.0, "100"), (1e22, "1" + "0" * 22), (0.25, "0.25")])
def test_a_number_of_a_workbook_is_written_as_it_was_typed(value, text):
    assert sheets._shown(value) == text


@pytest.mark.parametrize(("beyond", "is_refused"), [(0, False), (1, True)])
def test_a_workbook_may_be_as_large_as_the_limit(monkeypatch, beyond, is_refused):
    package = io.BytesIO()
    with zipfile.ZipFile(package, "w") as written:
        written.writestr("a.xml", b"12345")
    monkeypatch.setattr(sheets, "MAX_UNPACKED", 5 - beyond)
    with zipfile.ZipFile(package) as read, pytest.raises(HalpipeError) if is_refused else nullcontext():
        sheets._refuse_bombs(read, "t.xlsx")


def test_the_separator_is_that_of_the_first_lines(read):
    text = "Task;Period;WCET;Core\na;10ms;1ms;c0\n" + "\n" * 18
    with pytest.raises(HalpipeError) as failure:
        read(tasks=text + ",,,,,,,,\n")
    assert failure.value.diagnostics[0].path == 'task ",,,,,,,,"'  # one cell, since commas come too late to separate


@pytest.mark.parametrize(("text", "share"), [("10%", "1/10"), ("2,5 %", "1/40")])
def test_shares_may_be_percent(read, text, share):
    found = task(read(tasks=f"Task;Period;WCET;Core;Slack\na;10ms;1ms;c0;{text}\n"))
    assert found.slack == Fraction(share)


@pytest.mark.parametrize("versions", ["", "fast"])
def test_a_version_that_is_there_twice_is_refused_with_what_to_do(read, versions):
    row = f"a,{versions},10ms,1ms,c0\n"
    with pytest.raises(HalpipeError) as failure:
        read(tasks="Task,Version,Period,WCET,Core\n" + row + row)
    assert failure.value.diagnostics[0].help.startswith("rename or remove one of the two rows")


HEADS = "Task;Period [ms];WCET [us];Core\n"


@pytest.mark.parametrize(
    ("cell", "wcet"),
    [("0,250", "250ns"), ("1.250,5", "1250500ns"), ("1'250", "1250us"), ("1\u202f250", "1250us"), ("2.5", "2500ns")],
)
def test_numbers_as_they_are_written_elsewhere(read, cell, wcet):
    assert task(read(tasks=f"{HEADS}a;10;{cell};c0\n")).versions[0].wcet == Duration.parse(wcet)


@pytest.mark.parametrize("cell", ["10.000", "1.250", "1.234", "1,234", "1,250,500"])
def test_what_may_be_thousands_is_refused_with_two_forms_that_are_not(read, cell):
    """Semicolons separate the cells where a comma is the decimal sign: there, 10.000 may be ten thousand."""
    with pytest.raises(HalpipeError) as failure:
        read(tasks=f"{HEADS}a;10;{cell};c0\n")
    (found,) = failure.value.diagnostics
    assert found.message.endswith("may be a decimal or thousands")
    point, whole = re.findall('"([^"]+)"', found.help)
    assert whole == re.sub("[.,]", "", cell)
    first, _, rest = re.sub(r"[.,](?=.*[.,])", "", cell).replace(",", ".").partition(".")
    for form, value in ((point, Fraction(f"{first}.{rest}")), (whole, Fraction(whole))):
        read_again = task(read(tasks=f"{HEADS}a;{4 * int(whole)};{form};c0\n")).versions[0].wcet
        assert read_again.in_unit("us") == value


@pytest.mark.parametrize("cell", ["2. Mai", "2-May", "03.05.2026", "2026-05-02 00:00:00", "00:00:10"])
def test_dates_are_named_as_such(read, cell):
    with pytest.raises(HalpipeError, match="is a date or a time of day; format the column as text"):
        raise_first(read, f"{HEADS}a;10;{cell};c0\n")


def raise_first(read, text):
    try:
        read(tasks=text)
    except HalpipeError as failure:
        found = failure.diagnostics[0]
        raise HalpipeError(replace(found, message=f"{found.message}; {found.help}")) from None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"{HEADS}a;10;#DIV/0!;c0\n", "what a formula failed with"),
        (f"{HEADS};[ms];[us];\na;10;1;c0\n", 'fill in the column "task", or remove the row'),
        (HEADS, "no table has tasks"),
        (f"{HEADS}a;10;1;c0\na;20;1;c0\n", "rename one of the two rows"),
    ],
)
def test_mistakes_of_rows_are_answered_with_their_remedy(read, text, said):
    with pytest.raises(HalpipeError, match=said):
        raise_first(read, text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("Task,Period [ms],WCTE [ms]\na,10,1\n", 'did you mean "WCTE"'),
        ("Task,Period [ms],Core\na,10,c0\n", 'tasks need the column "wcet"'),
        ("Period [ms],WCET [ms],Core\n10,1,c0\n", 'tasks need the column "task"'),
        ("Path,Limit [ms]\na -> b,10\n", 'chains need the column "name"'),
        ("a,10,1,u0\n", "write heads above the rows, between commas"),
    ],
)
def test_a_sheet_that_is_no_table_is_told_what_it_lacks(read, text, said):
    found = read(tasks=TASKS, other=text).diagnostics
    assert [one.code for one in found] == ["HAL1483"]
    assert said in f"{found[0].message}; {found[0].help}"


def test_units_of_heads_may_follow_a_stroke_or_a_blank(read):
    assert task(read(tasks="Task|Period/ms|WCET us|Core\na|10|500|c0\n")) == task(read(tasks=TASKS))


def test_hidden_sheets_are_reported_and_not_read(read):
    def hide(book):
        book["Old tasks"].sheet_state = "hidden"

    rows = [["Task", "Period [ms]", "WCET [us]", "Core"], ["a", 10, 500, "c0"]]
    book = workbook(Tasks=rows, **{"Old tasks": [rows[0], ["a", 10, 900, "c0"]]}, change=hide)
    found = read(tasks=book)
    assert task(found) == task(read(tasks=TASKS))
    assert [(one.code, one.help) for one in found.diagnostics] == [("HAL1483", "unhide it, or delete it")]


@pytest.mark.parametrize(
    ("cells", "refused"),
    [("D4:D5", True), ("B4:B5", True), ("C5:D5", True), ("A1:D1", False), ("E4:E5", False), ("D4:E4", False)],
)
def test_merged_cells_are_refused_where_one_lacks_its_value(read, cells, refused):
    """A title may be merged, and cells of a remark; of cells in one row, the first has the value."""
    rows = [["Title"], [], ["Task", "Period [ms]", "WCET [us]", "Core", "Remark"], ["a", 10, 500, "c0"]]
    book = workbook(Tasks=[*rows, ["b", 10, 500, "c0"]], change=lambda made: made["Tasks"].merge_cells(cells))
    if not refused:
        assert len(read(tasks=book).model.tasks) == 2
        return
    with pytest.raises(HalpipeError, match="merged") as failure:
        read(tasks=book)
    assert codes(failure)[0] == "HAL1485"
    assert failure.value.diagnostics[0].at.line == int(cells[1])


def test_rows_and_columns_have_a_limit(read, monkeypatch):
    monkeypatch.setattr("halpipe.importers.table.sheets.MAX_ROWS", 2)
    monkeypatch.setattr("halpipe.importers.table.sheets.MAX_COLUMNS", 4)
    assert read(tasks=TASKS).model.tasks
    for text in (TASKS + "b,10,1,c0\n", TASKS.replace("c0\n", "c0,\n")):
        with pytest.raises(HalpipeError) as failure:
            read(tasks=text)
        assert codes(failure) == ["HAL1480"]


def test_without_openpyxl_csv_is_offered(read, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "openpyxl", None)
    with pytest.raises(HalpipeError) as failure:
        read(tasks=b"PK\x03\x04")
    assert codes(failure) == ["HAL1481"]


def test_the_template_schedules(read):
    texts = {name.removesuffix(".csv"): text for name, text in first_table().items()}
    assert not [one for one in read(strict=True, **texts).diagnostics if one.is_error]


@pytest.mark.parametrize(("above", "codes_found"), [(19, []), (20, ["HAL1483", "HAL1480"])])
def test_titles_may_stand_above_the_heads_up_to_a_limit(read, above, codes_found):
    text = "".join(f"title {number}\n" for number in range(above)) + TASKS
    if not codes_found:
        assert task(read(tasks=text)).name == "a"
        return
    with pytest.raises(HalpipeError) as failure:
        read(tasks=text)
    assert sorted(found.code for found in failure.value.diagnostics) == sorted(codes_found)


def test_a_sheet_without_a_known_table_is_reported_at_its_first_row(read):
    found = read(tasks=TASKS, other="\n\ncolour,size\nred,3\n")
    assert [(d.code, d.at.line) for d in found.diagnostics] == [("HAL1483", 3)]


def test_a_row_may_end_before_the_column_of_names(read):
    """Such a row names nothing; the names of the others are known."""
    with pytest.raises(HalpipeError) as failure:
        read(tasks="wcet,task\n1ms,a\n2ms\n")
    assert [found.at.line for found in failure.value.diagnostics] == [3]


def test_a_sheet_called_after_a_table_needs_only_its_first_column(read):
    """The heads alone would not tell what it is; the missing column is reported."""
    with pytest.raises(HalpipeError, match="tasks"):
        read(tasks=TASKS, chains="chain,colour\nc,red\n")


def test_a_wrong_item_of_a_list_is_reported_in_its_row(read):
    with pytest.raises(HalpipeError) as failure:
        read(tasks=TASKS, chains='chain,tasks\n\nc,"a -> b?"\n')
    assert [found.at.line for found in failure.value.diagnostics] == [3]


@pytest.mark.parametrize(
    ("cell", "words"), [("30", '"30 Hz", or "Rate [Hz]"'), ("0 Hz", "has no period"), ("-5 Hz", "-5")]
)
def test_a_rate_without_meaning_is_refused(read, cell, words):
    with pytest.raises(HalpipeError) as failure:
        read(tasks=f"Task,Rate,WCET [us],Core\na,{cell},500,c0\n")
    assert words in str(failure.value)


def test_a_row_of_sums_is_no_task(read):
    with pytest.raises(HalpipeError) as failure:
        read(tasks=TASKS + "Total,,500,\n")
    assert [(found.code, found.at.line) for found in failure.value.diagnostics] == [("HAL0023", 3)]
    assert task(read(tasks=TASKS + "Total,20,500,\n"), "Total").period == Duration.parse("20ms")


def test_names_that_differ_in_capitals_alone_warn(read):
    rows = "Task,Period [ms],WCET [us],Core,Modes\na,10,5,c0,Drive\nb,10,5,C0,drive\nA,10,5,c0,Drive\n"
    found = read(tasks=rows).diagnostics
    assert [(one.code, one.message[:4], one.at.line) for one in found] == [
        ("HAL1550", '"A" ', 4),
        ("HAL1550", '"C0"', 3),
        ("HAL1550", '"dri', 3),
    ]
