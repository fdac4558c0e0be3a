"""Writes the reference pages that are made from the code: ``make docs``, or ``python docs/generate.py``.

A page is a pure function of what the code declares, so that a test can hold the files on disk against it.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
from enum import Enum
from importlib import resources
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args, get_origin, get_type_hints

import halpipe
from halpipe.core.diagnostics import REGISTER, Exit

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from lxml import etree

    from halpipe.core.diagnostics import Code

REFERENCE = Path(__file__).parent / "reference"

GENERATED = "<!-- Made from the code by docs/generate.py; change it there and run `make docs`. -->"

RANGES = {
    "HAL00": "Files",
    "HAL01": "Documents and their schemas",
    "HAL02": "The task model: validate",
    "HAL03": "Schedules: verify",
    "HAL04": "The search for a schedule",
    "HAL05": "Import of ARXML",
    "HAL06": "Import of ROS graphs",
    "HAL07": "Overlays",
    "HAL08": "Exports",
    "HAL09": "The tool chain",
    "HAL10": "Bundles and their checks",
    "HAL11": "Traces and their comparison",
    "HAL12": "Import of AMALTHEA",
    "HAL13": "Exports to Linux and ROS",
    "HAL14": "Formats and targets, continued",
    "HAL15": "Imports of projects, and further checks",
}

MEANINGS = {
    Exit.OK: "The work is done. Warnings and notes may have been reported.",
    Exit.FINDINGS: "The input has errors: a file that cannot be read, an invalid model, an invalid schedule.",
    Exit.USAGE: "The command line is wrong.",
    Exit.NOT_FOUND: "The search ended without a valid schedule. This does not mean that there is none.",
    Exit.INFEASIBLE: "It is proven that no valid schedule exists; the witness is in the diagnostics.",
    Exit.UNSUPPORTED: "Under `--strict`, the source has something that the importer would have left out.",
    Exit.INTERNAL: "A bug in halpipe. A report was saved; please send it.",
    Exit.INTERRUPTED: "Interrupted. The best result so far has been saved where the command saves results.",
}


def load_everything() -> None:
    """Import every module of the package, so that every code has registered itself."""
    for module in pkgutil.walk_packages(halpipe.__path__, "halpipe."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)


def pages() -> dict[str, str]:
    """Return every generated page by its name in docs/reference."""
    load_everything()
    return {
        "diagnostics.md": diagnostics_page(),
        "checks.md": checks_page(),
        "exit-codes.md": exit_codes_page(),
        "cli.md": cli_page(),
        "options.md": options_page(),
        "schemas.md": schemas_page(),
        "formats.md": formats_page(),
        "amalthea.md": amalthea_page(),
    }


def _page(title: str, *paragraphs: str) -> str:
    return "\n\n".join((f"# {title}", GENERATED, *(p for p in paragraphs if p))) + "\n"


# --------------------------------------------------------------------------------------------------- amalthea


def amalthea_page() -> str:
    """Which kinds and features of AMALTHEA are read, and which are harmless, by the lists of the importer."""
    from halpipe.importers.amalthea.build import HARMLESS, READ, UNREACHED

    read = [f"| {_ticked(kinds)} | {_ticked(features)} |" for kinds, features in READ.items()]
    harmless = [f"| {reason} | {_ticked(words)} |" for reason, words in HARMLESS.items()]
    unreached = [f"| {reason} | {_ticked(words)} |" for reason, words in UNREACHED.items()]
    return _page(
        "AMALTHEA: what is read, what is not, and what that means",
        "Every element, attribute and value of a model is read, or is harmless, or is reported as "
        f"{_link('HAL1252')}. `--strict` then ends with exit code 5. Kinds that a later release adds stand in none of "
        "these lists, so they are reported. [What the elements mean](../explanation/amalthea.md) for a schedule is "
        "explained elsewhere.",
        "Tests change each harmless kind and feature, and the task model stays the same. Other tests add every class, "
        "attribute and value of the official metamodels (releases 1.2.0 to 3.3.0) to a model: none is dropped in "
        "silence.",
        "## Read",
        "Kinds are classes; elements without a class of their own stand under their tag, with a small first letter. "
        "A feature that holds elements is looked into. "
        "After `=` stand the values that are read; others are reported.",
        "\n".join(("| kind | features |", "|---|---|", *read)),
        "## Harmless",
        "Without influence on what a target may do; `*` stands for every kind.",
        "\n".join(("| reason | kinds and features |", "|---|---|", *harmless)),
        "## Harmless where nothing reaches them",
        "The import reads these kinds. Where tasks, constraints and mappings do not lead to them, they decide nothing.",
        "\n".join(("| reason | kinds |", "|---|---|", *unreached)),
    )


def _ticked(words: str) -> str:
    return ", ".join(f"`{word}`" for word in words.replace("|", " or ").split(" ") if word).replace(
        "`, `or`, `", " or "
    )


# ------------------------------------------------------------------------------------------------ diagnostics


def diagnostics_page() -> str:
    """Every diagnostic code, by number."""
    intro = (
        "Every message of halpipe carries one of these codes. An *error* stops the work, a *warning* should be looked "
        "at, a *note* says what was done or assumed. A message names the file and line, the element, and what to do."
    )
    parts = [intro]
    reporters = _reporters()
    codes = [REGISTER[id] for id in sorted(REGISTER)]
    for prefix, group in groupby(codes, key=lambda code: code.id[:5]):
        parts.append(f"## {RANGES.get(prefix, 'Further diagnostics')}: {prefix}xx")
        parts += (_code(code, reporters.get(code.id, ())) for code in group)
    return _page("Diagnostics", *parts)


def _code(code: Code, checks: Iterable[str]) -> str:
    text = f"### {code.id}\n\n**{_escaped(code.title)}** ({code.severity}).\n{_escaped(code.explanation)}".rstrip()
    names = ", ".join(f"`{name}`" for name in checks)
    return f"{text}\n\nReported by the check {names}." if names else text


def _escaped(text: str) -> str:
    """Keep Markdown from taking tags for markup, except inside code spans."""
    return "".join(part if part.startswith("`") else part.replace("<", "&lt;") for part in re.split(r"(`[^`]*`)", text))


def _reporters() -> dict[str, list[str]]:
    """Return the names of the checks that report a code."""
    from halpipe.pipeline.validate import CHECKS

    reporters: dict[str, list[str]] = {}
    for check in CHECKS:
        for code in check.codes:
            reporters.setdefault(code.id, []).append(check.name)
    return reporters


# ------------------------------------------------------------------------------------------------ checks


def checks_page() -> str:
    """What validate and verify check, one sentence each."""
    from halpipe.pipeline.validate import CHECKS
    from halpipe.pipeline.verify import RULES

    checks = (
        f"| `{check.name}` | {check.sentence} | {' '.join(_link(code.id) for code in check.codes)} |"
        for check in CHECKS
    )
    rules = (f"| `{rule.name}` | {rule.sentence} |" for rule in RULES)
    return _page(
        "Checks",
        "## The model: `halpipe validate`",
        "Every check is made, and every finding reported. Only errors keep a model from being scheduled.",
        "\n".join(("| check | what holds | codes |", "|---|---|---|", *checks)),
        "## The schedule: `halpipe verify`",
        "A schedule is valid if and only if every rule holds. The checker shares no code with the search.",
        "\n".join(("| rule | what holds |", "|---|---|", *rules)),
    )


def _link(code: str) -> str:
    return f"[{code}](diagnostics.md#{code.lower()})"


# ------------------------------------------------------------------------------------------------ formats


def formats_page() -> str:
    """What every format reads, writes and loses, from the extents that importers and exporters state."""
    from halpipe.flow.formats import EXPORTERS, IMPORTERS, exporter, formats, importer

    readers = [importer(name) for name in formats(IMPORTERS)]
    writers = [exporter(name) for name in formats(EXPORTERS)]
    return _page(
        "Formats",
        "What each format carries of a [model](../explanation/model.md) and its schedule. halpipe's own XML carries "
        "everything, both ways ([schemas](schemas.md)). Whatever a source has beyond this is counted as ignored in the "
        "[coverage report](../how-to/import-an-ecu-extract.md), with its line and the reason.",
        "## What is read",
        _matrix(readers),
        "## What is written",
        _matrix(writers),
        *(part for reader in readers for part in _extent("import", reader)),
        *(part for writer in writers for part in _extent("export", writer)),
    )


def _matrix(formats: list[Any]) -> str:
    from halpipe.core.extent import ASPECTS

    head = f"| | {' | '.join(f'`{format.name}`' for format in formats)} |"
    rows = (
        f"| {meaning} | {' | '.join('yes' if aspect in format.extent.carried else '' for format in formats)} |"
        for aspect, meaning in ASPECTS.items()
    )
    return "\n".join((head, "|---" * (len(formats) + 1) + "|", *rows))


def _extent(verb: str, format: Any) -> tuple[str, ...]:
    from halpipe.core.extent import ASPECTS

    rows = (
        f"| {ASPECTS[aspect]} | {_escaped(format.extent.carried[aspect])} |"
        for aspect in ASPECTS
        if aspect in format.extent.carried
    )
    lost = "\n".join(f"* {sentence}" for sentence in format.extent.lost)
    title = f"## halpipe {verb} {format.name}"
    return title, f"{format.summary[0].upper()}{format.summary[1:]}.", "\n".join(("| | |", "|---|---|", *rows)), lost


# ------------------------------------------------------------------------------------------------ exit codes


def exit_codes_page() -> str:
    """The exit codes of every command."""
    rows = (f"| {int(code)} | {code.name.lower().replace('_', ' ')} | {MEANINGS[code]} |" for code in Exit)
    return _page(
        "Exit codes",
        "The same for every command, so that scripts can tell the cases apart.",
        "\n".join(("| code | name | meaning |", "|---|---|---|", *rows)),
    )


# ------------------------------------------------------------------------------------------------ command line


def cli_page() -> str:
    """Every verb with its arguments and options, from the signatures that typer makes the command line of."""
    from halpipe.cli import export, import_
    from halpipe.cli.app import VERBS, build
    from halpipe.cli.output import SHOWN_PER_CODE
    from halpipe.flow.formats import EXPORTERS, IMPORTERS, exporter, formats, importer

    app = build(VERBS)
    verbs = [(str(command.name), command.callback) for command in app.registered_commands if command.callback]
    for group in app.registered_groups:
        inside = group.typer_instance.registered_commands if group.typer_instance else []
        verbs += [(f"{group.name} {command.name}", command.callback) for command in inside if command.callback]
        if group.name == "export":
            verbs += [(f"export {name}", export.ExportGroup.command_of(exporter(name))) for name in formats(EXPORTERS)]
        if group.name == "import":
            verbs += [(f"import {name}", import_.ImportGroup.command_of(importer(name))) for name in formats(IMPORTERS)]
    rows = (f"| [`{name}`](#halpipe-{name.replace(' ', '-')}) | {_doc(function)[0]} |" for name, function in verbs)
    overview = "\n".join(("| verb | |", "|---|---|", *rows))
    common = (
        "Results go to standard output or to the file named with `-o`, everything else to standard error. For input, "
        "`-` is standard input; for output, standard output. Colour is used on a terminal only, and never where "
        "`NO_COLOR` is set. In text form at most {errors} errors and {warnings} warnings of one code are shown, and "
        "notes are counted; `--verbose`, JSON and SARIF have them all. The exit codes are "
        "[the same for every verb](exit-codes.md). `halpipe --version` prints the version, and `-h` or `--help` after "
        "a verb this page in short."
    )
    shown = {f"{severity}s": most for severity, most in SHOWN_PER_CODE.items()}
    return _page(
        "The command line", common.format(**shown), overview, *(_verb(name, function) for name, function in verbs)
    )


# ------------------------------------------------------------------------------------------------ options


def options_page() -> str:
    """Every option of formats and verbs, from the fields that state them."""
    from halpipe.deploy.base import CheckOptions
    from halpipe.exporters.riscv import PrepareOptions
    from halpipe.flow.formats import EXPORTERS, IMPORTERS, exporter, formats, importer
    from halpipe.pipeline.compare import CompareOptions
    from halpipe.pipeline.explain.explanation import ExplainOptions
    from halpipe.pipeline.generate import SetParameters
    from halpipe.pipeline.solve.schedule import SearchOptions
    from halpipe.pipeline.whatif.sensitivity import SensitivityOptions
    from halpipe.pipeline.whatif.size import SizeOptions

    kinds = {f"import {name}": importer(name).options for name in formats(IMPORTERS)}
    kinds |= {"schedule": SearchOptions, "explain": ExplainOptions, "compare": CompareOptions}
    kinds |= {"deploy check": CheckOptions, "deploy prepare": PrepareOptions}
    kinds |= {"size": SizeOptions, "sensitivity": SensitivityOptions, "generate": SetParameters}
    kinds |= {f"export {name}": exporter(name).options for name in formats(EXPORTERS)}
    return _page(
        "Options",
        "An option has one name, one default and one set of values everywhere: `--name` on the "
        "[command line](cli.md), `name` in a [pipeline file](pipeline.md) (import, schedule and export), and a keyword "
        "of [Python](python.md), in which `_` stands for `-`. An option that may be repeated is a list there, whose "
        "keyword may be in the plural, too. Durations have a unit (`ns`, `us`, `ms`, `s`); a time limit without one is "
        "in seconds. An option of another format or verb is refused, and so is one without effect beside the others "
        "([HAL0025](diagnostics.md#hal0025)).",
        *(part for verb, kind in kinds.items() for part in (f"## {verb}", _options(kind))),
    )


def _options(kind: type) -> str:
    from halpipe.core.options import options_of

    rows = []
    for each in options_of(kind):
        keywords = ", ".join(f"`{keyword}`" for keyword in each.keywords)
        values = ", ".join(f"`{word}`" for word in each.words) or f"{each.metavar or each.form.value}".lower()
        default = "required" if each.required else each.shown_default
        rows.append(f"| `{each.name}` | {values} | {_escaped(each.help)} | {_escaped(default)} | {keywords} |")
    return "\n".join(("| option | value | | default | in Python |", "|---|---|---|---|---|", *rows))


def _doc(function: Callable[..., Any]) -> tuple[str, ...]:
    """Return the paragraphs of a docstring, each on one line."""
    return tuple(" ".join(part.split()) for part in (inspect.getdoc(function) or "").split("\n\n"))


def _verb(name: str, function: Callable[..., Any]) -> str:
    from typer.models import ArgumentInfo

    hints = get_type_hints(function, include_extras=True) if function.__module__ else {}
    parameters = [
        (parameter, *get_args(hints[parameter.name])) for parameter in inspect.signature(function).parameters.values()
    ]
    usage, required_options = [f"halpipe {name}"], []
    arguments, options = ["| argument | |", "|---|---|"], ["| option | | default |", "|---|---|---|"]
    for parameter, kind, info in parameters:
        required = parameter.default is inspect.Parameter.empty
        if isinstance(info, ArgumentInfo):
            shown = info.metavar or parameter.name.upper()
            shown += "..." if get_origin(kind) is list else ""
            usage.append(shown if required else f"[{shown}]")
            arguments.append(f"| `{shown}` | {info.help} |")
            continue
        flags, value = _option(parameter.name, kind, info)
        required_options += [f"{flags[-1]} {value}"] if required else []
        text = " or ".join(f"`{flag} {value}`" if value else f"`{flag}`" for flag in flags)
        default = "required" if required else _default(parameter.default, info, flags)
        options.append(f"| {text} | {_escaped(info.help)} | {default} |")
    usage += [*required_options, "[OPTIONS]"]
    parts = [f"## halpipe {name}", *_doc(function), f"```\n{' '.join(usage)}\n```"]
    parts += ["\n".join(table) for table in (arguments, options) if len(table) > 2]
    return "\n\n".join(parts)


def _option(name: str, kind: Any, info: Any) -> tuple[list[str], str]:
    """Return the spellings of an option, and the word for its value (empty: it is a switch)."""
    long = "--" + name.rstrip("_").replace("_", "-")
    # In an annotation, typer keeps the first spelling where a default value would stand.
    stated = [flag for flag in (info.default, *(info.param_decls or ())) if isinstance(flag, str)]
    flags = [flag for flag in stated if flag.startswith("-")] or [long]
    inner = next((part for part in get_args(kind) if part is not type(None)), kind)  # X | None
    inner = get_args(inner)[0] if get_origin(inner) is list else inner
    if inner is bool:
        return flags if stated else [long, "--no-" + long.removeprefix("--")], ""
    if isinstance(inner, type) and issubclass(inner, Enum):
        return flags, info.metavar or "\\|".join(member.value for member in inner)
    words = {int: "INTEGER", float: "NUMBER", str: "TEXT"}
    return flags, _escaped(info.metavar or words[inner])


def _default(value: Any, info: Any, flags: list[str]) -> str:
    if isinstance(info.show_default, str):
        return f"`{info.show_default}`"
    if isinstance(value, bool) and len(flags) > 1 and flags[1].startswith("--no-"):
        return f"`{flags[0] if value else flags[1]}`"
    return "" if value in (None, "", False) else f"`{value}`"


# ------------------------------------------------------------------------------------------------ schemas

XS = "{http://www.w3.org/2001/XMLSchema}"


def schemas_page() -> str:
    """The elements of the task model and of the schedule, from their XML schemas."""
    from halpipe.schemas import SCHEDULE, TASK_MODEL

    intro = (
        "halpipe has two file formats of its own. Both are XML in a namespace that carries the version of the format, "
        "and both are checked against their schema before anything is read: every violation is reported with its line "
        "as [HAL0102](diagnostics.md#hal0102). The schema files are in `src/halpipe/schemas`."
    )
    return _page("File formats", intro, *(_schema(kind) for kind in (TASK_MODEL, SCHEDULE)))


def _schema(kind: str) -> str:
    from halpipe.core.files import parse_xml

    name = f"{kind}-1.xsd"
    schema = parse_xml(resources.files("halpipe.schemas").joinpath(name).read_bytes(), name)
    types = {node.get("name"): node for node in schema.iterchildren(f"{XS}complexType")}
    parts = [f"## {kind.replace('-', ' ').capitalize()}: `{name}`", f"Namespace `{schema.get('targetNamespace')}`."]
    parts.append(_documentation(schema))
    parts += [_element(element, type) for element, type in _elements(schema, types)]
    simple = [f"| `{t.get('name')}` | {_form(t)} |" for t in schema.iterchildren(f"{XS}simpleType")]
    parts += [f"### Values of a {kind.replace('-', ' ')}", "\n".join(("| type | form |", "|---|---|", *simple))]
    return "\n\n".join(part for part in parts if part)


def _elements(
    schema: etree._Element, types: dict[str | None, etree._Element]
) -> Iterator[tuple[etree._Element, etree._Element | None]]:
    """Yield every element once with its type, in the order in which a document has them."""
    seen: set[str] = set()
    ahead = list(schema.iterchildren(f"{XS}element"))
    while ahead:
        element = ahead.pop(0)
        if element.get("name") in seen:
            continue
        seen.add(str(element.get("name")))
        type = types.get(element.get("type"))
        type = element.find(f"{XS}complexType") if type is None else type
        yield element, type
        ahead = ([] if type is None else list(type.iterfind(f"{XS}sequence/{XS}element"))) + ahead


def _element(element: etree._Element, type: etree._Element | None) -> str:
    parts = [f"### `<{element.get('name')}>`", _documentation(element)]
    parts.append("" if type is None else _documentation(type))
    attributes = [] if type is None else type.findall(f"{XS}attribute")
    if attributes:
        rows = (
            f"| `{a.get('name')}` | {_type(a)} | {_presence(a)} | {_documentation(a) or _remark(a)} |"
            for a in attributes
        )
        parts.append("\n".join(("| attribute | type | | |", "|---|---|---|---|", *rows)))
    children = [] if type is None else type.findall(f"{XS}sequence/{XS}element")
    if children:
        listed = (f"`<{child.get('name')}>` ({_times(child)}{_remark(child, '; ')})" for child in children)
        parts.append("Holds, in this order: " + ", ".join(listed) + ".")
    return "\n\n".join(part for part in parts if part)


def _documentation(node: etree._Element) -> str:
    """Return the annotation of a node itself, not of what is inside it."""
    return " ".join((node.findtext(f"{XS}annotation/{XS}documentation") or "").split())


def _remark(node: etree._Element, before: str = "") -> str:
    """Return the comment that stands right before a node of the schema."""
    comment = node.getprevious()
    is_comment = comment is not None and not isinstance(comment.tag, str)
    return before + " ".join((comment.text or "").split()) if is_comment else ""


def _type(attribute: etree._Element) -> str:
    words = [f"`{value.get('value')}`" for value in attribute.iter(f"{XS}enumeration")]
    patterns = [f"`{value.get('value')}`" for value in attribute.iter(f"{XS}pattern")]
    return ", ".join(words or patterns).replace("|", "\\|") or str(attribute.get("type")).removeprefix("xs:")


def _presence(attribute: etree._Element) -> str:
    if attribute.get("use") == "required":
        return "required"
    default = attribute.get("default")
    return f"default `{default}`" if default else "optional"


def _times(element: etree._Element) -> str:
    least, most = element.get("minOccurs", "1"), element.get("maxOccurs", "1")
    return {("1", "1"): "one", ("0", "1"): "optional"}.get(
        (least, most), "any number" if least == "0" else "one or more"
    )


def _form(type: etree._Element) -> str:
    documented = _documentation(type)
    words = [f"`{value.get('value')}`" for value in type.iter(f"{XS}enumeration")]
    items = [value.get("itemType") for value in type.iter(f"{XS}list")]
    if items:
        return f"{str(items[0]).removeprefix('xs:')}, at least one, separated by white space"
    limits = [
        f"{word} {value.get('value')}"
        for facet, word in (("minInclusive", "at least"), ("maxInclusive", "at most"), ("maxLength", "length at most"))
        for value in type.iter(XS + facet)
    ]
    base = type.find(f"{XS}restriction")
    plain = "" if base is None else str(base.get("base")).removeprefix("xs:")
    return "; ".join([documented or ", ".join(words) or plain, *limits])


def main() -> None:
    """Write the XML schemas, which the pages are made from, then the pages."""
    from schema_files import ELEMENTS, schema_file

    for path, text in map(schema_file, ELEMENTS):
        path.write_text(text, encoding="utf-8")
    REFERENCE.mkdir(exist_ok=True)
    for name, text in pages().items():
        (REFERENCE / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
