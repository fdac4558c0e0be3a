"""What keeps a bundle from being built is told with file, element and numbers, and nothing is written."""

import shutil
from dataclasses import replace

import pytest

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.exporters.riscv import codes
from halpipe.exporters.riscv.toolchain import GCC, INSTALL_GCC
from riscv_models import PHASES, SCALE, deployed, moving, single

NEEDS_GCC = pytest.mark.skipif(shutil.which(GCC) is None, reason=f"{GCC} is not installed: {INSTALL_GCC}")
CALLS_ANOTHER = SCALE.replace("void scale", "uint32_t other(uint32_t x);\nvoid scale").replace("* 3", "* other(3)")


@pytest.mark.parametrize(
    ("text", "code", "said"),
    [
        ("void scale(void) { flaot x; }", codes.COMPILE_FAILED, "flaot"),
        ('#include "absent.h"\n' + SCALE, codes.COMPILE_FAILED, "absent.h"),
        (CALLS_ANOTHER, codes.LINK_FAILED, "other"),
        (SCALE.replace("void scale(", "void scales("), codes.MISSING_ENTRY, '"scale"'),
        (SCALE.replace("uint32_t scaled[16];", "uint32_t scaled[15];"), codes.SYMBOL_TOO_SMALL, "60"),
        (SCALE.replace("scaled", "result"), codes.MISSING_SYMBOL, '"scaled"'),
    ],
)
def test_sources(refusal, text, code, said):
    found = refusal(*single(), scale_c=text)
    assert found.code == code.id
    assert said in found.message
    assert found.help
    assert found.at.line


def test_the_compilers_line_is_the_sources(refusal, tmp_path):
    found = refusal(*single(), scale_c="\n\nvoid scale(void) { flaot x; }")
    assert (found.at.file, found.at.line) == (str(tmp_path / "scale.c"), 3)


def test_two_definitions_of_a_function(refusal):
    found = refusal(*single(deployed(files="scale.c twice.c")), twice_c="void scale(void) {}")
    assert found.code == codes.NAME_CLASH.id
    assert "scale" in found.message


def test_a_transfer_needs_a_variable_of_its_own(refusal):
    text = SCALE.replace("uint32_t scaled[16];", '__attribute__((section(".bss"))) uint32_t scaled[16];')
    found = refusal(*single(), scale_c=text)
    assert found.code == codes.MISSING_SYMBOL.id
    assert "cleared" in found.message


def test_no_file_from_elsewhere_is_stated(refusal, tmp_path):
    found = refusal(*single(), scale_c=SCALE + '__asm__(".incbin \\"/etc/passwd\\"");')
    assert found.code == codes.OUTSIDE_FILE.id
    assert found.at == Location(str(tmp_path / "scale.c"), SCALE.count("\n") + 1)


@pytest.mark.parametrize("toolchain", ["zig", pytest.param("gcc", marks=NEEDS_GCC)])
@pytest.mark.parametrize("directive", ['#line 1 "{file}"', '# 1 "{file}" 1', '#line 1 "src/../{file}"'])
def test_a_message_quotes_no_other_file(refusal, tmp_path, directive, toolchain):
    """`#line` says where a line is from, and compilers, as we do, show the line that stands there."""
    (tmp_path / "secret").write_text("years of work")
    text = f"{SCALE}\n{directive.format(file=tmp_path / 'secret')}\nint x = ;\n"
    found = refusal(*single(), scale_c=text, toolchain=toolchain)
    assert found.code == codes.COMPILE_FAILED.id
    assert found.at == Location(str(tmp_path / "scale.c"))
    assert "secret line 1" in found.message
    assert "work" not in found.message


def test_ordinary_assembler_is_built(build):
    bundle = build(*single(), scale_c=SCALE + 'void wait(void) { __asm__ volatile("wfi"); }')
    assert "bundle.elf" in bundle


@pytest.mark.parametrize("text", ["uint32_t scaled[16] = {1};", "uint32_t scaled[16] = {0, 0, 7};"])
def test_a_transfer_variable_with_an_initial_value(refusal, text):
    found = refusal(*single(), scale_c=SCALE.replace("uint32_t scaled[16];", text))
    assert found.code == codes.INITIALISED.id
    assert '"scaled" has an initial value' in found.message


def test_two_buffers_read_into_one_variable(refusal):
    read = moving("memory", "0.1ms", "0.2ms", "read", ("input", "numbers", 64), ("other", "numbers", 32))
    found = refusal(*single(deployed(phases=(PHASES[0], read, PHASES[2]))))
    assert found.code == codes.OVERWRITTEN.id
    assert '"other" is read into "numbers" over what "input" brought there' in found.message


