"""Whatever is done to design files, recordings or tables of durations, the import ends with a model or with reasons."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import strategies
from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.exporters.native import format_model
from halpipe.importers.native import parse_model
from halpipe.importers.ros import FORMAT
from halpipe.importers.ros.calibrate import Measurements, read_measured
from halpipe.importers.ros.options import RosImportOptions

FIXTURES = Path(__file__).parents[1] / "unit" / "importers" / "ros_fixtures"
DESIGN = sorted((FIXTURES / "design").iterdir())
FAST = settings(max_examples=40, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
WORDS = st.one_of(
    strategies.xml_texts,
    st.sampled_from(["", "~", "[]", "{}", "[~]", "yes", "1", "-1", "1e9", "*", "^", "a.publisher.*", "Shuttle.system"]),
)


@st.composite
def damaged(draw, texts):
    """Lines of files removed, doubled or moved to another file, and values replaced."""
    lines = [[file, line] for file, text in enumerate(texts) for line in text.splitlines()]
    for _ in range(draw(st.integers(1, 6))):
        here, there = draw(st.integers(0, len(lines) - 1)), draw(st.integers(0, len(lines) - 1))
        change = draw(st.sampled_from(["fill", "item", "remove", "double", "move"]))
        if change == "fill":
            lines[here][1] = f"{lines[here][1].partition(':')[0]}: {draw(WORDS)}"
        elif change == "item":
            lines[here][1] = lines[here][1].replace("{", "[", 1).replace("}", "]", 1)
        elif change == "remove":
            lines[here][1] = ""
        elif change == "double":
            lines.insert(here, list(lines[there]))
        else:
            lines[here][1], lines[there][1] = lines[there][1], lines[here][1]
    return ["\n".join(line for number, line in lines if number == file) for file in range(len(texts))]


def ends_with_a_model_or_reasons(paths, **options):
    try:
        imported = FORMAT.read(paths, RosImportOptions(**options))
    except HalpipeError as refused:
        assert refused.diagnostics, "a refusal needs a reason"  # noqa: PT017 - both ways out are allowed
        return
    assert parse_model(format_model(imported.model), "m.xml") == imported.model
    assert all(read == mapped + ignored for _, read, mapped, ignored in imported.coverage.rows())


@pytest.mark.slow
@FAST
@given(damaged([path.read_text() for path in DESIGN]))
def test_damaged_designs(tmp_path_factory, texts):
    folder = tmp_path_factory.mktemp("design")
    for path, text in zip(DESIGN, texts, strict=True):
        (folder / path.name).write_text(text, encoding="utf-8", errors="replace")
    ends_with_a_model_or_reasons([str(folder)])
    ends_with_a_model_or_reasons([str(folder / path.name) for path in DESIGN])


@FAST
@given(damaged([(FIXTURES / "bag" / "metadata.yaml").read_text()]))
def test_damaged_recordings(tmp_path_factory, texts):
    path = tmp_path_factory.mktemp("bag") / "metadata.yaml"
    path.write_text(texts[0], encoding="utf-8", errors="replace")
    ends_with_a_model_or_reasons([str(FIXTURES / "rqt_topics.dot"), str(path)])


@FAST
@given(
    st.lists(st.lists(st.one_of(st.sampled_from(["callback", "duration_ms", "start", "end", "/a", "1", "-2"]), WORDS)))
)
def test_any_table_is_read_or_refused(rows):
    findings, measured = Findings(), Measurements()
    text = "\n".join(",".join(cells) for cells in rows)
    try:
        read_measured(text.encode("utf-8", "replace"), "t.csv", measured, findings)
    except HalpipeError as refused:
        assert refused.diagnostics, "a refusal needs a reason"  # noqa: PT017 - both ways out are allowed
    assert all(sample.ns >= 0 for samples in measured.samples.values() for sample in samples)


@pytest.mark.parametrize("data", [b"\x00,\x00", b"callback,duration\n" + b'"' * 200_000, b"callback,duration\r\ra,1"])
def test_bytes_that_trouble_the_csv_reader(data):
    findings = Findings()
    try:
        read_measured(data, "t.csv", Measurements(), findings)
    except HalpipeError as refused:
        assert refused.diagnostics  # noqa: PT017
