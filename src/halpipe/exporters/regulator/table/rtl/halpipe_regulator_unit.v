// The bandwidth regulator of one bus manager: its registers, its tables, and the gates in front of its address channels.
// It adds no cycle to a burst that passes. All units share `tick`, and the window is 4 cycles at least.
//
// A burst costs its beats times the bytes of a beat of the bus, whatever its AxSIZE: a memory of one beat in a cycle
// loses a whole beat to a narrow transfer, too. A burst that costs more than `longest`, or a write that the write buffer
// cannot hold, never passes: STATUS shows it, and `ar_long` or `aw_long` asks the module in front for a refusal.
//
// A write's data passes as soon as its address is shown to the memory: a memory may wait for data before it takes an
// address (AXI4 A3.3.1), and data without an admitted address must not reach it.
`default_nettype none
module halpipe_regulator_unit #(
  parameter integer   DEPTH   = 1024,
  parameter integer   TABLES  = 16,
  parameter integer   BANKS   = 1,       // 2: while a table of one half is played, those of the other may be written
  parameter integer   SIZE    = 3,       // log2 of the bytes of a beat of the bus, 0 to 7
  parameter integer   BUFFER  = 0,       // beats of the write buffer in front, 0: none
  parameter           TABFILE = "",
  parameter           HDRFILE = "",
  parameter [31:0]    DEF_RD  = 32'd0,   // default budgets in bytes per window, until software states others
  parameter [31:0]    DEF_WR  = 32'd0
)(
  input  wire        clk,
  input  wire        rst_n,
  input  wire        tick,               // last cycle of a window, for all units together
  input  wire        all_go,             // from the block that makes the windows: what concerns all units at once
  input  wire        all_req_valid,
  input  wire [7:0]  all_req_table,
  input  wire        holds,              // the port of this access may write tables and set-up,
  input  wire        foreign,            // or another port holds the lock, and may be writing tables
  input  wire [15:0] longest,            // bytes of the longest burst that may pass
  // registers, see regulator.rdl
  input  wire        reg_write,
  input  wire [19:0] reg_addr,
  input  wire [31:0] reg_wdata,
  output reg  [31:0] reg_rdata,          // of reg_addr, in the same cycle
  output wire        refused,            // the write of this cycle changes nothing
  output wire        running,            // a table is played,
  output wire        plays_upper,        // of the upper half
  // manager's side                         memory's side
  input  wire        s_arvalid,          output wire        m_arvalid,
  output wire        s_arready,          input  wire        m_arready,
  input  wire        s_awvalid,          output wire        m_awvalid,
  output wire        s_awready,          input  wire        m_awready,
  input  wire        s_wvalid,           output wire        m_wvalid,
  output wire        s_wready,           input  wire        m_wready,
  input  wire        s_wlast,
  // lengths of the bursts, on their way past the unit
  input  wire [7:0]  arlen,              output wire        ar_long,   // a burst is shown that never passes
  input  wire [7:0]  awlen,              output wire        aw_long
);
  // ---------------------------------------------------------------------------------------------- registers
  localparam [31:0] ID = 32'h48425754;
  wire [31:0] params = {8'd4, TABLES[7:0], DEPTH[15:0]};
  reg         go_here;
  reg  [31:0] def_rd, def_wr, held_wr, held_rd;
  wire        go = go_here | all_go;
  wire        pending;
  wire [7:0]  table_now, pending_table, entry_table;
  wire        in_tables  = (reg_addr >= 20'h01000);
  wire        in_headers = ~in_tables & reg_addr[11];
  wire        in_control = ~in_tables & ~reg_addr[11];
  wire        control_write = reg_write & in_control;
  wire [15:0] index = in_tables ? reg_addr[19:4] - 16'h0100 : {8'd0, reg_addr[10:3]};
  // Tables may be written while none is played; of two banks, halves of headers and of entries, also those of the bank that
  // has neither the table being played, nor the one requested, nor the one whose first entry was read already: a request
  // that is replaced in the last cycle of a table is followed all the same. A table and its successor are in one bank.
  wire        upper = ({16'd0, index} >= (in_tables ? DEPTH : TABLES) / 2);
  assign      plays_upper = ({24'd0, table_now} >= TABLES / 2);
  wire        asks_upper = ({24'd0, pending_table} >= TABLES / 2);
  wire        next_upper = ({24'd0, entry_table} >= TABLES / 2);
  wire        spare = (BANKS == 2) & running & (upper != plays_upper) & (upper != next_upper) & ~(pending & (upper == asks_upper));
  wire        open = reg_write & holds & (~go | spare);
  wire        known = in_tables ? ({16'd0, index} < DEPTH) : ({16'd0, index} < TABLES);
  wire        writes_entry = open & in_tables & known & (reg_addr[3:2] != 2'd3) & (reg_addr[1:0] == 2'd0);
  wire        commit = writes_entry & (reg_addr[3:0] == 4'h8);
  wire [1:0]  header_write = {2{open & in_headers & known}} & {reg_addr[2], ~reg_addr[2]};
  wire        clears    = control_write & (reg_addr[10:0] == 11'h00c);
  // While another port holds the lock, tables of the half that is played may be requested: those of the other are in work.
  wire        same_half = (BANKS != 2) | (({24'd0, reg_wdata[7:0]} >= TABLES / 2) == plays_upper);
  wire        req_here  = control_write & (reg_addr[10:0] == 11'h01c) & ~all_req_valid
                          & ({24'd0, reg_wdata[7:0]} < TABLES) & (~foreign | (running & same_half));
  wire [7:0]  req_table = all_req_valid ? all_req_table : reg_wdata[7:0];
  wire        req_valid = all_req_valid | req_here;
  wire        sets = control_write & holds
                     & ((reg_addr[10:0] == 11'h008) | (reg_addr[10:0] == 11'h014) | (reg_addr[10:0] == 11'h018));
  assign      refused = reg_write & ~(sets | clears | req_here | writes_entry | (header_write != 2'd0));

  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      go_here <= 1'b0; def_rd <= DEF_RD; def_wr <= DEF_WR; held_wr <= 0; held_rd <= 0;
    end else begin
      if (sets & (reg_addr[10:0] == 11'h008)) go_here <= reg_wdata[0];
      if (sets & (reg_addr[10:0] == 11'h014)) def_rd <= reg_wdata;
      if (sets & (reg_addr[10:0] == 11'h018)) def_wr <= reg_wdata;
      if (writes_entry & (reg_addr[3:0] == 4'h0)) held_wr <= reg_wdata;
      if (writes_entry & (reg_addr[3:0] == 4'h4)) held_rd <= reg_wdata;
    end

  reg  [31:0] rd_bytes, wr_bytes, rd_waits, wr_waits;
  reg         long_rd, long_wr;                      // a burst that never passes was shown
  wire [31:0] window_now, next_rd, next_wr, rd_left, wr_left;
  always @* begin
    reg_rdata = 32'd0;
    if (in_control) case (reg_addr[10:0])
      11'h000: reg_rdata = ID;
      11'h004: reg_rdata = params;
      11'h008: reg_rdata = {31'd0, go_here};
      11'h00c: reg_rdata = {8'd0, pending_table, 4'd0, long_wr, long_rd, pending, running, table_now};
      11'h010: reg_rdata = window_now;
      11'h014: reg_rdata = def_rd;
      11'h018: reg_rdata = def_wr;
      11'h020: reg_rdata = rd_left;
      11'h024: reg_rdata = wr_left;
      11'h028: reg_rdata = rd_bytes;
      11'h02c: reg_rdata = wr_bytes;
      11'h030: reg_rdata = rd_waits;
      11'h034: reg_rdata = wr_waits;
      default: reg_rdata = 32'd0;
    endcase
  end

  // ---------------------------------------------------------------------------------------------- tables
  halpipe_regulator_player #(.DEPTH(DEPTH), .TABLES(TABLES), .TABFILE(TABFILE), .HDRFILE(HDRFILE)) player (
    .clk(clk), .rst_n(rst_n), .tick(tick), .go(go), .def_rd(def_rd), .def_wr(def_wr),
    .req_valid(req_valid), .req_table(req_table),
    .entry_write({3{commit}}), .header_write(header_write), .write_index(index),
    .write_data(in_tables ? {reg_wdata, held_rd, held_wr} : {32'd0, reg_wdata, reg_wdata}),
    .running(running), .table_now(table_now), .window_now(window_now),
    .pending(pending), .pending_table(pending_table), .entry_table(entry_table), .next_rd(next_rd), .next_wr(next_wr));

  // ---------------------------------------------------------------------------------------------- gates
  reg  [7:0] owed;                                   // writes shown to the memory whose data has not passed wholly
  localparam [15:0] HELD = (BUFFER == 0 || BUFFER > 256) ? 16'hffff : {7'd0, BUFFER[8:0]} << SIZE;   // by a write buffer, as a whole
  wire [15:0] ar_bytes = ({8'd0, arlen} + 16'd1) << SIZE;
  wire [15:0] aw_bytes = ({8'd0, awlen} + 16'd1) << SIZE;
  wire ar_never = (ar_bytes > longest);
  wire aw_never = (aw_bytes > ((longest < HELD) ? longest : HELD));
  assign ar_long = s_arvalid & ar_never & ~m_arvalid;   // what was shown before `longest` fell passes
  wire aw_seen = s_awvalid & aw_never & ~m_awvalid;
  assign aw_long = aw_seen & (owed == 8'd0);            // its data is next
  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      long_rd <= 1'b0; long_wr <= 1'b0;
      rd_bytes <= 0; wr_bytes <= 0; rd_waits <= 0; wr_waits <= 0;
    end else begin
      if (m_arvalid & m_arready) rd_bytes <= rd_bytes + {16'd0, ar_bytes};
      if (m_awvalid & m_awready) wr_bytes <= wr_bytes + {16'd0, aw_bytes};
      if (s_arvalid & ~m_arvalid) rd_waits <= rd_waits + 32'd1;
      if (s_awvalid & ~m_awvalid) wr_waits <= wr_waits + 32'd1;
      long_rd <= (long_rd & ~clears) | ar_long;
      long_wr <= (long_wr & ~clears) | aw_seen;
    end
  wire aw_admit;
  // verilator lint_off UNUSEDSIGNAL
  wire ar_admit;                                     // reads have no data to hold back
  // verilator lint_on UNUSEDSIGNAL
  halpipe_regulator_gate read (
    .clk(clk), .rst_n(rst_n), .refill(tick), .budget(next_rd), .room(~ar_never),
    .valid_i(s_arvalid), .ready_o(s_arready), .bytes(ar_bytes), .valid_o(m_arvalid), .ready_i(m_arready),
    .admit(ar_admit), .left(rd_left));
  halpipe_regulator_gate write (
    .clk(clk), .rst_n(rst_n), .refill(tick), .budget(next_wr), .room((owed != 8'hff) & ~aw_never),
    .valid_i(s_awvalid), .ready_o(s_awready), .bytes(aw_bytes), .valid_o(m_awvalid), .ready_i(m_awready),
    .admit(aw_admit), .left(wr_left));

  wire data_passes = (owed != 8'd0);
  assign m_wvalid = s_wvalid & data_passes;
  assign s_wready = m_wready & data_passes;
  wire last_passes = m_wvalid & m_wready & s_wlast;
  always @(posedge clk or negedge rst_n)
    if (!rst_n) owed <= 8'd0;
    else        owed <= owed + {7'd0, aw_admit} - {7'd0, last_passes};
endmodule
`default_nettype wire
