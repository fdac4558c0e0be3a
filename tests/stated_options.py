"""The options of a format as a pipeline file states them."""

from halpipe.diagnostics import Findings
from halpipe.exporters.base import ExportOptions
from halpipe.exporters.choices import choices, keys_of, options_of
from halpipe.files import parse_yaml
from halpipe.settings import Fields


def stated(format, text, base=".", **common):
    """Return the options, and what was wrong with their text."""
    findings = Findings()
    fields = Fields("p.yaml", findings, parse_yaml(text.encode(), "p.yaml"), "export", keys_of(format.options))
    return options_of(format.options, ExportOptions(**common), fields, base), findings.items


def choice_of(format, name):
    """Return one choice of a format."""
    return next(each for each in choices(format.options) if each.name == name)
