"""Images: which variables transfers can use, what compilers and linkers say, and the room in main memory."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.exporters.riscv import images
from halpipe.exporters.riscv.codes import (
    COMPILE_FAILED,
    INITIALISED,
    LINK_FAILED,
    MAIN_MEMORY_FULL,
    MISSING_ENTRY,
    MISSING_SYMBOL,
    NAME_CLASH,
    NO_RESERVATIONS,
    OVERWRITTEN,
    SYMBOL_TOO_SMALL,
)
from halpipe.exporters.riscv.cores import cores_of
from halpipe.exporters.riscv.images import Image, Part, compile_sources, link_images, measure
from halpipe.exporters.riscv.profile import read_profile
from halpipe.exporters.riscv.render import Renderer
from halpipe.exporters.riscv.sources import SourceTree
from halpipe.exporters.riscv.toolchain import Compile, Elf, Failure, Segment, Symbol
from riscv_models import PHASES, deployed, moving, single

PROFILE = read_profile("vcu118")
CODE, DATA = 0x01820000 + 4096, 0x01040000 + 8192
BSS = DATA + 0x1000
"""Where an image's code, its constants and what the monitor clears begin."""


def elf(reserving=(), **symbols):
    """An image whose symbols are (address, size), besides those that make it a sound one."""
    places = {"scale": (CODE, 100), "numbers": (BSS + 0x400, 64), "scaled": (BSS + 0x800, 64)}
    places |= {"hp_code_end": (CODE + 400, 0), "hp_data_end": (BSS + 0x900, 0)}
    places |= {"hp_bss_begin": (BSS, 0), "hp_bss_end": (BSS + 0x100, 0)} | symbols
    found = {name: Symbol(*place) for name, place in places.items() if place}
    segments = Segment(0, 0x1000, CODE, 400), Segment(400, 0x1000 + 400, DATA, 0x200)
    return Elf(segments, found, reserving)


class Shop:
    """A workshop whose tools say what a test has them say."""

    def __init__(self, *failures):
        self.failures, self.written, self.linked = [*failures], {}, []

    def write(self, name, content):
        self.written[name] = content

    def compile(self, steps):
        return self.failures

    def link(self, steps, *, is_final=True):
        self.linked.append((is_final, steps))
        return self.failures

    def read(self, name):
        return name


RENDER = SimpleNamespace(image_script=lambda part, core, at, place=(0, 0): (part, core, at, place))


def part_of(version=None, units="u1"):
    version = version or deployed(units=units)
    system, _ = single(version, units=units)
    cores = cores_of(system, set(), PROFILE, Findings())
    return Part("scale", version, tuple(cores[unit] for unit in units.split()), ("src/scale.c",))


def faults(image, version=None, profile=PROFILE):
    """What is reported of an image that has been linked to be measured."""
    part = part_of(version)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(images, "read_elf", lambda data: image)
        try:
            assert measure(Shop(), {part: ("a.o",)}, profile, RENDER) == {part: image}
        except HalpipeError as refused:
            return [(d.code, d.message) for d in refused.diagnostics]
    return []


@pytest.mark.parametrize(
    ("numbers", "code"),
    [
        ((BSS + 0x400, 64), None),
        ((BSS + 0x400, 63), SYMBOL_TOO_SMALL),
        ((BSS + 0x400, 65), None),
        (None, MISSING_SYMBOL),
        ((BSS + 0x400, 64, False), NAME_CLASH),
        ((DATA, 64), INITIALISED),
        ((DATA + 0x1FF, 64), INITIALISED),
        ((DATA + 0x200, 64), None),
        ((DATA - 1, 64), None),
        ((BSS, 64), MISSING_SYMBOL),
        ((BSS + 0xFF, 64), MISSING_SYMBOL),
        ((BSS + 0x100, 64), None),
        ((BSS - 1, 64), None),
    ],
)
def test_a_transfer_needs_a_variable_of_its_size_that_nothing_else_sets(numbers, code):
    """It has room for the bytes, is no other's, and lies neither in what is loaded nor in what is cleared."""
    assert [found for found, _ in faults(elf(numbers=numbers))] == ([code.id] if code else [])


def test_what_is_wrong_with_a_variable_states_both_sizes():
    assert faults(elf(numbers=(BSS + 0x400, 63))) == [(SYMBOL_TOO_SMALL.id, 'moves 64 bytes, but "numbers" has 63')]


