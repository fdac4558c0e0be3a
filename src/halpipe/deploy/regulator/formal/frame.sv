// What the block around the units must do: windows of the length stated, and everything to every unit in the same cycle.
`default_nettype none
module formal_frame (
  input wire clk, input wire rst_n, input wire reg_write, input wire [25:0] reg_addr, input wire [31:0] reg_wdata,
  input wire [1:0] s_arvalid, input wire [1:0] m_arready, input wire [1:0] s_awvalid, input wire [1:0] m_awready,
  input wire [1:0] s_wvalid, input wire [1:0] m_wready, input wire [1:0] s_wlast, input wire [15:0] arlen,
  input wire [5:0] arsize, input wire [15:0] awlen, input wire [5:0] awsize
);
  wire [31:0] reg_rdata; wire tick;
  wire [1:0] s_arready, m_arvalid, s_awready, m_awvalid, s_wready, m_wvalid;
  halpipe_regulator #(.UNITS(2), .DEPTH(2), .TABLES(2), .CYCLES(32'd9)) dut (
    .clk(clk), .rst_n(rst_n), .reg_write(reg_write), .reg_addr(reg_addr), .reg_wdata(reg_wdata), .reg_rdata(reg_rdata),
    .tick(tick), .s_arvalid(s_arvalid), .s_arready(s_arready), .m_arvalid(m_arvalid), .m_arready(m_arready),
    .s_awvalid(s_awvalid), .s_awready(s_awready), .m_awvalid(m_awvalid), .m_awready(m_awready), .s_wvalid(s_wvalid),
    .s_wready(s_wready), .m_wvalid(m_wvalid), .m_wready(m_wready), .s_wlast(s_wlast), .arlen(arlen), .arsize(arsize),
    .awlen(awlen), .awsize(awsize));
  // ports of the units, as they are connected: unit 1 in the upper halves
  (* keep *) wire [1:0] u_tick, u_go, u_req_valid, u_write, u_arvalid, u_arready, u_awvalid, u_awready, u_wvalid, u_wready, u_wlast;
  (* keep *) wire [1:0] u_m_arvalid, u_m_arready, u_m_awvalid, u_m_awready, u_m_wvalid, u_m_wready;
  (* keep *) wire [15:0] u_req_table, u_arlen, u_awlen; (* keep *) wire [5:0] u_arsize, u_awsize;
  (* keep *) wire [39:0] u_addr; (* keep *) wire [63:0] u_wdata, u_rdata; (* keep *) wire [31:0] counter, length, number; (* keep *) wire go;
  reg first = 1;
  always @(posedge clk) first <= 0;
  always @* assume (rst_n == !first);

  wire here = reg_addr[25:20] == 0;
  reg m_go = 0; reg [31:0] m_cycles = 9, m_left = 8, m_window = 0;
  always @(posedge clk)
    if (!rst_n) begin m_go <= 0; m_cycles <= 9; m_left <= 8; m_window <= 0; end
    else begin
      if (reg_write & here & reg_addr[19:0] == 20'h008) m_go <= reg_wdata[0];
      if (reg_write & here & reg_addr[19:0] == 20'h018) m_cycles <= reg_wdata < 4 ? 4 : reg_wdata;
      m_left <= m_left == 0 ? m_cycles - 1 : m_left - 1;
      if (m_left == 0) m_window <= m_window + 1;
    end
  wire asks = reg_write & here & reg_addr[19:0] == 20'h01c;
  always @* if (!first) begin
    least:    assert (m_cycles >= 4);
    counts:   assert (counter == m_left & length == m_cycles & number == m_window & go == m_go);
    windows:  assert (tick == (m_left == 0) & u_tick == {2{tick}});
    together: assert (u_go == {2{m_go}} & u_req_valid == {2{asks}} & (!asks | u_req_table == {2{reg_wdata[7:0]}}));
    chosen:   assert (u_write == {reg_write & reg_addr[25:20] == 2, reg_write & reg_addr[25:20] == 1});
    passed:   assert (u_addr == {2{reg_addr[19:0]}} & u_wdata == {2{reg_wdata}});
    if (reg_addr[25:20] == 1) first_unit: assert (reg_rdata == u_rdata[31:0]);
    if (reg_addr[25:20] == 2) second_unit: assert (reg_rdata == u_rdata[63:32]);
    if (here) case (reg_addr[19:0])
      20'h000: id:     assert (reg_rdata == 32'h48425746);
      20'h004: params: assert (reg_rdata == {8'd1, 16'd0, 8'd2});
      20'h008: ctrl:   assert (reg_rdata == {31'd0, m_go});
      20'h010: window: assert (reg_rdata == m_window);
      20'h018: cycles: assert (reg_rdata == m_cycles);
      default: ;
    endcase
    ports_in:  assert ({u_arvalid, u_awvalid, u_wvalid, u_wlast, u_m_arready, u_m_awready, u_m_wready}
                       == {s_arvalid, s_awvalid, s_wvalid, s_wlast, m_arready, m_awready, m_wready});
    ports_out: assert ({u_arready, u_awready, u_wready, u_m_arvalid, u_m_awvalid, u_m_wvalid}
                       == {s_arready, s_awready, s_wready, m_arvalid, m_awvalid, m_wvalid});
    lengths:   assert ({u_arlen, u_arsize, u_awlen, u_awsize} == {arlen, arsize, awlen, awsize});
  end
endmodule
`default_nettype wire
