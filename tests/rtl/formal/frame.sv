// What the block around the units must do: windows of the length stated, and everything to every unit in the same cycle.
`default_nettype none
module formal_frame (
  input wire clk, input wire rst_n, input wire [63:0] now, input wire reg_port, input wire link_valid_i,
  input wire [7:0] link_table_i, input wire link_barred_i, input wire reg_write, input wire [25:0] reg_addr, input wire [31:0] reg_wdata,
  input wire [@units@-1:0] s_arvalid, input wire [@units@-1:0] m_arready, input wire [@units@-1:0] s_awvalid, input wire [@units@-1:0] m_awready,
  input wire [@units@-1:0] s_wvalid, input wire [@units@-1:0] m_wready, input wire [@units@-1:0] s_wlast, input wire [8*@units@-1:0] arlen,
  input wire [8*@units@-1:0] awlen
);
  wire [31:0] reg_rdata; wire tick, reg_refused, link_valid_o, link_barred_o; wire [7:0] link_table_o;
  wire [@units@-1:0] ar_long, aw_long, s_arready, m_arvalid, s_awready, m_awvalid, s_wready, m_wvalid;
  halpipe_regulator #(.UNITS(@units@), .DEPTH(2), .TABLES(2), .BANKS(2), .PORTS(2), .SIZE(5), .BUFFER(64), .CYCLES(32'd9)) dut (
    .clk(clk), .rst_n(rst_n), .now(now), .reg_port(reg_port), .reg_refused(reg_refused), .link_valid_i(link_valid_i), .link_valid_o(link_valid_o),
    .link_table_i(link_table_i), .link_table_o(link_table_o), .link_barred_i(link_barred_i), .link_barred_o(link_barred_o), .reg_write(reg_write), .reg_addr(reg_addr), .reg_wdata(reg_wdata), .reg_rdata(reg_rdata),
    .tick(tick), .s_arvalid(s_arvalid), .s_arready(s_arready), .m_arvalid(m_arvalid), .m_arready(m_arready),
    .s_awvalid(s_awvalid), .s_awready(s_awready), .m_awvalid(m_awvalid), .m_awready(m_awready), .s_wvalid(s_wvalid),
    .s_wready(s_wready), .m_wvalid(m_wvalid), .m_wready(m_wready), .s_wlast(s_wlast), .arlen(arlen),
    .ar_long(ar_long), .awlen(awlen), .aw_long(aw_long));
  // ports of the units, as they are connected: unit 0 lowest
  (* keep *) wire [@units@-1:0] u_tick, u_go, u_req_valid, u_write, u_arvalid, u_arready, u_awvalid, u_awready, u_wvalid, u_wready, u_wlast;
  (* keep *) wire [@units@-1:0] u_holds, u_foreign, u_refused, u_running, u_upper; (* keep *) wire locked, holder;
  (* keep *) wire [@units@-1:0] u_ar_long, u_aw_long, u_m_arvalid, u_m_arready, u_m_awvalid, u_m_awready, u_m_wvalid, u_m_wready;
  (* keep *) wire [8*@units@-1:0] u_req_table, u_arlen, u_awlen;
  (* keep *) wire [20*@units@-1:0] u_addr; (* keep *) wire [32*@units@-1:0] u_wdata, u_rdata; (* keep *) wire [31:0] counter, length, number, rest, extra, of; (* keep *) wire go, armed; (* keep *) wire [63:0] start; (* keep *) wire [16*@units@-1:0] u_longest;
  reg first = 1;
  always @(posedge clk) first <= 0;
  always @* assume (rst_n == !first);
  // a linked block sends a request only where none of the others bars it
  always @* if (link_valid_i) assume (!link_barred_o);

  wire here = reg_addr[25:20] == 0;
  // The lock: which port has it, and what the others may do meanwhile.
  reg m_locked = 0, m_holder = 0;
  wire mine = m_locked & m_holder == reg_port;
  wire locks = reg_write & here & reg_addr[19:0] == 20'h034 & (!m_locked | mine | (reg_port == 0 & reg_wdata[1:0] == 2));
  always @(posedge clk)
    if (!rst_n) begin m_locked <= 0; m_holder <= 0; end
    else if (locks) begin m_locked <= reg_wdata[0]; m_holder <= reg_wdata[0] & reg_port; end
  wire plays_own = u_running == {@units@{1'b1}} & u_upper == {@units@{reg_wdata[7:0] >= 1}};
  wire plays_link = u_running == {@units@{1'b1}} & u_upper == {@units@{link_table_i >= 1}};
  wire own = reg_write & here & reg_addr[19:0] == 20'h01c & !link_valid_i & !link_barred_i & reg_wdata[7:0] < 2 & (!m_locked | mine | plays_own);
  wire settable = reg_addr[19:0] == 20'h008 | reg_addr[19:0] == 20'h018 | reg_addr[19:0] == 20'h020 | reg_addr[19:0] == 20'h024
                  | reg_addr[19:0] == 20'h028 | reg_addr[19:0] == 20'h02c | reg_addr[19:0] == 20'h030;
  wire works = here ? (settable & mine) | locks | own : u_refused == 0 & reg_addr[25:20] <= @units@;
  reg m_go = 0, m_armed = 0; reg [63:0] m_start = 0;
  wire m_due = m_armed & !m_go & now >= m_start;
  reg [31:0] m_cycles = 9, m_left = 8, m_window = 0, m_extra = 0, m_of = 1, m_rest = 0; reg [15:0] m_longest = 16'hffff;
  wire [31:0] m_left_over = m_due ? 32'd0 : m_rest;
  wire m_ends = m_left == 0 | m_due;
  wire m_long = {1'b0, m_left_over} + m_extra >= {1'b0, m_of};
  always @(posedge clk)
    if (!rst_n) begin m_go <= 0; m_armed <= 0; m_start <= 0; m_cycles <= 9; m_left <= 8; m_window <= 0; m_extra <= 0; m_of <= 1; m_rest <= 0; m_longest <= 16'hffff; end
    else begin
      if (reg_write & mine & here & reg_addr[19:0] == 20'h008) {m_armed, m_go} <= reg_wdata[1:0];
      else if (m_due) begin m_armed <= 0; m_go <= 1; end
      if (reg_write & mine & here & reg_addr[19:0] == 20'h02c) m_start[31:0] <= reg_wdata;
      if (reg_write & mine & here & reg_addr[19:0] == 20'h030) m_start[63:32] <= reg_wdata;
      if (reg_write & mine & here & reg_addr[19:0] == 20'h018) m_cycles <= reg_wdata < 4 ? 4 : reg_wdata;
      if (reg_write & mine & here & reg_addr[19:0] == 20'h020) m_extra <= reg_wdata;
      if (reg_write & mine & here & reg_addr[19:0] == 20'h024) m_of <= reg_wdata == 0 ? 1 : reg_wdata;
      if (reg_write & mine & here & reg_addr[19:0] == 20'h028) m_longest <= reg_wdata[15:0];
      m_left <= m_ends ? (m_long ? m_cycles : m_cycles - 1) : m_left - 1;
      if (m_ends) m_rest <= m_long ? m_left_over + m_extra - m_of : m_left_over + m_extra;
      if (m_ends) m_window <= m_window + 1;
    end
  wire asks = own | link_valid_i;
  wire [@units@-1:0] writes, reads_wrong;
  genvar i;
  generate for (i = 0; i < @units@; i = i + 1) begin : each
    assign writes[i] = reg_write & reg_addr[25:20] == i + 1;
    assign reads_wrong[i] = reg_addr[25:20] == i + 1 & reg_rdata != u_rdata[32*i +: 32];
  end endgenerate
  always @* if (!first) begin
    least:    assert (m_cycles >= 4 & m_of >= 1);
    spread:   assert (rest == m_rest & extra == m_extra & of == m_of);
    counts:   assert (counter == m_left & length == m_cycles & number == m_window & go == m_go & armed == m_armed & start == m_start);
    windows:  assert (tick == m_ends & u_tick == {@units@{tick}});
    together: assert (u_go == {@units@{m_go | m_due}} & u_req_valid == {@units@{asks}} & (!asks | u_req_table == {@units@{link_valid_i ? link_table_i : reg_wdata[7:0]}}));
    locked_:  assert (locked == m_locked & holder == m_holder & u_holds == {@units@{mine}} & u_foreign == {@units@{m_locked & !mine}});
    refuses:  assert (reg_refused == (reg_write & !works));
    sends:    assert (link_valid_o == own & link_table_o == reg_wdata[7:0]);
    bars:     assert (link_barred_o == (link_table_i >= 2 | (m_locked & !plays_link)));
    inside:   assert (!asks | u_req_table[7:0] < 2);
    bursts:   assert (u_longest == {@units@{m_longest}});
    chosen:   assert (u_write == writes);
    passed:   assert (u_addr == {@units@{reg_addr[19:0]}} & u_wdata == {@units@{reg_wdata}});
    answers:  assert (reads_wrong == 0);
    if (here) case (reg_addr[19:0])
      20'h000: id:     assert (reg_rdata == 32'h48425746);
      20'h004: params: assert (reg_rdata == {8'd4, 4'd2, 4'd2, 8'd5, 8'd@units@});
      20'h034: lock:   assert (reg_rdata == {23'd0, m_holder, 6'd0, mine, m_locked});
      20'h008: ctrl:   assert (reg_rdata == {30'd0, m_armed, m_go});
      20'h010: window: assert (reg_rdata == m_window);
      20'h018: cycles: assert (reg_rdata == m_cycles);
      20'h020: more:   assert (reg_rdata == m_extra);
      20'h024: parts:  assert (reg_rdata == m_of);
      20'h02c: low:    assert (reg_rdata == m_start[31:0]);
      20'h030: high:   assert (reg_rdata == m_start[63:32]);
      20'h028: most:   assert (reg_rdata == {16'd0, m_longest});
      20'h038: holds:  assert (reg_rdata == 32'd64);
      default: ;
    endcase
    ports_in:  assert ({u_arvalid, u_awvalid, u_wvalid, u_wlast, u_m_arready, u_m_awready, u_m_wready}
                       == {s_arvalid, s_awvalid, s_wvalid, s_wlast, m_arready, m_awready, m_wready});
    ports_out: assert ({u_ar_long, u_aw_long, u_arready, u_awready, u_wready, u_m_arvalid, u_m_awvalid, u_m_wvalid}
                       == {ar_long, aw_long, s_arready, s_awready, s_wready, m_arvalid, m_awvalid, m_wvalid});
    lengths:   assert ({u_arlen, u_awlen} == {arlen, awlen});
  end
endmodule
// In place of a unit, which is proven on its own: whatever it answers.
module halpipe_regulator_unit #(parameter integer DEPTH = 2, parameter integer TABLES = 2, parameter integer BANKS = 1, parameter integer SIZE = 3, parameter integer BUFFER = 0, parameter TABFILE = "", parameter HDRFILE = "")(
  (* keep *) input wire clk, (* keep *) input wire rst_n, (* keep *) input wire tick, (* keep *) input wire all_go, (* keep *) input wire all_req_valid, (* keep *) input wire [7:0] all_req_table, (* keep *) input wire [15:0] longest, (* keep *) input wire holds, (* keep *) input wire foreign,
  (* keep *) output wire refused, (* keep *) output wire running, (* keep *) output wire plays_upper,
  (* keep *) input wire reg_write, (* keep *) input wire [19:0] reg_addr, (* keep *) input wire [31:0] reg_wdata, (* keep *) output wire [31:0] reg_rdata,
  (* keep *) input wire s_arvalid, (* keep *) output wire s_arready, (* keep *) output wire m_arvalid, (* keep *) input wire m_arready,
  (* keep *) input wire s_awvalid, (* keep *) output wire s_awready, (* keep *) output wire m_awvalid, (* keep *) input wire m_awready,
  (* keep *) input wire s_wvalid, (* keep *) output wire s_wready, (* keep *) output wire m_wvalid, (* keep *) input wire m_wready, (* keep *) input wire s_wlast,
  (* keep *) input wire [7:0] arlen, (* keep *) input wire [7:0] awlen, (* keep *) output wire ar_long, (* keep *) output wire aw_long
);
  (* anyseq *) wire [42:0] any;
  assign {ar_long, aw_long, refused, running, plays_upper, reg_rdata, s_arready, m_arvalid, s_awready, m_awvalid, s_wready, m_wvalid} = any;
endmodule
`default_nettype wire
