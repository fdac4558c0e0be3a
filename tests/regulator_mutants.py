"""Faults put into the Verilog of a regulator bundle, one at a time, and who finds them: the simulation or the proof."""

import tempfile

import regulator_bundles as bundles
from halpipe.core.diagnostics import HalpipeError
from halpipe.deploy.regulator.reading import read_tables
from halpipe.deploy.regulator.simulate import design_of, judge, play
from halpipe.deploy.regulator.stimuli import STEPPED, TRAFFIC, plan
from one_fault import with_fault
from regulator_proof import ProofError, prove

PARTS = {
    part: "" if part == "frame" else f"_{part}"
    for part in ("gate", "player", "unit", "frame", "axil", "ports", "store", "refusal", "axi4")
}
"""Parts, as the proof calls them, and their files."""

MUTANTS = {
    # ------------------------------------------------------------------------------------------------ gate
    "credit is never spent": ("gate", "left <= left - cost;", "left <= left;"),
    "credit is kept": ("gate", "? budget - kept : 32'd0", "? left + budget - kept : 32'd0"),
    "a burst may overdraw": ("gate", "(left >= cost)", "(left != 32'd0)"),
    "a burst that fits exactly waits": ("gate", "(left >= cost)", "(left > cost)"),
    "what was shown is withdrawn": ("gate", "= shown | covered;", "= covered;"),
    "what was shown is free": ("gate", "(budget > kept) ? budget - kept : 32'd0", "budget"),
    "what was shown may cost more than there is": ("gate", "(budget > kept) ? budget - kept : 32'd0", "budget - kept"),
    "ready is given away": ("gate", "ready_o = ready_i & passes", "ready_o = ready_i"),
    "valid is given away": ("gate", "valid_o = valid_i & passes", "valid_o = valid_i"),
    "what is shown is forgotten": ("gate", "shown <= keep;", "shown <= 1'b0;"),
    "what is shown is shown for ever": ("gate", "shown <= keep;", "shown <= keep | shown;"),
    "a burst that waits is charged in each cycle": ("gate", "valid_i & ~shown & covered", "valid_i & covered"),
    "room is ignored": ("gate", "room & (left >= cost)", "(left >= cost)"),
    "a window begins when nothing is admitted": ("gate", "if (refill)     left", "if (refill & ~admit) left"),
    "reset leaves credit": ("gate", "left  <= 32'd0;", "left  <= 32'd4096;"),
    # ------------------------------------------------------------------------------------------------ player
    "directions are swapped": ("player", "entry[63:32] : rd_now", "entry[31:0] : rd_now"),
    "writes go on with the budget of reads": ("player", "entry[31:0]  : wr_now", "entry[31:0]  : rd_now"),
    "an entry comes a window late": ("player", "window_now + 32'd1);", "window_now);"),
    "entries begin at 0": ("player", "? header[55:32] :", "? 24'd0 :"),
    "entries do not advance": ("player", "entry_now + 24'd1;", "entry_now;"),
    "another table is the first": ("player", "running ? successor : 8'd0", "running ? successor : 8'd1"),
    "a table ends early": ("player", "32'd1 == windows)", "32'd2 == windows)"),
    "a table has the length of the one before": ("player", "windows <= entry_windows;", ""),
    "a table follows itself": ("player", "successor <= entry_successor;", "successor <= entry_table;"),
    "requests are forgotten": ("player", "pending <= 1'b1; pending_table", "pending_table"),
    "requests are for table 0": ("player", "pending_table <= req_table;", "pending_table <= 8'd0;"),
    "the first request counts": ("player", "else if (req_valid) begin", "else if (req_valid & ~pending) begin"),
    "late requests are lost": ("player", "& ~requested_late", ""),
    "late requests survive another": ("player", "entry_requested) pending", "1'b0) pending"),
    "requests are followed for ever": ("player", "requested) pending <= 1'b0;", "requested) ;"),
    "a table never written plays": ("player", "(entry_windows == 32'd0)", "1'b0"),
    "defaults are ignored": ("player", "!plays ? def_rd", "!plays ? 32'd0"),
    "no window lies before the first table": ("player", "go & ~running & ~calm;", "1'b0;"),
    "windows without budgets never end": ("player", "go & ~running & ~calm;", "go & ~running;"),
    "the window before the first table has defaults": ("player", "calms ? 32'd0 : !plays ? def_wr", "!plays ? def_wr"),
    "tables are not stopped": ("player", "plays = go & ~calms", "plays = (go | running) & ~calms"),
    # ------------------------------------------------------------------------------------------------ unit
    "a register is not what it should": ("unit", "32'h48425754", "32'h48425755"),
    "data goes ahead": ("unit", "(owed != 8'd0)", "1'b1"),
    "too many writes are owed": ("unit", ".room((owed != 8'hff) & ~aw_never)", ".room(~aw_never)"),
    "one beat of data settles a write": ("unit", "m_wvalid & m_wready & s_wlast", "m_wvalid & m_wready"),
    "writes are owed for ever": ("unit", " - {7'd0, last_passes}", ""),
    "data is taken before it passes": ("unit", "s_wready = m_wready & data_passes", "s_wready = m_wready"),
    "requests out of range count": ("unit", "& ({24'd0, reg_wdata[7:0]} < TABLES) &", "&"),
    "requests to all are ignored": ("unit", "req_valid = all_req_valid | req_here", "req_valid = req_here"),
    "GO of all is ignored": ("unit", "go_here | all_go", "go_here"),
    "GO of a unit is ignored": ("unit", "go_here | all_go", "all_go"),
    "tables open while they play": ("unit", "holds & (~go | spare);", "holds;"),
    "tables never open": ("unit", "holds & (~go | spare);", "1'b0;"),
    "the bank that is requested stays open": ("unit", " & ~(pending & (upper == asks_upper))", ""),
    "the bank that is played is open": ("unit", "(upper != plays_upper)", "1'b1"),
    "the bank that comes next is open": ("unit", " & (upper != next_upper)", ""),
    "tables are written without the lock": ("unit", "reg_write & holds & (~go", "reg_write & (~go"),
    "what changes nothing is not refused": ("unit", "reg_write & ~(sets |", "reg_write & ~(1'b1 |"),
    "headers beyond the last are written": ("unit", "({16'd0, index} < TABLES)", "1'b1"),
    "entries beyond the last are written": ("unit", "({16'd0, index} < DEPTH)", "1'b1"),
    "entries are one further": ("unit", "- 16'h0100 :", "- 16'h0101 :"),
    "entries are written with directions swapped": ("unit", "held_rd, held_wr} :", "held_wr, held_rd} :"),
    "defaults are swapped": ("unit", ".def_rd(def_rd), .def_wr(def_wr)", ".def_rd(def_wr), .def_wr(def_rd)"),
    "the default of writes is kept": ("unit", "11'h018)) def_wr", "11'h014)) def_wr"),
    "beats of reads have a byte": ("unit", "({8'd0, arlen} + 16'd1) << SIZE", "({8'd0, arlen} + 16'd1) << 0"),
    "bursts of writes are a beat shorter": ("unit", "({8'd0, awlen} + 16'd1)", "({8'd0, awlen})"),
    "status bits are swapped": ("unit", "pending, running, table_now", "running, pending, table_now"),
    "reads of any length pass": ("unit", ".room(~ar_never)", ".room(1'b1)"),
    "writes of any length pass": ("unit", " & ~aw_never)", ")"),
    "what is held back is not counted": ("unit", "s_arvalid & ~m_arvalid", "s_arvalid & m_arvalid"),
    "bytes are counted before they pass": ("unit", "if (m_awvalid & m_awready) wr", "if (m_awvalid) wr"),
    "long bursts are not shown": ("unit", "| ar_long", ""),
    "long bursts are shown for ever": ("unit", "(long_wr & ~clears)", "long_wr"),
    # ------------------------------------------------------------------------------------------------ frame
    "go is ignored": ("frame", "go <= 1'b0;", "go <= 1'b1;"),
    "windows are a cycle longer": ("frame", "cycles - {31'd0, ~stretch} :", "cycles :"),
    "the first window is a cycle shorter": ("frame", "(cycle == 32'd0)", "(cycle == 32'd1)"),
    "windows may be too short": ("frame", "(reg_wdata < 32'd4) ? 32'd4 : reg_wdata", "reg_wdata"),
    "windows have no further cycle": ("frame", "{31'd0, ~stretch}", "32'd1"),
    "what is left of a cycle is lost": ("frame", "stretch ? over :", "stretch ? 32'd0 :"),
    "windows are counted twice": ("frame", "window <= window + 32'd1", "window <= window + 32'd2"),
    "one unit hears of requests": ("frame", ".all_req_valid(req_valid)", ".all_req_valid(req_valid & (i == 0))"),
    "one unit hears of GO": ("frame", ".all_go(go | due)", ".all_go((go | due) & (i == 0))"),
    "registers are those of the next unit": ("frame", "(reg_addr[25:20] == i + 1)", "(reg_addr[25:20] == i + 2)"),
    "the last unit cannot be read": ("frame", "<= UNITS[5:0])", "< UNITS[5:0])"),
    "tables start a cycle late": ("frame", "(now >= start)", "(now > start)"),
    "START counts again": ("frame", "{armed, go} <= 2'b01", "go <= 1'b1"),
    "the phase of windows is kept": ("frame", "due ? 32'd0 : rest", "rest"),
    "one unit hears of the longest burst": ("frame", ".longest(longest)", ".longest((i == 0) ? longest : 16'hffff)"),
    "units have another beat than the bus": ("frame", ".SIZE(SIZE),", ".SIZE(SIZE + 1),"),
    # ------------------------------------------------------------------------------------------------ axil
    "parts of words are written": ("axil", "reg_write = writes & (s_wstrb == 4'hf);", "reg_write = writes;"),
    "parts of words are said to be written": ("axil", "((s_wstrb == 4'hf) & ~reg_refused) ? 2'b00 : 2'b10", "2'b00"),
    "reads are where writes were": ("axil", "may_write ? s_awaddr : s_araddr", "s_awaddr"),
    "answers are lost": ("axil", "s_bvalid <= 1'b1;", "s_bvalid <= s_bready;"),
    "what was read is old": ("axil", "s_rdata <= reg_rdata;", "s_rdata <= s_rdata;"),
    "reads and writes come together": ("axil", "s_arvalid & ~may_write &", "s_arvalid &"),
    "answers are not waited for": ("axil", "s_wvalid & (~s_bvalid | s_bready)", "s_wvalid"),
    # ------------------------------------------------------------------------------------------------ around them
    "the lock is taken from its holder": ("frame", "& (~locked | mine | ((reg_wdata", "& (1'b1 | ((reg_wdata"),
    "a block that is locked hears requests": ("frame", "| (locked & ~(&running & link_same))", ""),
    "a request reaches some blocks": ("frame", " & ~link_barred_i", ""),
    "one port goes first for ever": ("ports", "turn <= ~turn", "turn <= 1'b1"),
    "a full buffer shows an address": ("store", "(huge | (whole > 0))", "(huge | full | (whole > 0))"),
    "a beat is pushed into a full buffer": ("store", "s_wvalid & ~full", "s_wvalid"),
    "a refusal overtakes an answer": ("refusal", "ar_long & (reads == 10'd0)", "ar_long"),
    "a refusal of a write overtakes an answer": ("refusal", "aw_long & (writes == 10'd0)", "aw_long"),
    "a refused read has a beat more": ("refusal", "fails & (beats != 8'd0)", "fails"),
    "the data of a refused write passes": ("refusal", "m_wvalid = s_wvalid & ~drops", "m_wvalid = s_wvalid"),
    "a write is refused before its data": ("refusal", "drops & s_wvalid & s_wlast", "drops & s_wvalid"),
    "a refusal has the ID of another": ("refusal", "rid <= s_arid;", ""),
    "bursts pass a refusal": ("refusal", "~fails & ~&reads", "~&reads"),
    "a beat of an answer counts as all": ("refusal", "m_rready & m_rlast", "m_rready"),
    "a burst that is shown is refused": ("unit", "s_arvalid & ar_never & ~m_arvalid", "s_arvalid & ar_never"),
    "a refusal drops the data of another": ("unit", "aw_seen & (owed == 8'd0)", "aw_seen"),
    "a write longer than its buffer passes": ("unit", "(longest < HELD) ? longest : HELD", "longest"),
    "reads pass without their unit": ("axi4", "m_arvalid(m_arvalid)", "m_arvalid()"),
}  # fmt: skip

