"""A program of a task on an emulated RISC-V core: no runtime, no schedule, just its instructions, which are counted."""

import subprocess
from pathlib import Path

import unicorn
import ziglang
from elftools.elf.elffile import ELFFile
from unicorn import riscv_const as rv

MEMORY, STACK = 0x2000000, 0x2000  # the linker places programs at 16 MiB
TARGET = ["-target", "riscv64-freestanding-none", "-mcpu=generic_rv64+m+a+c", "-mabi=lp64", "-mcmodel=medany"]
WARNINGS = ["-std=c11", "-Wall", "-Wextra", "-Werror"]
FLAGS = [*TARGET, *WARNINGS, "-Os", "-g", "-ffreestanding", "-nostdlib", "-static", "-fno-builtin", "-fno-common"]
SAFE = ["-fno-sanitize=undefined", "-fno-stack-protector"]
MEMORY_FUNCTIONS = """
typedef unsigned long size_t;
void *memcpy(void *d, const void *s, size_t n) { char *a = d; const char *b = s; while (n--) *a++ = *b++; return d; }
void *memset(void *d, int c, size_t n) { char *a = d; while (n--) *a++ = (char)c; return d; }
"""


class RiscvProgram:
    """Compiled as for the target; `run` is that of the host's programs, and `instructions` counts the last run."""

    def __init__(self, source, folder: Path, elf: Path):
        zig = str(Path(ziglang.__file__).with_name("zig"))
        library = elf.with_suffix(".lib.c")
        library.write_text(MEMORY_FUNCTIONS)
        files = [*(str(folder / f) for f in source.files), str(library)]
        defines = [f"-D{d}" for d in source.defines]
        place = [f"-Wl,-e,{source.entry}"]
        subprocess.run([zig, "cc", *FLAGS, *SAFE, *defines, *place, "-o", str(elf), *files], check=True, timeout=300)
        with elf.open("rb") as stream:
            program = ELFFile(stream)
            self.symbols = {s.name: s["st_value"] for s in program.get_section_by_name(".symtab").iter_symbols()}
            self.segments = [(s["p_vaddr"], s.data()) for s in program.iter_segments("PT_LOAD")]
            self.sizes = {s.name: s["sh_size"] for s in program.iter_sections()}
            self.code = program.get_section_by_name(".text").data()
        self.entry = self.symbols[source.entry]
        self.instructions = self.deepest = 0

    def run(self, inputs, outputs):
        core = unicorn.Uc(unicorn.UC_ARCH_RISCV, unicorn.UC_MODE_RISCV64)
        core.mem_map(0, MEMORY)
        for address, content in self.segments:
            core.mem_write(address, content)
        for symbol, content in inputs.items():
            core.mem_write(self.symbols[symbol], content)
        self.instructions = 0
        lengths = {}

        def block(core, address, size, _):
            if (address, size) not in lengths:
                code, at, found = core.mem_read(address, size), 0, 0
                while at < size:
                    at += 4 if code[at] & 3 == 3 else 2
                    found += 1
                lengths[address, size] = found
            self.instructions += lengths[address, size]

        core.hook_add(unicorn.UC_HOOK_BLOCK, block)
        core.reg_write(rv.UC_RISCV_REG_SP, MEMORY - 16)
        core.reg_write(rv.UC_RISCV_REG_RA, 0)
        core.emu_start(self.entry, 0)
        stack = bytes(core.mem_read(MEMORY - STACK, STACK))
        self.deepest = max(self.deepest, STACK - next((i for i, byte in enumerate(stack) if byte), STACK))
        return {s: bytes(core.mem_read(self.symbols[s], size)) for s, size in outputs.items()}
