"""Templates of exports: what Jinja is told to do with blanks, unknown names and markup."""

import pytest
from jinja2 import UndefinedError

from halpipe.exporters.common.templates import environment


@pytest.mark.parametrize(("escaped", "shown"), [(False, "<b>"), (True, "&lt;b&gt;")])
def test_blocks_leave_no_lines_and_names_have_to_be_known(tmp_path, escaped, shown):
    text = "a\n  {% if x %}\n  {{ x }}\n  {% endif %}\nc\n"
    (tmp_path / "t.j2").write_text(text, encoding="utf-8")
    template = environment(tmp_path, autoescape=escaped).get_template("t.j2")
    assert template.render(x="<b>") == f"a\n  {shown}\nc\n"
    with pytest.raises(UndefinedError):
        template.render()


def test_nothing_is_escaped_unless_it_is_asked_for(tmp_path):
    (tmp_path / "t.j2").write_text("{{ x }}", encoding="utf-8")
    assert environment(tmp_path).get_template("t.j2").render(x="<b>") == "<b>"
