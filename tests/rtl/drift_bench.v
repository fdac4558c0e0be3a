// Cycles at which windows end, of a block set to where it stands after many: OF, EXTRA, CYCLES as loaded, what is left of a
// cycle, and the number of the window, which wraps.
module drift_bench;
  reg clk = 0, rst_n = 0, reg_write = 0; reg [25:0] addr = 0; reg [31:0] wdata = 0; wire tick; wire [31:0] rdata;
  always #1 clk = ~clk;
  reg [31:0] cycles, extra, of, rest, number, count;
  halpipe_regulator #(.UNITS(1), .DEPTH(4), .TABLES(2), .CYCLES(50)) dut (
    .clk(clk), .rst_n(rst_n), .now(64'd0), .reg_port(1'b0), .reg_refused(), .link_valid_i(1'b0), .link_valid_o(), .link_table_i(8'd0), .link_table_o(),
    .link_barred_i(1'b0), .link_barred_o(), .reg_write(reg_write), .reg_addr(addr), .reg_wdata(wdata), .reg_rdata(rdata), .tick(tick),
    .s_arvalid(1'b0), .s_arready(), .m_arvalid(), .m_arready(1'b1), .s_awvalid(1'b0), .s_awready(), .m_awvalid(), .m_awready(1'b1),
    .s_wvalid(1'b0), .s_wready(), .m_wvalid(), .m_wready(1'b1), .s_wlast(1'b0), .arlen(8'd0), .ar_long(), .awlen(8'd0), .aw_long());
  task write(input [25:0] a, input [31:0] d); begin
    @(negedge clk); addr = a; wdata = d; reg_write = 1; @(negedge clk); reg_write = 0;
  end endtask
  integer now, ends;
  initial begin
    if (!$value$plusargs("cycles=%d", cycles) | !$value$plusargs("extra=%d", extra) | !$value$plusargs("of=%d", of)
        | !$value$plusargs("rest=%d", rest) | !$value$plusargs("number=%d", number) | !$value$plusargs("count=%d", count)) $finish;
    #7 rst_n = 1;
    write(26'h18, cycles); write(26'h20, extra); write(26'h24, of);
    @(negedge clk); dut.rest = rest; dut.window = number; dut.cycle = 0; addr = 26'h10;   // the last cycle of a window
    now = -1; ends = 0;
    while (ends <= count) begin
      #0.1 if (tick) begin $display("%0d %0d", now + 1, rdata); ends = ends + 1; end
      now = now + 1; @(negedge clk);
    end
    $finish;
  end
endmodule
