// Two blocks of regulators, for two memories, with windows of unlike phase and one time base: armed for the same instant, they
// begin their first tables in the same cycle, a window after it. Clocks do not divide the windows of the second block.
module start_bench;
  reg clk = 0, rst_n = 0, late_rst_n = 0, reg_write = 0; reg [25:0] addr = 0; reg [31:0] wdata = 0; reg [63:0] now = 64'hffffff00;
  always #1 clk = ~clk;
  always @(posedge clk) now <= now + 1;
  wire [31:0] first, second;
  halpipe_regulator #(.UNITS(1), .DEPTH(4), .TABLES(2), .CYCLES(50)) one (
    .clk(clk), .rst_n(rst_n), .now(now), .reg_port(1'b0), .reg_refused(), .link_valid_i(1'b0), .link_valid_o(), .link_table_i(8'd0), .link_table_o(), .link_barred_i(1'b0), .link_barred_o(), .reg_write(reg_write), .reg_addr(addr), .reg_wdata(wdata), .reg_rdata(first), .tick(),
    .s_arvalid(1'b0), .s_arready(), .m_arvalid(), .m_arready(1'b0), .s_awvalid(1'b0), .s_awready(), .m_awvalid(), .m_awready(1'b0),
    .s_wvalid(1'b0), .s_wready(), .m_wvalid(), .m_wready(1'b0), .s_wlast(1'b0), .arlen(8'd0), .awlen(8'd0));
  halpipe_regulator #(.UNITS(1), .DEPTH(4), .TABLES(2), .CYCLES(50)) two (
    .clk(clk), .rst_n(late_rst_n), .now(now), .reg_port(1'b0), .reg_refused(), .link_valid_i(1'b0), .link_valid_o(), .link_table_i(8'd0), .link_table_o(), .link_barred_i(1'b0), .link_barred_o(), .reg_write(reg_write), .reg_addr(addr), .reg_wdata(wdata), .reg_rdata(second), .tick(),
    .s_arvalid(1'b0), .s_arready(), .m_arvalid(), .m_arready(1'b0), .s_awvalid(1'b0), .s_awready(), .m_awvalid(), .m_awready(1'b0),
    .s_wvalid(1'b0), .s_wready(), .m_wvalid(), .m_wready(1'b0), .s_wlast(1'b0), .arlen(8'd0), .awlen(8'd0));

  task write(input [25:0] a, input [31:0] d); begin
    @(negedge clk); addr = a; wdata = d; reg_write = 1; @(negedge clk); reg_write = 0;
  end endtask
  reg [31:0] before_one = 0, before_two = 0;
  always @(negedge clk) if (addr == 26'h0100010 & ~reg_write) begin
    #0.1 if (first != before_one & first != 32'hffffffff) $display("one: window %0d at %0d", first, now - 64'h100000100);
    if (second != before_two & second != 32'hffffffff) $display("two: window %0d at %0d", second, now - 64'h100000100);
    before_one = first; before_two = second;
  end
  initial begin
    #7 rst_n = 1; #26 late_rst_n = 1;
    write(26'h0100800, 3); write(26'h0100804, 0);
    write(26'h0101000, 64); write(26'h0101004, 64); write(26'h0101008, 0); write(26'h0101018, 32'hffffffff);
    write(26'h0000020, 1); write(26'h0000024, 2);                  // windows of 50 and 51 cycles in turn
    write(26'h000002c, 32'h00000100); write(26'h0000030, 1);       // START: beyond the lower half of the time base
    write(26'h0000008, 2); addr = 26'h0000008; #0.1 $display("armed %0d %0d", first, second);
    before_one = 32'hffffffff; before_two = 32'hffffffff;
    @(negedge clk); addr = 26'h0100010;
    while (now < 64'h1000001f0) @(negedge clk);
    $finish;
  end
endmodule