UNSEEN = {
    "the bank that comes next is open",
    "tables are written without the lock",
    "what changes nothing is not refused",
    "the lock is taken from its holder",
    "a block that is locked hears requests",
    "a request reaches some blocks",
    "one port goes first for ever",
    "a full buffer shows an address",
    "a beat is pushed into a full buffer",
    "a refusal overtakes an answer",
    "a refusal of a write overtakes an answer",
    "a refused read has a beat more",
    "the data of a refused write passes",
    "a write is refused before its data",
    "a refusal has the ID of another",
    "bursts pass a refusal",
    "a beat of an answer counts as all",
    "a burst that is shown is refused",
    "a refusal drops the data of another",
    "a write longer than its buffer passes",
    "reads pass without their unit",
    "what was shown may cost more than there is",
    "tables are not stopped",
    "data is taken before it passes",
    "GO of a unit is ignored",
    "status bits are swapped",
    "reads and writes come together",
    "answers are not waited for",
    "windows have no further cycle",
    "what is left of a cycle is lost",
    "reads of any length pass",
    "writes of any length pass",
    "long bursts are not shown",
    "long bursts are shown for ever",
    "one unit hears of the longest burst",
    "tables start a cycle late",
    "START counts again",
    "the phase of windows is kept",
    "what is held back is not counted",
    "the bank that is requested stays open",
    "the bank that is played is open",
    "bytes are counted before they pass",
}
"""Those that no run of the tests shows, so that the proof has to."""

