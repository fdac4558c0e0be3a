"""Overlay files in: every problem found with its line, nothing read silently, exact values."""

from fractions import Fraction

import pytest
from overlay_case import FIXTURES, apply, imported, marks, overlay, refusal

from halpipe.core.diagnostics import REGISTER, HalpipeError
from halpipe.core.quantities import parse_bandwidth
from halpipe.importers.common.base import Coverage
from halpipe.importers.overlay import OverlayUse, codes, read_overlays
from support import ms

OVERLAY_CODES = ("HAL07", "HAL0021", "HAL0022", "HAL0023", "HAL0024")
MALFORMED = sorted(p for p in FIXTURES.glob("*.yaml") if not p.name.startswith("apply_"))
MISFITS = sorted(FIXTURES.glob("apply_*.yaml"))


def found(diagnostics):
    return sorted((d.at.line, d.code) for d in diagnostics if d.is_error)


@pytest.mark.parametrize("path", MALFORMED, ids=lambda p: p.stem)
def test_every_problem_of_a_malformed_file_is_reported_at_its_line(path):
    diagnostics = refusal(path)
    assert found(diagnostics) == marks(path)
    assert {d.at.file for d in diagnostics} == {str(path)}


@pytest.mark.parametrize("path", MISFITS, ids=lambda p: p.stem)
def test_every_entry_that_does_not_fit_the_model_is_reported_at_its_line(path):
    _, diagnostics, _ = apply(read_overlays([str(path)]))
    assert found(diagnostics) == marks(path)


@pytest.mark.parametrize("path", [*MALFORMED, *MISFITS], ids=lambda p: p.stem)
def test_every_error_says_what_to_do(path):
    diagnostics = refusal(path) or apply(read_overlays([str(path)]))[1]
    own = [d for d in diagnostics if d.is_error and d.code.startswith(OVERLAY_CODES)]
    assert all(d.help and d.message and (d.path or d.code == codes.NOT_AN_OVERLAY.id) for d in own)


def test_every_error_code_has_a_fixture():
    fixtures = {code for path in (*MALFORMED, *MISFITS) for _, code in marks(path)}
    errors = {id for id, code in REGISTER.items() if id.startswith(OVERLAY_CODES) and code.severity == "error"}
    assert errors <= fixtures


def test_problems_of_all_files_are_reported_together(tmp_path):
    paths = [FIXTURES / "unknown_keys.yaml", tmp_path / "absent.yaml", FIXTURES / "duplicates.yaml"]
    files = {d.at.file for d in refusal(*paths)}
    assert files == {str(path) for path in paths}


@pytest.mark.parametrize(
    ("fixture", "line", "near"),
    [
        ("unknown_keys.yaml", 2, "platform"),
        ("unknown_keys.yaml", 13, "wcet"),
        ("unknown_keys.yaml", 23, "tasks"),
        ("bad_values.yaml", 40, "read"),
        ("bad_values.yaml", 44, "end"),
    ],
)
def test_the_nearest_key_or_word_is_suggested(fixture, line, near):
    helps = [d.help for d in refusal(FIXTURES / fixture) if d.at.line == line]
    assert helps[0].startswith(f'did you mean "{near}"')


@pytest.mark.parametrize(
    ("fixture", "line", "near"),
    [
        ("apply_matches_nothing.yaml", 8, "/sensing/lidar"),
        ("apply_unknown_names.yaml", 12, "big1"),
        ("apply_unknown_names.yaml", 14, "ddr"),
        ("apply_unknown_names.yaml", 18, "/planning"),
        ("apply_unknown_names.yaml", 25, "default"),
        ("apply_unknown_names.yaml", 30, "/control"),
    ],
)
def test_the_nearest_name_of_the_model_is_suggested(fixture, line, near):
    _, diagnostics, _ = apply(read_overlays([str(FIXTURES / fixture)]))
    helps = [d.help for d in diagnostics if d.at.line == line]
    assert helps[0].startswith(f'did you mean "{near}"')


def test_a_source_that_no_import_asks_for_is_reported_with_those_it_asked_for(tmp_path):
    use = OverlayUse(overlay(tmp_path, "sources: {/scam: {period: 25ms}}"))
    assert use.source_period("/scan") is None
    _, diagnostics = use.apply(imported(), Coverage())
    assert [(d.code, d.help) for d in diagnostics] == [(codes.MATCHES_NOTHING.id, 'did you mean "/scan"?')]


@pytest.mark.parametrize(
    "key", ["/{front,rear}/lidar", "{}", "{0}", "{0:>4000000000}", "{key.__class__}", "%s %d", "{"]
)
def test_names_are_told_as_they_are_and_never_taken_for_formats(tmp_path, key):
    path = tmp_path / "overlay.yaml"
    path.write_text(f'halpipe-overlay: 1\ntasks:\n  "{key}": {{wcet: soon}}\nsources: {{"{key}": {{period: 0}}}}\n')
    for said in refusal(path):
        assert key in f"{said.path} {said.message}"


def test_values_are_exact(tmp_path):
    text = """
platform: {resources: [{name: ddr, bandwidth: 19.2GB/s}], units: [{name: core0}]}
sources: {/camera: {period: 1/30s}}
tasks:
  /planning:
    slack: 1/3
    access: [{resource: ddr, start: 0ms, end: 0.1ms, bound: 0.35}]
    wcet: 100/3ms
"""
    given = overlay(tmp_path, text)
    use = OverlayUse(given)
    assert use.source_period("/camera") == ms("1/30s")
    result, _, _ = apply(given)
    planning = result.task("/planning")
    assert planning.slack == Fraction(1, 3)
    assert planning.versions[0].wcet.ns == Fraction(10**8, 3)
    assert planning.versions[0].accesses[0].bound == Fraction(7, 20)
    assert result.resources[0].bandwidth == parse_bandwidth("19.2GB/s")


def test_no_overlay_changes_nothing():
    result, diagnostics, coverage = apply(read_overlays([]))
    assert (result, diagnostics, coverage.defaulted_values) == (imported(), (), [])


@pytest.mark.parametrize(
    ("text", "help"),
    [
        ("halpipe-pipeline: 1\n", "this is a pipeline: `halpipe run FILE`"),
        ("tasks: {}\n", 'start the file with "halpipe-overlay: 1"'),
        (
            "- a\n",
            'name a YAML file after --overlay, and the source before it; start the file with "halpipe-overlay: 1"',
        ),
    ],
)
def test_a_file_that_is_no_overlay_is_told_from_a_pipeline(tmp_path, text, help):
    path = tmp_path / "o.yaml"
    path.write_text(text)
    with pytest.raises(HalpipeError) as refused:
        read_overlays([str(path)])
    (found,) = refused.value.diagnostics
    assert found.help.startswith(help)
