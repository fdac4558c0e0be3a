// Regulators for all managers of a memory, with the block that makes their windows and gives them orders all at once.
//
// Register space: 1 MiB each. 0: the windows (below); 1 + i: unit i, see regulator.rdl.
//   0x000 ID           ro  0x48425746 ("HBWF")
//   0x004 PARAMS       ro  units[7:0], log2 of the bytes of a beat[15:8], banks[19:16], ports[23:20], version[31:24] = 4
//   0x008 CTRL         rw  bit 0 GO: all units play tables from the next window on; bit 1 ARM: while GO is 0, set it when `now` is START
//   0x010 WINDOW       ro  windows since reset
//   0x018 CYCLES       rw  cycles of a window, 4 at least; counts from the next window on
//   0x020 EXTRA        rw  of OF windows so many have one cycle more, spread evenly; below OF
//   0x024 OF           rw  at least 1; both count from the next window on
//   0x028 LONGEST      rw  bytes of the longest burst that passes; its unit's STATUS shows a longer one, and `long` asks for a refusal
//   0x02c START_LO     rw  see ARM: the window in force ends at START, one without budgets follows, then the first table;
//   0x030 START_HI     rw  windows are counted from there, whatever the phase before
//   0x034 LOCK         rw  bit 0: 1 takes it for the port that writes, 0 gives it back; bit 1, by port 0: takes it from another.
//                          Reads: bit 0 held, bit 1 held by the port that reads, bit 8 its holder
//   0x038 BUFFER       ro  beats of the write buffers, which a longer write does not pass; 0: none
//   0x03c NOW_LO       ro  `now`: read NOW_HI before and after it, and again where they differ
//   0x040 NOW_HI       ro
//   0x01c REQ_TABLE    wo  table[7:0]: the request of every unit, in the same cycle
// Modes are switched here and not unit by unit: a table that ended between two writes would leave the units in two modes.
// Blocks of several memories are switched in one cycle by one request: link_o of one block leads to link_i of all others, and
// their link_barred_o, joined by OR, comes back to it. A request that one of them cannot follow reaches none.
`default_nettype none
module halpipe_regulator #(
  parameter integer UNITS  = 4,          // 1 to 63
  parameter integer DEPTH  = 1024,
  parameter integer TABLES = 16,
  parameter integer BANKS  = 1,          // 2: a bank of tables may be written while the other is played
  parameter integer PORTS  = 1,          // 2: tables and set-up are written by the port that holds LOCK
  parameter integer SIZE   = 3,          // log2 of the bytes of a beat of the bus, 0 to 7
  parameter integer BUFFER = 0,          // beats of the write buffers in front of the units, 0: none
  parameter [31:0]  CYCLES = 32'd4096,   // of a window, until software states others
  parameter         IMAGES = ""          // folder of unitN.tab.memh and unitN.hdr.memh, with its slash
)(
  input  wire                clk,
  input  wire                rst_n,
  input  wire [63:0]         now,        // a time base, that of the cores; 0 where there is none
  input  wire                reg_port,   // the port that accesses registers
  input  wire                reg_write,
  input  wire [25:0]         reg_addr,
  input  wire [31:0]         reg_wdata,
  output wire [31:0]         reg_rdata,
  output wire                reg_refused,   // the write of this cycle changes nothing
  input  wire                link_valid_i,  output wire       link_valid_o,    // a request of all blocks
  input  wire [7:0]          link_table_i,  output wire [7:0] link_table_o,
  input  wire                link_barred_i, output wire       link_barred_o,   // link_table_i could not be followed
  output wire                tick,       // last cycle of a window
  input  wire [UNITS-1:0]    s_arvalid, output wire [UNITS-1:0] s_arready,
  output wire [UNITS-1:0]    m_arvalid, input  wire [UNITS-1:0] m_arready,
  input  wire [UNITS-1:0]    s_awvalid, output wire [UNITS-1:0] s_awready,
  output wire [UNITS-1:0]    m_awvalid, input  wire [UNITS-1:0] m_awready,
  input  wire [UNITS-1:0]    s_wvalid,  output wire [UNITS-1:0] s_wready,
  output wire [UNITS-1:0]    m_wvalid,  input  wire [UNITS-1:0] m_wready,
  input  wire [UNITS-1:0]    s_wlast,
  input  wire [8*UNITS-1:0]  arlen, output wire [UNITS-1:0] ar_long,   // a burst is shown that never passes
  input  wire [8*UNITS-1:0]  awlen, output wire [UNITS-1:0] aw_long
);
  wire        here = (reg_addr[25:20] == 6'd0);
  reg         go, armed;
  reg  [63:0] start;
  wire        due = armed & ~go & (now >= start);
  reg  [31:0] cycles, cycle, window, extra, of, rest;
  reg  [15:0] longest;
  // A clock that does not divide the windows: their ends are those of the exact ones, rounded down to cycles.
  wire [32:0] sum = {1'b0, due ? 32'd0 : rest} + {1'b0, extra};
  wire        stretch = (sum >= {1'b0, of});
  wire [31:0] over = sum[31:0] - of;   // below OF where it is used
  wire        control = reg_write & here;

  // Tables, windows and defaults are written by the port that holds the lock. Meanwhile the other port, and linked blocks,
  // request tables of the half that is played alone: those of the other half may be half written.
  reg         locked, holder;
  wire        mine = locked & (holder == reg_port);
  wire        holds = (PORTS == 1) | mine;
  wire        sets = control & holds & (reg_addr[19:0] != 20'h0001c) & (reg_addr[19:0] != 20'h00034);
  wire [UNITS-1:0] running, plays_upper, refused;
  wire        own_same = (BANKS != 2) | (plays_upper == {UNITS{{24'd0, reg_wdata[7:0]} >= TABLES / 2}});
  wire        link_same = (BANKS != 2) | (plays_upper == {UNITS{{24'd0, link_table_i} >= TABLES / 2}});
  assign      link_barred_o = ({24'd0, link_table_i} >= TABLES) | (locked & ~(&running & link_same));
  assign      link_table_o = reg_wdata[7:0];
  assign      link_valid_o = control & (reg_addr[19:0] == 20'h0001c) & ~link_valid_i & ~link_barred_i
                             & ({24'd0, reg_wdata[7:0]} < TABLES) & (~locked | mine | (&running & own_same));
  wire        req_valid = link_valid_i | link_valid_o;
  wire [7:0]  req_table = link_valid_i ? link_table_i : reg_wdata[7:0];
  wire        locks = control & (reg_addr[19:0] == 20'h00034)
                      & (~locked | mine | ((reg_wdata[1:0] == 2'd2) & (reg_port == 1'b0)));
  assign tick = (cycle == 32'd0) | due;
  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      go <= 1'b0; cycles <= CYCLES; cycle <= CYCLES - 32'd1; window <= 0; extra <= 0; of <= 32'd1; rest <= 0;
      longest <= 16'hffff; armed <= 1'b0; start <= 64'd0; locked <= 1'b0; holder <= 1'b0;
    end else begin
      if (locks) {holder, locked} <= {reg_port & reg_wdata[0], reg_wdata[0]};
      if (sets & (reg_addr[19:0] == 20'h00008)) {armed, go} <= reg_wdata[1:0];
      else if (due) {armed, go} <= 2'b01;
      if (sets & (reg_addr[19:0] == 20'h00018)) cycles <= (reg_wdata < 32'd4) ? 32'd4 : reg_wdata;
      if (sets & (reg_addr[19:0] == 20'h00020)) extra <= reg_wdata;
      if (sets & (reg_addr[19:0] == 20'h00024)) of <= (reg_wdata == 32'd0) ? 32'd1 : reg_wdata;
      if (sets & (reg_addr[19:0] == 20'h00028)) longest <= reg_wdata[15:0];
      if (sets & (reg_addr[19:0] == 20'h0002c)) start[31:0] <= reg_wdata;
      if (sets & (reg_addr[19:0] == 20'h00030)) start[63:32] <= reg_wdata;
      cycle <= tick ? cycles - {31'd0, ~stretch} : cycle - 32'd1;
      if (tick) rest <= stretch ? over : sum[31:0];
      if (tick) window <= window + 32'd1;
    end

  wire [31:0] data [0:63];
  reg  [31:0] word;
  reg         known;                     // a register that can be written
  always @* case (reg_addr[19:0])
    20'h00000: word = 32'h48425746;
    20'h00004: word = {8'd4, PORTS[3:0], BANKS[3:0], SIZE[7:0], UNITS[7:0]};
    20'h00008: word = {30'd0, armed, go};
    20'h00010: word = window;
    20'h00018: word = cycles;
    20'h00020: word = extra;
    20'h00024: word = of;
    20'h00028: word = {16'd0, longest};
    20'h0002c: word = start[31:0];
    20'h00030: word = start[63:32];
    20'h00034: word = {23'd0, holder, 6'd0, mine, locked};
    20'h00038: word = BUFFER;
    20'h0003c: word = now[31:0];
    20'h00040: word = now[63:32];
    default:   word = 32'd0;
  endcase
  assign data[0] = word;
  always @* case (reg_addr[19:0])
    20'h00008, 20'h00018, 20'h00020, 20'h00024, 20'h00028, 20'h0002c, 20'h00030: known = holds;
    20'h0001c: known = link_valid_o;
    20'h00034: known = locks;
    default:   known = 1'b0;
  endcase
  assign reg_refused = reg_write & (here ? ~known : (|refused) | (reg_addr[25:20] > UNITS[5:0]));
  wire [5:0] chosen = (reg_addr[25:20] <= UNITS[5:0]) ? reg_addr[25:20] : 6'd0;
  assign reg_rdata = data[chosen];

  genvar i;
  generate for (i = 0; i < UNITS; i = i + 1) begin : unit
    localparam [7:0] TENS = 8'h30 + i / 10;
    localparam [7:0] ONES = 8'h30 + i % 10;
    // verilator lint_off WIDTH
    halpipe_regulator_unit #(   // names of unlike length
      .DEPTH(DEPTH), .TABLES(TABLES), .BANKS(BANKS), .SIZE(SIZE), .BUFFER(BUFFER),
      .TABFILE((IMAGES == "") ? "" : (i < 10) ? {IMAGES, "unit", ONES, ".tab.memh"} : {IMAGES, "unit", TENS, ONES, ".tab.memh"}),
      .HDRFILE((IMAGES == "") ? "" : (i < 10) ? {IMAGES, "unit", ONES, ".hdr.memh"} : {IMAGES, "unit", TENS, ONES, ".hdr.memh"})
    // verilator lint_on WIDTH
    ) regulator (
      .clk(clk), .rst_n(rst_n), .tick(tick), .all_go(go | due), .all_req_valid(req_valid), .all_req_table(req_table),
      .holds(holds), .foreign(locked & ~mine), .longest(longest), .reg_write(reg_write & (reg_addr[25:20] == i + 1)), .reg_addr(reg_addr[19:0]), .reg_wdata(reg_wdata),
      .reg_rdata(data[i + 1]), .refused(refused[i]), .running(running[i]), .plays_upper(plays_upper[i]),
      .s_arvalid(s_arvalid[i]), .s_arready(s_arready[i]), .m_arvalid(m_arvalid[i]), .m_arready(m_arready[i]),
      .s_awvalid(s_awvalid[i]), .s_awready(s_awready[i]), .m_awvalid(m_awvalid[i]), .m_awready(m_awready[i]),
      .s_wvalid(s_wvalid[i]), .s_wready(s_wready[i]), .m_wvalid(m_wvalid[i]), .m_wready(m_wready[i]),
      .s_wlast(s_wlast[i]),
      .arlen(arlen[8*i +: 8]), .ar_long(ar_long[i]), .awlen(awlen[8*i +: 8]), .aw_long(aw_long[i]));
  end endgenerate
endmodule
`default_nettype wire