def test_functions_are_defined():
    assert faults(elf(scale=None)) == [(MISSING_ENTRY.id, 'no source defines the function "scale"')]


def test_reservations_need_a_memory_that_has_them():
    """Rocket's data scratchpad has none: lr and sc would trap."""
    known = replace(PROFILE, dspm=replace(PROFILE.dspm, has_reservations=True))
    assert not PROFILE.dspm.has_reservations
    message = "its code has 2 lr or sc, the first at 0x1820040"
    assert faults(elf((0x1820040, 0x1820048))) == [(NO_RESERVATIONS.id, message)]
    assert faults(elf((0x1820040,)), profile=known) == faults(elf()) == []


@pytest.mark.parametrize(
    ("begins", "second", "kind", "found"),
    [
        ("0.2ms", BSS + 0x400, "read", 1),
        ("0.2ms", BSS + 0x43F, "read", 1),
        ("0.2ms", BSS + 0x3C1, "read", 1),
        ("0.2ms", BSS + 0x440, "read", 0),
        ("0.2ms", BSS + 0x3C0, "read", 0),
        ("0.3ms", BSS + 0x400, "read", 0),  # the function runs in between
        ("0.2ms", BSS + 0x400, "write", 0),
    ],
)
def test_nothing_is_read_over_what_was_read_before(begins, second, kind, found):
    phases = (*PHASES[:2], moving("memory", begins, "0.4ms", kind, ("more", "others", 64)))
    entry = "scale" if begins == "0.2ms" else "scale scale"
    seen = faults(elf(others=(second, 64)), deployed(phases=phases, entry=entry))
    message = '"more" is read into "others" over what "input" brought there'
    assert seen == [(OVERWRITTEN.id, message)] * found


# ------------------------------------------------------------------------------------------------ tools


def said(tmp_path, text):
    tree = SourceTree(tmp_path, Findings(), {"src/a.c": b"", "src/lib/b.h": b""})
    findings = Findings()
    steps = [Compile("src/a.c", "0.o"), Compile("src/a.c", "1.o", ("X",))]
    compile_sources(Shop(Failure(1, text)), steps, ["first", "second"], tree, findings)
    assert {(d.code, d.path) for d in findings.items} == {(COMPILE_FAILED.id, "second")}
    return [(d.message, d.at.file.removeprefix(f"{tmp_path}/"), d.at.line) for d in findings.items]


def test_errors_of_compilers_are_at_the_lines_of_sources(tmp_path):
    text = "src/a.c:3:5: error: wrong\nsrc/x/../lib/b.h:7: fatal error: worse\n/etc/passwd:1:1: error: root"
    assert said(tmp_path, text) == [
        ("wrong", "a.c", 3),
        ("worse", "lib/b.h", 7),
        ("root (/etc/passwd line 1)", "a.c", 0),  # no line of a file that `#line` names is quoted
    ]


def test_of_a_compiler_that_names_no_line_the_last_words_are_shown(tmp_path):
    assert said(tmp_path, "killed\n   int secret;\nby a signal") == [("killed\nby a signal", "a.c", 0)]
    ((message, *_),) = said(tmp_path, "x" * 100 + "y" * 400)
    assert message == "y" * 400


def test_an_error_in_the_runtime_shows_its_last_words():
    with pytest.raises(HalpipeError) as refused:
        images.compile_runtime(Shop(Failure(0, "x" * 100 + "y" * 500)), [Compile("runtime/m.c", "m.o")])
    assert refused.value.diagnostics[0].message == "runtime/m.c: " + "y" * 500


@pytest.mark.parametrize(
    ("text", "code", "shown"),
    [
        ("ld: error: duplicate symbol: f\n>>> defined in a.o", NAME_CLASH, "ld: error: duplicate symbol: f"),
        ("a.o: multiple definition of `f'\nld: warning: old", NAME_CLASH, "a.o: multiple definition of `f'"),
        ("undefined   symbol: f\nof  b.o", LINK_FAILED, "undefined symbol: f of b.o"),
        ("z" * 401, LINK_FAILED, "z" * 400),
    ],
)
def test_what_a_linker_refuses_is_shown_in_one_line(text, code, shown):
    with pytest.raises(HalpipeError) as refused:
        measure(Shop(Failure(0, text)), {part_of(): ("a.o",)}, PROFILE, RENDER)
    assert [(d.code, d.message) for d in refused.value.diagnostics] == [(code.id, shown)]


