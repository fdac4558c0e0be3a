// Bursts longer than LONGEST in front of a unit with a budget for both: they never pass, and STATUS shows which kind it was.
module long_bench;
  reg clk = 0, rst_n = 0, arvalid = 0, awvalid = 0, reg_write = 0;
  reg [7:0] arlen = 7, awlen = 7; reg [25:0] addr = 0; reg [31:0] wdata = 0;
  wire arshown, awshown; wire [31:0] rdata;
  always #1 clk = ~clk;
  halpipe_regulator #(.UNITS(1), .CYCLES(16)) regulator (
    .clk(clk), .rst_n(rst_n), .now(64'd0), .reg_port(1'b0), .reg_refused(), .link_valid_i(1'b0), .link_valid_o(), .link_table_i(8'd0), .link_table_o(), .link_barred_i(1'b0), .link_barred_o(), .reg_write(reg_write), .reg_addr(addr), .reg_wdata(wdata), .reg_rdata(rdata), .tick(),
    .s_arvalid(arvalid), .s_arready(), .m_arvalid(arshown), .m_arready(1'b1), .s_awvalid(awvalid), .s_awready(),
    .m_awvalid(awshown), .m_awready(1'b1), .s_wvalid(1'b0), .s_wready(), .m_wvalid(), .m_wready(1'b1), .s_wlast(1'b0),
    .arlen(arlen), .awlen(awlen));

  integer reads = 0, writes = 0;
  always @(posedge clk) begin reads <= reads + arshown; writes <= writes + awshown; end

  task write(input [25:0] a, input [31:0] d); begin
    @(negedge clk); addr = a; wdata = d; reg_write = 1; @(negedge clk); reg_write = 0;
  end endtask
  task status; begin
    @(negedge clk); addr = 26'h010000c; #0.1 $display("%0d reads, %0d writes, status %h", reads, writes, rdata);
  end endtask

  initial begin
    #7 rst_n = 1;
    write(26'h0100014, 256); write(26'h0100018, 256); write(26'h0000028, 64);
    repeat (20) @(negedge clk);
    arvalid = 1; arlen = 7; @(negedge clk); arvalid = 0; status;       // as long as may be
    arvalid = 1; arlen = 8; repeat (64) @(negedge clk); status;        // a beat more, for four windows
    arvalid = 0; write(26'h010000c, 0); status;
    awvalid = 1; awlen = 8; repeat (64) @(negedge clk); status;
    awvalid = 0; @(negedge clk); awvalid = 1; awlen = 7; @(negedge clk); awvalid = 0; status;
    $finish;
  end
endmodule
