"""The generated reference pages on disk are those that the code makes now."""

import importlib.util
import re
from pathlib import Path

import pytest

import halpipe
from halpipe.core.diagnostics import REGISTER, Exit

SCRIPT = Path(__file__).parents[2] / "docs" / "generate.py"


def load_script(path=SCRIPT):
    spec = importlib.util.spec_from_file_location(f"docs_{path.stem}", path)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    return script


@pytest.fixture(scope="module")
def pages():
    return load_script().pages()


PAGES = ["amalthea", "checks", "cli", "diagnostics", "exit-codes", "formats", "options", "schemas"]


@pytest.mark.parametrize("name", [f"{name}.md" for name in PAGES])
def test_page_is_up_to_date(pages, name):
    on_disk = SCRIPT.parent / "reference" / name
    assert on_disk.exists(), "run make docs"
    assert on_disk.read_text(encoding="utf-8") == pages[name], f"docs/reference/{name} is out of date: run make docs"


@pytest.mark.parametrize("kind", ["task-model", "schedule"])
def test_schema_says_of_attributes_what_their_fields_say(kind):
    path, text = load_script(SCRIPT.with_name("schema_files.py")).schema_file(kind)
    assert path.read_text(encoding="utf-8") == text, f"{path.name} is out of date: run make docs"


def test_every_attribute_of_a_schema_is_a_field_of_a_class():
    """But for `split`, which two fields make up, and for what lists state for all their elements."""
    script = load_script(SCRIPT.with_name("schema_files.py"))
    for kind, types in script.ELEMENTS.items():
        stated = {attribute.name for _, *table in types for attribute in script.attributes(*table)}
        text = script.schema_file(kind)[1]
        assert set(re.findall(r'<xs:attribute name="([\w-]+)"', text)) - stated <= {"split"}


def test_every_code_has_a_section(pages):
    headings = [line[4:] for line in pages["diagnostics.md"].splitlines() if line.startswith("### ")]
    assert headings == sorted(REGISTER)


def test_every_exit_code_has_a_row(pages):
    for code in Exit:
        assert f"\n| {int(code)} |" in pages["exit-codes.md"]


def test_every_range_of_codes_has_a_title(pages):
    assert "Further diagnostics" not in pages["diagnostics.md"]


def test_tags_are_not_taken_for_markup():
    assert load_script()._escaped("a <b> `<c>` <d>") == "a &lt;b> `<c>` &lt;d>"


def test_no_page_is_made_without_being_held_to_the_code(pages):
    tested = next(mark for mark in test_page_is_up_to_date.pytestmark if mark.name == "parametrize").args[1]
    assert sorted(tested) == sorted(pages)


def test_every_verb_and_each_of_its_options_is_listed(pages):
    """Against the help that typer prints, which the page is not made from."""
    from typer.main import get_command

    from halpipe.cli.app import VERBS, build

    sections = dict(re.findall(r"^## halpipe ([\w -]+)\n(.*?)(?=^## |\Z)", pages["cli.md"], re.MULTILINE | re.DOTALL))
    commands = {}
    for name, command in get_command(build(VERBS)).commands.items():
        verbs = command.list_commands(None) if hasattr(command, "list_commands") else []
        inside = {f"{name} {verb}": command.get_command(None, verb) for verb in verbs}
        commands |= inside or {name: command}
    assert sorted(sections) == sorted(commands)
    for name, command in commands.items():
        for parameter in command.params:
            flags = [flag for flag in parameter.opts if flag.startswith("-") and flag != "--help"]
            missing = [flag for flag in flags if flag not in sections[name]]
            assert not missing, f"halpipe {name}: {missing}"


@pytest.mark.parametrize("kind", ["task-model", "schedule"])
def test_every_element_and_attribute_of_the_schemas_is_listed(pages, kind):
    text = (Path(halpipe.__file__).parent / "schemas" / f"{kind}-1.xsd").read_text(encoding="utf-8")
    for element in re.findall(r'<xs:element name="([\w-]+)"', text):
        assert f"### `<{element}>`\n" in pages["schemas.md"]
    for attribute in re.findall(r'<xs:attribute name="([\w-]+)"', text):
        assert f"\n| `{attribute}` |" in pages["schemas.md"]


def test_pages_do_not_depend_on_the_terminal(pages, monkeypatch):
    for columns in ("20", "400"):
        monkeypatch.setenv("COLUMNS", columns)
        assert load_script().cli_page() == pages["cli.md"]