RUNS = ((STEPPED, 1), *((traffic, 1) for traffic in TRAFFIC), *((TRAFFIC[0], seed) for seed in (2, 3, 33)))
"""What each mutant is played with, until one tells: as a check does by default, and further requests."""

WINDOWS = 320


def mutated(files, name):
    """The files of a bundle with the mutant `name` in them."""
    part, old, new = MUTANTS[name]
    file = f"table/rtl/halpipe_regulator{PARTS[part]}.v"
    return {**files, file: with_fault(files[file].decode(), old, new).encode()}


def simulated(files, engine):
    """Codes of the first run that finds something, none if no run does."""
    bundle = bundles.target(files).bundle
    tables = read_tables(bundle)
    with tempfile.TemporaryDirectory() as folder:
        player = engine.build(design_of(bundle, tables), folder)
        for traffic, seed in RUNS:
            run = plan(tables, traffic, seed, windows=WINDOWS)
            try:
                found = judge(tables, run, play(bundle, tables, player, run), bundle.at("table")).findings
            except HalpipeError as failure:
                return {d.code for d in failure.diagnostics}
            if found:
                return {finding.code for finding in found}
    return set()


def refuted(files, part):
    """The properties of a part that the solver refutes, or the reason why it has no such part."""
    bundle = bundles.target(files).bundle
    try:
        return [d for proof in prove(bundle, read_tables(bundle), part) for d in proof.findings]
    except ProofError as failure:  # a register that does nothing any more is gone
        return [str(failure)]
