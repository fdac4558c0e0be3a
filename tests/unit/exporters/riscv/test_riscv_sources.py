"""Sources are found below one folder, with the headers they include, and nothing else of the machine is."""

import time

import pytest

from halpipe.core.diagnostics import Findings
from halpipe.exporters.riscv.codes import BAD_NAME, MISSING_FILE, NO_SOURCE, OUTSIDE_FILE
from halpipe.exporters.riscv.confinement import assembler_reads, outside_includes
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


READS = {
    "an absolute name": '#include "/etc/passwd"',
    "an absolute name in angles": "#include </etc/passwd>",
    "a way out": '#include "../../../etc/passwd"',
    "a way out in angles": "#include <../../etc/passwd>",
    "comments in between": '#/* x\n*/include/**/"/etc/passwd"',
    "continued lines": '#inc\\\nlude "/etc/\\  \npasswd"',
    "a digraph": '%:include "/etc/passwd"',
    "a computed name": '#define X "/etc/passwd"\n#include X',
    "the next of a name": '#include_next "/etc/passwd"',
    "import": '#import "/etc/passwd"',
    "embed": 'char x[] = {\n#embed "/etc/passwd"\n};',
    "a test of presence": '#if __has_include("/etc/passwd")\n#endif',
    "a comment that opens in a raw string": 'char *s = R"x(" /* )x";\n#include "/etc/passwd"',
    "a pragma": '#pragma GCC dependency "/etc/passwd"',
    "backslashes": '#include "..\\\\secret.h"',
    "NUL": '#\0include "/etc/passwd"',
    "NUL after a digraph": '%: \0include "/etc/passwd"',
    "a blank of Unicode": '#\u00a0include "/etc/passwd"',
    "a line continued by a carriage return": '#inc\\\rlude "/etc/passwd"',
    "a line continued behind NUL": '#inc\\\0\nlude "/etc/passwd"',
    "a comment with a slash": '#/* / x */ /* // */include "/etc/passwd"',
    "a test of presence, with NUL": '#if __has_include\0("/etc/passwd")\n#endif',
    "a test of presence by a macro": '#define A __has_include\n#if A("/etc/passwd")\n#endif',
    "a pragma with a comment": '#pragma GCC /* x */ dependency "/etc/passwd"',
}


@pytest.mark.parametrize("kind", READS)
def test_no_way_out_by_the_preprocessor(tree, kind):
    (tree.folder / "a.c").write_text(READS[kind])
    tree.add(deployed(files="a.c"), "here")
    assert set(codes(tree)) == {OUTSIDE_FILE.id}
    assert list(tree.files) == ["src/a.c"]


HOSTILE = [
    b"#" + b"/**/" * 250_000,
    b"#/* " * 250_000,
    b"#" * 1_000_000,
    b"#include X\n" * 100_000,
    b"__has_include(" * 70_000,
]


@pytest.mark.parametrize("text", HOSTILE, ids=lambda text: text[:9])
def test_looking_at_a_megabyte_takes_no_time_that_one_would_notice(text):
    begin = time.process_time()
    assert len(list(outside_includes("a.c", text))) <= len(text) // 4
    assert time.process_time() - begin < 5


def test_ordinary_includes_are_fine(tree):
    (tree.folder / "a").mkdir()
    text = '#include <stdint.h>\n#include "../b.h" // #x\n# include\t"halpipe.h"\nint including; /* includes */\n'
    text += "#if defined(__has_include) && __has_include(<stdint.h>)\n#endif\n#ifdef __has_embed\n#endif\n"
    (tree.folder / "a" / "a.c").write_text(text)
    (tree.folder / "b.h").write_text("#pragma once\n")
    tree.add(deployed(files="a/a.c"), "here")
    assert codes(tree) == []


ASSEMBLER = {
    '.incbin "/etc/passwd"': True,
    '\t.INCBIN "/etc/passwd"': True,
    '".incbin" "/etc/passwd"': True,
    'x: .include "/etc/passwd"': True,
    '".include" "/etc/passwd"': True,
    '.macro m a b\n.\\a\\b "/etc/passwd"\n.endm\nm inc bin': True,
    '.macro m a b\n/**/ .\\a\\b "/etc/passwd"\n.endm\nm inc bin': True,
    '.macro m a b\n/*\n*/ .\\a\\b "/etc/passwd"\n.endm\nm inc bin': True,
    '.macro m a b\n"l": .\\a\\b "/etc/passwd"\n.endm\nm inc bin': True,
    '.macro m a b\n1$: .\\a\\b "/etc/passwd"\n.endm\nm inc bin': True,
    '.macro m a b\nnop\r.\\a\\b "/etc/passwd"\n.endm\nm inc bin': True,
    '.macro m a b\n\f.\\a\\b "/etc/passwd"\n.endm\nm inc bin': True,
    '.macro m a b\nnop \\a\\b "/etc/passwd"\n.endm\nm "; .inc" bin': True,
    '.macro m a="; .inc" b="bin"\nnop \\a\\b "/etc/passwd"\n.endm\nm': True,
    '.macro m s b\nnop \\s .in\\b "/etc/passwd"\n.endm\nm ";" cbin': True,
    '.macro m a\nnop \\a\\()bin "/etc/passwd"\n.endm\nm "; .inc"': True,
    '.macro m a\n\\a "/etc/passwd"\n.endm\nm ".incb""in"': True,
    '.macro m a\n l: \\a "/etc/passwd"\n.endm': True,
    '.irp a, inc\n.\\a\\()bin "/etc/passwd"\n.endr\n': True,
    '.irpc c, n\n.i\\c\\()cbin "/etc/passwd"\n.endr\n': True,
    '.irep a, inc\n.\\a\\()bin "/etc/passwd"\n.endr\n': True,
    '.irepc c, n\n.i\\c\\()cbin "/etc/passwd"\n.endr\n': True,
    '.rep 1\n.in\\()cbin "/etc/passwd"\n.endr\n': True,
    '".macro" m a b\n.\\a\\b "/etc/passwd"\n.endm\nm inc bin': True,
    "l:.macro m a b\n.\\a\\b\n.endm": True,
    ".altmacro": True,
    ".macro save r, at\nsd \\r, \\at(sp)\n.endm\nsave ra, 8": True,  # harmless, but nobody can tell
    ".macro wait\nwfi\n.endm\nwait\n.rept 4\nnop\n.endr": False,
    '.string "a\\n"': False,
    # Names of functions are no directives.
    '.section .text.report\n.section .text.rep\n.string "a\\n"': False,
    '.section .text.macro\n.section .text.include\n.string "a\\n"': False,
    "add a0, a1, a2\n.word 1 # \\": False,
    ".include_me: ret": False,
}
"""Each that reads was seen to, with GNU as or clang, but for the harmless one."""


@pytest.mark.parametrize("text", ASSEMBLER)
def test_no_way_out_by_the_assembler(text):
    assert bool(assembler_reads(text.encode())) == ASSEMBLER[text]


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


@pytest.mark.parametrize("define", ["A B", "-DX", "A=$(rm)", "1=2", "-include/etc/passwd"])
def test_definitions_are_definitions(tree, define):
    (tree.folder / "scale.c").write_text("")
    version = deployed()
    source = type(version.source)(files=("scale.c",), entry="scale", defines=(define,))
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
