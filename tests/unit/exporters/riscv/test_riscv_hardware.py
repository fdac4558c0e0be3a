"""Profiles from hardware descriptions, and the texts that lead from a profile to hardware."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from types import SimpleNamespace

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.riscv.codes import BAD_HARDWARE
from halpipe.exporters.riscv.profile import Region, read_profile
from halpipe.exporters.riscv.render import Renderer, margin

CORES = "".join(
    f"""
    L{n}: cpu@{n} {{
      clock-frequency = <0>;
      device_type = "cpu";
      i-cache-block-size = <64>;
      i-cache-sets = <{128 if n else 64}>;
      reg = <0x{n:x}>; /* hart {n}; not a region {"}"} */
      {f"sifive,dtim = <&D{n}>; sifive,itim = <&I{n}>;" if n else ""}
      INT{n}: interrupt-controller {{ #interrupt-cells = <1>; interrupt-controller; }};
    }};"""
    for n in range(5)
)
PADS = "".join(
    f"""
    D{n}: dtim@{0x1000000 + 0x40000 * n:x} {{
      compatible = "sifive,dtim0"; reg = <0x{0x1000000 + 0x40000 * n:x} 0x40000>; reg-names = "mem"; }};
    I{n}: itim@{0x1800000 + 0x20000 * n:x} {{
      compatible = "sifive,itim0"; reg = <0x{0x1800000 + 0x20000 * n:x} 0x20000>; }};"""
    for n in range(1, 5)
)
TREE = f"""/dts-v1/;
/ {{
  #address-cells = <1>;
  compatible = "freechips,rocketchip-unknown-dev";
  cpus {{ timebase-frequency = <1000000>; {CORES} }};
  M: memory@80000000 {{ device_type = "memory"; reg = <0x80000000 0x4000000>; }};
  soc {{ // buses
    clock {{ clock-frequency = <100000000>; compatible = "fixed-clock"; }};
    clint@2000000 {{ compatible = "riscv,clint0"; reg = <0x2000000 0x10000>; }};
    dma@3000000 {{ compatible = "sifive,fu540-c000-pdma"; reg = <0x3000000 0x8000>; }};
    serial@64000000 {{ compatible = "sifive,uart0"; reg = <0x64000000 0x1000>; }}; {PADS}
  }};
}};
"""
LITEX = {
    "constants": {"config_cpu_count": 4, "config_clock_frequency": 100_000_000},
    "csr_bases": {"uart": 0x12006000},
    "memories": {"main_ram": {"base": 0x80000000, "size": 256 << 20}, "clint": {"base": 0x2000000, "size": 65536}},
}


def read(folder, name, text):
    path = folder / name
    path.write_text(text)
    return read_profile(str(path))


def refusal(folder, name, text):
    with pytest.raises(HalpipeError) as failure:
        read(folder, name, text)
    (found,) = failure.value.diagnostics
    assert found.code == BAD_HARDWARE.id
    return found.message


def test_a_device_tree_has_the_memory_map_of_the_papers_platform(tmp_path):
    ours, theirs = read(tmp_path, "board.dts", TREE), read_profile("vcu118")
    for name in ("cores", "clock", "timebase", "main", "ispm", "dspm", "clint", "uart_kind", "uart"):
        assert getattr(ours, name) == getattr(theirs, name), name
    assert (ours.dma.kind, ours.dma.base, ours.name) == ("pdma", theirs.dma.base, "board")
    assert b"measure them with export riscv --calibrate" in ours.text


def test_regions_of_64_bits_and_a_system_without_an_engine(tmp_path):
    wide = TREE.replace("<0x80000000 0x4000000>", "<0x0 0x80000000 0x0 0x4000000>")
    wide = wide.replace("sifive,fu540-c000-pdma", "other,engine").replace("sifive,uart0", "ns16550a")
    found = read(tmp_path, "board.dts", wide)
    assert (found.main, found.dma.kind, found.uart_kind) == (Region(0x80000000, 64 << 20), "copy", "ns16550")
    assert (
        read(tmp_path, "board.dts", wide.replace('"ns16550a";', '"ns16550a"; reg-shift = <2>;')).uart_kind
        == "ns16550x4"
    )


@pytest.mark.parametrize(
    ("what", "instead", "said"),
    [
        ("sifive,dtim0", "sifive,other0", "4 ITIMs and 0 DTIMs"),
        ("riscv,clint0", "riscv,other", "no node with compatible clint"),
        ("0x10c0000 0x40000", "0x10c0000 0x20000", "differ in size or distance"),
        ("0x1100000 0x40000", "0x1140000 0x40000", "differ in size or distance"),  # the last is farther from the rest
        ("<0x80000000 0x4000000>", "<0x80000000>", "1 cells"),
        ("};\n};\n", "};};};};\n", "pop from empty list"),
    ],
)
def test_a_device_tree_that_makes_no_profile(tmp_path, what, instead, said):
    assert what in TREE
    assert said in refusal(tmp_path, "board.dts", TREE.replace(what, instead))


def test_a_litex_system_has_its_scratchpads_in_main_memory(tmp_path):
    found = read(tmp_path, "csr.json", json.dumps(LITEX))
    assert (found.cores, found.clock, found.timebase, found.uart_kind) == (3, 100_000_000, 1_000_000, "litex")
    assert (found.uart, found.clint, found.dma.kind) == (0x12006000, 0x2000000, "copy")
    pads = [pad.of(core) for pad in (found.ispm, found.dspm) for core in range(3)]
    assert all(found.main.end <= pad.base and pad.end <= 0x80000000 + (256 << 20) for pad in pads)


@pytest.mark.parametrize(
    ("key", "value", "said"), [("config_cpu_count", 1, "one core only"), ("config_clock_frequency", None, "int()")]
)
def test_a_litex_system_that_makes_no_profile(tmp_path, key, value, said):
    spoilt = LITEX | {"constants": LITEX["constants"] | {key: value}}
    assert said in refusal(tmp_path, "csr.json", json.dumps(spoilt))
    assert refusal(tmp_path, "csr.json", "[1")
    for size in ("2147e83648", "1.5", "NaN"):
        text = json.dumps(LITEX).replace('"config_cpu_count": 4', f'"config_cpu_count": {size}')
        assert "invalid literal for int()" in refusal(tmp_path, "csr.json", text)
    twice = json.dumps(LITEX).replace('"constants"', '"constants": {}, "constants"', 1)
    assert 'the key "constants" is repeated' in refusal(tmp_path, "csr.json", twice)


def test_scratchpads_of_a_litex_system_begin_32_mebibytes_behind_its_main_memory(tmp_path):
    """Data of all cores come first, then their code; the timer is LitexConfig's real-time clock, a hundredth."""
    found = read(tmp_path, "csr.json", json.dumps(LITEX))
    room, data, code = 32 << 20, 256 << 10, 120 << 10
    assert found.main == Region(0x80000000, room)
    assert [found.dspm.of(core) for core in range(3)] == [
        Region(0x80000000 + room + core * data, data) for core in range(3)
    ]
    begin = 0x80000000 + room + 3 * data
    assert [found.ispm.of(core) for core in range(3)] == [Region(begin + core * code, code) for core in range(3)]
    assert (found.timebase, found.dspm.has_reservations) == (found.clock // 100, True)


@pytest.mark.parametrize("cores", [1, 3])
def test_a_litex_system_has_room_for_the_scratchpads_of_all_cores(tmp_path, cores):
    least = (32 << 20) + cores * (376 << 10)
    constants = LITEX["constants"] | {"config_cpu_count": cores + 1}
    for size in (least, least - 1):
        memories = LITEX["memories"] | {"main_ram": {"base": 0x80000000, "size": size}}
        text = json.dumps(LITEX | {"constants": constants, "memories": memories})
        if size == least:
            assert read(tmp_path, "csr.json", text).cores == cores
        else:
            assert "less main memory than the scratchpads" in refusal(tmp_path, "csr.json", text)


def test_a_device_tree_of_one_application_core(tmp_path):
    """Of its caches, one way of the ITIM stays a cache: as many lines of 64 bytes as the largest has sets."""
    one = re.sub(r'compatible = "sifive,[di]tim0"(?=; reg = <0x(10[8c]|110|18[468]))', 'compatible = "other"', TREE)
    found = read(tmp_path, "board.dts", one)
    assert (found.cores, found.ispm.size, found.ispm.stride) == (1, 0x20000 - 128 * 64, 0x20000)
    assert (found.dspm.size, found.dspm.stride, found.dspm.has_reservations) == (0x40000, 0x40000, False)


def test_every_hart_but_the_first_has_both_scratchpads(tmp_path):
    fewer = TREE.replace('compatible = "sifive,itim0"; reg = <0x1880000', 'compatible = "other"; reg = <0x1880000')
    assert "5 harts, 3 ITIMs and 4 DTIMs" in refusal(tmp_path, "board.dts", fewer)
    assert "4 harts, 4 ITIMs and 4 DTIMs" in refusal(tmp_path, "board.dts", TREE.replace('"cpu"', '"other"', 1))


MEMORY = SimpleNamespace(base=0x80000000, control=0x801FF000, trace=0x83CFB000, faults=0x83FFB000)


def texts(name):
    return Renderer(read_profile(name)).board(MEMORY)


def test_the_tiles_of_a_rocket_system_are_those_of_the_profile():
    text = texts("vcu118")["board/Rocket.scala"]
    assert f"nSets = 4096, nWays = 1, scratch = Some(BigInt({0x1040000}L) + other * 0x40000)" in text
    assert f"nSets = 128, nWays = 16, itimAddr = Some(BigInt({0x1820000}L) + other * 0x20000)" in text
    assert "useUser = true" in text
    assert "WithNBigCores(5)" in text
    assert f"BigInt({0x64000000}L)" in text


def test_other_boards_have_no_tiles():
    assert set(texts("virt")) == {"board/openocd.cfg", "board/run.gdb", "board/boot.json"}
    assert json.loads(texts("virt")["board/boot.json"]) == {"bundle.bin": "0x80000000"}


@pytest.mark.parametrize(
    ("kibibytes", "sets", "ways"), [(64, 1024, 2), (96, 512, 4), (112, 256, 8), (120, 128, 16), (124, 64, 32)]
)
def test_the_itim_of_a_tile_is_all_of_a_cache_but_one_way(kibibytes, sets, ways):
    profile = read_profile("vcu118")
    profile = replace(profile, ispm=replace(profile.ispm, size=kibibytes * 1024))
    assert f"nSets = {sets}, nWays = {ways}, itimAddr" in Renderer(profile).board(MEMORY)["board/Rocket.scala"]


@pytest.mark.parametrize(
    ("memory", "changes"),
    [("dspm", {"has_reservations": True}), ("dspm", {"size": 192 * 1024}), ("ispm", {"size": 100 * 1024})],
)
def test_memories_that_no_rocket_tile_has_make_no_tiles(memory, changes):
    profile = read_profile("vcu118")
    changed = replace(profile, **{memory: replace(getattr(profile, memory), **changes)})
    assert "board/Rocket.scala" not in Renderer(changed).board(MEMORY)


@pytest.mark.parametrize(("timebase", "ticks"), [(1_000_000, 2), (1_500_000, 3), (1_500_001, 4), (1000, 1)])
def test_a_modelled_execution_ends_two_microseconds_early(timebase, ticks):
    assert margin(replace(read_profile("vcu118"), timebase=timebase)) == ticks


def test_debuggers_read_the_control_block_and_both_rings():
    text = texts("vcu118")["board/openocd.cfg"]
    assert "halpipe_words 0x801ff000 18" in text
    assert "halpipe_ring $file trace 0x83cfb000 65536 6" in text
    assert "dump binary memory memory.bin 0x80000000 0x84000000" in texts("vcu118")["board/run.gdb"]


NAMES = ("targets", "halt", "load_image", "mww", "reg", "resume", "sleep", "exec")
STUBS = (
    "\n".join(f'proc {name} {{args}} {{lappend ::done "{name} $args"}}' for name in NAMES)
    + """
proc target {args} {return {hart0 hart1}}
proc read_memory {address width count} {
    set found {}
    for {set i 0} {$i < $count} {incr i} {lappend found [format 0x%x [expr {$address + $i}]]}
    if {$count == 18} {set found [lreplace $found 13 14 0x10001 0x2]}
    return $found
}
"""
)


@pytest.mark.skipif(shutil.which("openocd") is None, reason="apt-get install openocd")
def test_openocd_runs_the_script(tmp_path):
    """Its interpreter does, with commands that need no board."""
    (tmp_path / "run.cfg").write_text(texts("vcu118")["board/openocd.cfg"])
    steps = ["noinit", STUBS, "source run.cfg", "halpipe 20", "echo [join $::done {; }]", "shutdown"]
    command = ["openocd", *(word for step in steps for word in ("-c", step))]
    said = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path).stderr
    resumed = "targets hart0; resume ; targets hart1; resume ; sleep 20; targets hart0; halt "
    assert f"{resumed}; exec halpipe deploy trace . memory.txt -o seen.csv" in said
    assert "reg pc 0x80000000; targets hart1; reg pc 0x80000000" in said
    control, *trace, first, second, end = (tmp_path / "memory.txt").read_text().splitlines()
    assert control.split()[:2] == ["control", "801ff000"]
    assert (len(trace), trace[0][:14], trace[-1][:14]) == (65536, "trace 83cfb006", "trace 83cfb000")  # one is lost
    assert (first.split()[1], second.split()[8], end) == ("83ffb000", "83ffb00f", "end")
