"""Sources are found below one folder, with the headers they include, and nothing else of the machine is."""

import pytest

from halpipe.core.diagnostics import Findings
from halpipe.exporters.riscv.codes import BAD_NAME, MISSING_FILE, NO_SOURCE, OUTSIDE_FILE
from halpipe.exporters.riscv.sources import SourceTree
from riscv_models import deployed
from support import version


@pytest.fixture
def tree(tmp_path):
    folder = tmp_path / "sources"
    folder.mkdir()
    return SourceTree(folder, Findings())


def codes(tree):
    return [found.code for found in tree.findings.items]


def test_files_and_what_they_include(tree):
    (tree.folder / "lib").mkdir()
    (tree.folder / "a.c").write_text('#include "lib/b.h"\n#include <stdint.h>\n  #  include "lib/absent.h"\n')
    (tree.folder / "lib/b.h").write_text('#include "c.h"\n#include "../d.h"\n')
    (tree.folder / "lib/c.h").write_text("")
    (tree.folder / "d.h").write_text('#include "lib/b.h"\n')
    assert tree.add(deployed(files="a.c lib/c.h"), "here") == ["src/a.c"]
    assert sorted(tree.files) == ["src/a.c", "src/d.h", "src/lib/b.h", "src/lib/c.h"]
    assert codes(tree) == []


def test_a_version_without_sources(tree):
    assert tree.add(version(), "here") == []
    assert codes(tree) == [NO_SOURCE.id]


def test_a_missing_file_names_where_it_was_sought(tree):
    tree.add(deployed(files="absent.c"), "here")
    assert codes(tree) == [MISSING_FILE.id]
    assert str(tree.folder) in tree.findings.items[0].help


@pytest.mark.parametrize("name", ["../secret.c", "lib/../../secret.c", "/etc/passwd"])
def test_no_way_out_by_name(tree, name):
    (tree.folder.parent / "secret.c").write_text("int secret;")
    tree.add(deployed(files=name), "here")
    assert codes(tree) == [OUTSIDE_FILE.id]
    assert tree.files == {}


def test_no_way_out_by_link(tree):
    (tree.folder.parent / "secret.c").write_text("int secret;")
    (tree.folder / "innocent.c").symlink_to("../secret.c")
    tree.add(deployed(files="innocent.c"), "here")
    assert codes(tree) == [OUTSIDE_FILE.id]
    assert tree.files == {}


def test_no_way_out_by_include(tree):
    (tree.folder.parent / "secret.h").write_text("")
    (tree.folder / "a.c").write_text('#include "../secret.h"\n')
    tree.add(deployed(files="a.c"), "here")
    assert codes(tree) == [OUTSIDE_FILE.id]
    assert list(tree.files) == ["src/a.c"]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ('#include "/etc/passwd"', 1),
        ('\n  #  include "../../../etc/passwd"', 2),
        ('__asm__(".incbin \\"/etc/passwd\\"");', 1),
        ('\n\t.INCBIN "/etc/passwd"', 2),
    ],
)
def test_nothing_from_elsewhere_is_stated(tree, text, line):
    (tree.folder / "a.c").write_text(text)
    tree.add(deployed(files="a.c"), "here")
    assert [(found.code, found.at.line) for found in tree.findings.items] == [(OUTSIDE_FILE.id, line)]


def test_headers_are_held_to_the_same(tree):
    (tree.folder / "a.c").write_text('#include "b.h"\n')
    (tree.folder / "b.h").write_text('#include "../c.h"\n')
    tree.add(deployed(files="a.c"), "here")
    (found,) = tree.findings.items
    assert (found.code, found.at.file) == (OUTSIDE_FILE.id, str(tree.folder / "b.h"))


def test_ordinary_includes_are_fine(tree):
    (tree.folder / "a").mkdir()
    text = '#include <stdint.h>\n#include "../b.h" // #x\n# include\t"halpipe.h"\nint including; /* includes */\n'
    text += "#if defined(__has_include) && __has_include(<stdint.h>)\n#endif\n#ifdef __has_embed\n#endif\n"
    (tree.folder / "a" / "a.c").write_text(text)
    (tree.folder / "b.h").write_text("#pragma once\n")
    tree.add(deployed(files="a/a.c"), "here")
    assert codes(tree) == []


def test_links_inside_are_fine(tree):
    (tree.folder / "real.c").write_text("int x;")
    (tree.folder / "alias.c").symlink_to("real.c")
    assert tree.add(deployed(files="alias.c"), "here") == ["src/alias.c"]
    assert codes(tree) == []


@pytest.mark.parametrize("entry", ["2step", "step;x", "a-b", "x" * 300])
def test_entries_are_c_identifiers(tree, entry):
    (tree.folder / "scale.c").write_text("")
    tree.add(deployed(entry=entry), "here")
    assert codes(tree) == [BAD_NAME.id]


@pytest.mark.parametrize(
    "defines", [("A B",), ("-DX",), ("A=$(rm)",), ("1=2",), ("-include/etc/passwd",), ("A=1", "B", "A=2")]
)
def test_definitions_are_definitions(tree, defines):
    (tree.folder / "scale.c").write_text("")
    version = deployed()
    source = type(version.source)(files=("scale.c",), entry="scale", defines=defines)
    tree.add(type(version)(name="v", wcet=version.wcet, units=("u1",), source=source), "here")
    assert codes(tree) == [BAD_NAME.id]


@pytest.mark.parametrize("name", [".hidden.c", "a$b.c", "x;y.c", "a=b%c~d@.c", "a%.c", "~a.c", "-o.c", "a#.c"])
def test_file_names_are_plain(tree, name):
    (tree.folder / name).write_text("")
    tree.add(deployed(files=name), "here")
    assert codes(tree) == [BAD_NAME.id]


def test_a_long_chain_of_headers(tree):
    for i in range(3000):
        (tree.folder / f"h{i}.h").write_text(f'#include "h{i + 1}.h"\n')
    (tree.folder / "a.c").write_text('#include "h0.h"\n')
    assert tree.add(deployed(files="a.c"), "here") == ["src/a.c"]
    assert len(tree.files) == 3001
