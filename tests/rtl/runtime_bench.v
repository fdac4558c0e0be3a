// Two regulators, driven by what a runtime wrote to their registers: lines of cycle, address and value in writes.txt. The time
// base counts a tick in so many cycles. Prints the cycle at which the first unit plays another table, or a table anew.
module runtime_bench;
  parameter integer TICK = 4;
  reg clk = 0, rst_n = 0, reg_write = 0; reg [25:0] addr = 0; reg [31:0] wdata = 0; reg [63:0] now = 0;
  always #1 clk = ~clk;
  wire [31:0] seen;
  halpipe_regulator #(.UNITS(2), .DEPTH(64), .TABLES(16), .CYCLES(50)) dut (
    .clk(clk), .rst_n(rst_n), .now(now), .reg_port(1'b0), .reg_refused(), .link_valid_i(1'b0), .link_valid_o(), .link_table_i(8'd0), .link_table_o(), .link_barred_i(1'b0), .link_barred_o(), .reg_write(reg_write), .reg_addr(addr), .reg_wdata(wdata), .reg_rdata(seen), .tick(),
    .s_arvalid(2'b0), .s_arready(), .m_arvalid(), .m_arready(2'b0), .s_awvalid(2'b0), .s_awready(), .m_awvalid(), .m_awready(2'b0),
    .s_wvalid(2'b0), .s_wready(), .m_wvalid(), .m_wready(2'b0), .s_wlast(2'b0), .arlen(16'd0), .awlen(16'd0));
  integer file, cycle, last, at, target, value, more; reg [31:0] held;
  initial begin
    file = $fopen("writes.txt", "r"); more = $fscanf(file, "%d %h %h", at, target, value);
    if (!$value$plusargs("first=%d", cycle)) cycle = 0;
    if (!$value$plusargs("last=%d", last)) last = 0;
    held = 32'hffffffff;
    #4 rst_n = 1;
    while (cycle < last) begin
      @(negedge clk); now = cycle / TICK;
      reg_write = (more == 3) & (at <= cycle);
      addr = reg_write ? target : 26'h0100010; wdata = value;
      if (reg_write) more = $fscanf(file, "%d %h %h", at, target, value);
      #0.1 if (!reg_write & seen != held) begin
        if (seen == 0) begin addr = 26'h010000c; #0.1 $display("%0d %0d", seen[7:0], cycle); end
        held = (addr == 26'h0100010) ? seen : 32'd0;
      end
      cycle = cycle + 1;
    end
    $finish;
  end
endmodule