def test_a_measured_image_is_no_part_of_the_recipe(monkeypatch):
    monkeypatch.setattr(images, "read_elf", lambda data: elf())
    shop, part = Shop(), part_of(units="u1 u2")
    measure(shop, {part: ("a.o",)}, PROFILE, RENDER)
    assert [is_final for is_final, _ in shop.linked] == [False]
    assert shop.written == {"link/measure0.ld": (part, part.cores[0], 0, (0, 0))}


# ------------------------------------------------------------------------------------------------ main memory


def linked(monkeypatch, room, *failures):
    """Link an image of 912 bytes for each of two cores, into so many bytes from 0x1000 on."""
    monkeypatch.setattr(images, "read_elf", lambda data: elf())
    shop, part = Shop(*failures), part_of(units="u1 u2")
    places = {(part, core): (64 * number, 0) for number, core in enumerate(part.cores)}
    found = link_images(shop, {part: ("a.o",)}, {part: elf()}, (0x1000, 0x1000 + room), places, RENDER)
    return shop, part, found


def test_images_lie_one_after_the_other_each_at_a_line_of_64_bytes(monkeypatch):
    assert elf().stored == 912
    shop, part, found = linked(monkeypatch, 2 * 960)
    assert shop.written == {
        "link/0.ld": (part, part.cores[0], 0x1000, (0, 0)),
        "link/1.ld": (part, part.cores[1], 0x1000 + 960, (64, 0)),
    }
    assert [(image.core, image.file) for image in found] == [
        (part.cores[0], "images/0.elf"),
        (part.cores[1], "images/1.elf"),
    ]
    assert [is_final for is_final, _ in shop.linked] == [True]


def test_images_that_main_memory_does_not_hold_are_refused_with_what_is_missing(monkeypatch):
    with pytest.raises(HalpipeError) as refused:
        linked(monkeypatch, 2 * 960 - 1)
    (found,) = refused.value.diagnostics
    assert (found.code, found.message) == (MAIN_MEMORY_FULL.id, "2 images need 1B more than there is")


def test_an_image_that_one_core_has_no_room_for_is_refused(monkeypatch):
    with pytest.raises(HalpipeError) as refused:
        linked(monkeypatch, 2 * 960, Failure(1, "section .text will not fit"))
    assert [(d.code, d.path) for d in refused.value.diagnostics] == [(LINK_FAILED.id, part_of().path)]


def test_an_image_states_its_functions_and_what_the_monitor_clears():
    version = deployed(entry="scale numbers")
    image = Image(part_of(version), part_of().cores[0], "images/0.elf", elf())
    assert image.entries == (CODE, BSS + 0x400)
    assert image.bss == (BSS, 0x100)
    assert Elf((), {}).stored == 0
    assert Elf((Segment(0, 100, 0, 10), Segment(10, 200, 0, 5)), {}).stored == 105


@pytest.mark.parametrize(("code", "data"), [(0, 0), (1, 0), (0, 1), (1, 1)])
def test_an_image_fits_beside_monitor_stack_and_mailbox(code, data):
    """On the paper's platform: 120 KiB less 4 for the monitor; 256 KiB less 8 of stack and 4 of mailbox."""
    ends = {"hp_code_end": (CODE + 116 * 1024 + code, 0), "hp_data_end": (DATA + 244 * 1024 + data, 0)}
    rooms = {"code": 116 * 1024, "data": 244 * 1024}
    assert [message for _, message in faults(elf(**ends))] == [
        f"{what} has {room + 1} bytes; there is room for {room} beside monitor, stack and mailbox"
        for (what, room), beyond in zip(rooms.items(), (code, data), strict=True)
        if beyond
    ]


@pytest.mark.parametrize("place", [(0, 0), (64, 128)])
def test_an_image_lies_behind_those_that_are_open_with_it(place):
    """Code behind the monitor, data behind the stack, each as far behind other images as stated."""
    part = part_of()
    script = Renderer(PROFILE).image_script(part, part.cores[0], 0x80001000, place)
    code, data = 0x01820000 + 4096 + place[0], 0x01040000 + 8192 + place[1]
    assert hex(code) in script
    assert hex(data) in script
    assert hex(0x80001000) in script