@pytest.mark.parametrize("size", [63, 12, 60])  # of the last two, a part would end within a word
def test_what_a_gang_cannot_divide(refusal, size):
    phases = (*PHASES[:2], moving("memory", "0.9ms", "1ms", "write", ("output", "scaled", size)))
    found = refusal(*single(deployed(units="u1 u2", gang=2, phases=phases), units="u1 u2"))
    assert found.code == codes.UNDIVIDED.id
    assert found.help == "make it a multiple of 16 bytes: each member writes whole words of 8 bytes"


# Of 120 KiB for code, the monitor has 4; of 256 KiB for data, stack and mailbox have 12.
CODE = 'static void huge(void) {{ __asm__ volatile(".zero {}"); }}'
BSS = "uint8_t big[{}];\nstatic void huge(void) {{ *(volatile uint8_t *)big = 1; }}"
CONSTANT = "const uint8_t big[{}] = {{1}};\nstatic void huge(void) {{ (void)*(const volatile uint8_t *)big; }}"


def with_more(more, size):
    return "#include <stdint.h>\n" + more.format(size) + "\n" + SCALE.replace("scale(void) {", "scale(void) { huge();")


@pytest.mark.parametrize(("more", "size", "what"), [(CODE, 116, "code"), (BSS, 244, "data"), (CONSTANT, 244, "data")])
def test_images_must_fit(refusal, more, size, what):
    found = refusal(*single(), scale_c=with_more(more, size * 1024))
    assert found.code == codes.IMAGE_TOO_LARGE.id
    kibibytes = int(found.message.removeprefix(f"{what} has ").split()[0]) // 1024
    assert kibibytes == size
    assert f"room for {size * 1024 if what == 'data' else 116 * 1024} " in found.message


@pytest.mark.parametrize(("more", "size"), [(BSS, 244 * 1024 - 128)])
def test_images_may_fill_the_scratchpad(build, more, size):
    """Both transfer variables have 64 bytes."""
    assert build(*single(), scale_c=with_more(more, size))


def test_a_phase_that_is_too_short_says_by_how_much(refusal):
    phases = (moving("memory", "0ms", "5us", "load"), *PHASES[1:])
    found = refusal(*single(deployed(phases=phases)))
    assert found.code == codes.PHASE_TOO_SHORT.id
    assert "has 5us" in found.message
    assert "need" in found.message


READ_AFTER_WRITE = (
    *PHASES[:2],
    moving("memory", "0.3ms", "0.4ms", "write", ("output", "scaled", 64)),
    moving("memory", "0.5ms", "0.6ms", "read", ("input", "numbers", 64)),
)


@pytest.mark.parametrize(
    ("phases", "code"),
    [
        (PHASES[1:], codes.NO_LOAD_PHASE),
        (
            (PHASES[0], moving("memory", "0.1ms", "0.2ms", "read", ("in", "numbers", 64), bound="1/2")),
            codes.SHARED_PHASE,
        ),
        ((PHASES[0], moving("memory", "0.1ms", "0.2ms", None, ("in", "numbers", 64))), codes.KINDLESS_PHASE),
        (READ_AFTER_WRITE, codes.PHASE_ORDER),
        (READ_AFTER_WRITE[1:], codes.NO_LOAD_PHASE),  # where there is an order is looked at afterwards
    ],
)
def test_phases(refusal, phases, code):
    assert refusal(*single(deployed(phases=phases))).code == code.id


def test_what_has_no_sources_is_asked_for_them_alone(refusal):
    found = refusal(*single(replace(deployed(), source=None)))
    assert (found.code, found.message) == (codes.NO_SOURCE.id, "the version has no sources")


def test_several_at_once(build):
    system, tables = single(deployed(files="absent.c", phases=PHASES[1:]))
    with pytest.raises(HalpipeError) as caught:
        build(system, tables)
    assert {d.code for d in caught.value.diagnostics} == {codes.MISSING_FILE.id, codes.NO_LOAD_PHASE.id}


@pytest.mark.parametrize(
    ("type", "operation", "is_refused"),
    [
        ("uint8_t", "__atomic_fetch_add(&flag, 1, 5)", True),
        ("uint32_t", "__sync_val_compare_and_swap(&flag, 0, 1)", True),
        ("uint32_t", "__atomic_fetch_add(&flag, 1, 5)", False),
    ],
)
def test_reservations_on_a_scratchpad_without_them(build, refusal, type, operation, is_refused):
    text = SCALE.replace("void scale", f"static {type} flag;\nvoid scale").replace("numbers[i] * 3;", f"{operation};")
    if not is_refused:
        assert build(*single(), scale_c=text)
        return
    found = refusal(*single(), scale_c=text)
    assert found.code == codes.NO_RESERVATIONS.id
    assert " lr or sc, the first at 0x18210" in found.message
