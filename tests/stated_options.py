"""The options of a format as a pipeline file states them."""

from halpipe.core.diagnostics import Findings
from halpipe.core.files import parse_yaml
from halpipe.core.options import from_fields, names_of, options_of
from halpipe.core.settings import Fields


def stated(format, text, base=".", **common):
    """Return the options, and what was wrong with their text."""
    findings = Findings()
    fields = Fields("p.yaml", findings, parse_yaml(text.encode(), "p.yaml"), "export", names_of(format.options))
    return format.options(**from_fields(format.options, fields, base) | common), findings.items


def option_of(format, name):
    """Return one option of a format."""
    return next(each for each in options_of(format.options) if each.name == name)
