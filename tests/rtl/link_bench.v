// Two blocks for two memories, with windows in phase, and a request at the first: both begin the table in the same cycle. A
// request that the second cannot follow, because its tables are being written, reaches neither.
module link_bench;
  reg clk = 0, rst_n = 0, reg_write = 0; reg [25:0] addr = 0; reg [31:0] wdata = 0; reg [1:0] to = 3;
  always #1 clk = ~clk;
  wire [31:0] first, second; wire [1:0] refused; wire asks, barred; wire [7:0] asked;
  halpipe_regulator #(.UNITS(1), .DEPTH(8), .TABLES(4), .CYCLES(16)) one (
    .clk(clk), .rst_n(rst_n), .now(64'd0), .reg_port(1'b0), .reg_refused(refused[0]), .link_valid_i(1'b0), .link_valid_o(asks), .link_table_i(8'd0),
    .link_table_o(asked), .link_barred_i(barred), .link_barred_o(), .reg_write(reg_write & to[0]), .reg_addr(addr), .reg_wdata(wdata), .reg_rdata(first),
    .tick(tick), .s_arvalid(1'b0), .s_arready(), .m_arvalid(), .m_arready(1'b0), .s_awvalid(1'b0), .s_awready(), .m_awvalid(), .m_awready(1'b0),
    .s_wvalid(1'b0), .s_wready(), .m_wvalid(), .m_wready(1'b0), .s_wlast(1'b0), .arlen(8'd0), .awlen(8'd0));
  halpipe_regulator #(.UNITS(2), .DEPTH(8), .TABLES(4), .CYCLES(16)) two (
    .clk(clk), .rst_n(rst_n), .now(64'd0), .reg_port(1'b0), .reg_refused(refused[1]), .link_valid_i(asks), .link_valid_o(), .link_table_i(asked),
    .link_table_o(), .link_barred_i(1'b0), .link_barred_o(barred), .reg_write(reg_write & to[1]), .reg_addr(addr), .reg_wdata(wdata), .reg_rdata(second),
    .tick(), .s_arvalid(2'b0), .s_arready(), .m_arvalid(), .m_arready(2'b0), .s_awvalid(2'b0), .s_awready(), .m_awvalid(), .m_awready(2'b0),
    .s_wvalid(2'b0), .s_wready(), .m_wvalid(), .m_wready(2'b0), .s_wlast(2'b0), .arlen(16'd0), .awlen(16'd0));
  wire tick;
  task write(input [1:0] blocks, input [25:0] a, input [31:0] d); begin
    @(negedge clk); to = blocks; addr = a; wdata = d; reg_write = 1; @(negedge clk); reg_write = 0;
  end endtask
  task tables(input [25:0] base); begin                              // 0 and 1: two windows, followed by themselves
    write(3, base + 26'h800, 2); write(3, base + 26'h804, 0); write(3, base + 26'h808, 2); write(3, base + 26'h80c, {8'd1, 24'd1});
    write(3, base + 26'h1008, 0); write(3, base + 26'h1018, 0); write(3, base + 26'h1028, 32'hffffffff);
  end endtask
  task request(input [31:0] table_); begin
    @(negedge clk); to = 1; addr = 26'h1c; wdata = table_; reg_write = 1; #0.5 $display("request %0d, refused %0d", table_, refused[0]);
    @(negedge clk); reg_write = 0; repeat (70) @(negedge clk);
  end endtask
  wire [23:0] now = {one.unit[0].regulator.table_now, two.unit[0].regulator.table_now, two.unit[1].regulator.table_now};
  always @(now) if (rst_n) $display("tables %0d %0d %0d", now[23:16], now[15:8], now[7:0]);
  initial begin
    #7 rst_n = 1;
    tables(26'h0100000); tables(26'h0200000);
    write(2, 26'h34, 1);
    request(1);                                                      // the second block does not play yet, and is locked
    write(2, 26'h34, 0);
    write(3, 26'h8, 1); repeat (40) @(negedge clk);
    request(1); request(9); request(0);
    $finish;
  end
endmodule
