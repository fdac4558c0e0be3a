"""The options of a format as a pipeline file states them."""

from halpipe.core.diagnostics import Findings
from halpipe.core.files import parse_yaml
from halpipe.core.settings import Fields
from halpipe.exporters.common.base import ExportOptions
from halpipe.exporters.common.choices import choices, keys_of, options_of


def stated(format, text, base=".", **common):
    """Return the options, and what was wrong with their text."""
    findings = Findings()
    fields = Fields("p.yaml", findings, parse_yaml(text.encode(), "p.yaml"), "export", keys_of(format.options))
    return options_of(format.options, ExportOptions(**common), fields, base), findings.items


def choice_of(format, name):
    """Return one choice of a format."""
    return next(each for each in choices(format.options) if each.name == name)
