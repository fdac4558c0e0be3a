// A schedule is replaced while another is played: the upper bank is written with GO set, and requested. No window has the
// defaults or no budget in between; the bank that is played, or requested, cannot be written.
module bank_bench #(parameter integer BANKS = 2);
  reg clk = 0, rst_n = 0, reg_write = 0; reg [25:0] addr = 0; reg [31:0] wdata = 0; wire [31:0] rdata;
  always #1 clk = ~clk;
  halpipe_regulator #(.UNITS(1), .DEPTH(8), .TABLES(4), .BANKS(BANKS), .CYCLES(16)) dut (
    .clk(clk), .rst_n(rst_n), .now(64'd0), .reg_port(1'b0), .reg_refused(), .link_valid_i(1'b0), .link_valid_o(), .link_table_i(8'd0), .link_table_o(), .link_barred_i(1'b0), .link_barred_o(), .reg_write(reg_write), .reg_addr(addr), .reg_wdata(wdata), .reg_rdata(rdata), .tick(tick),
    .s_arvalid(1'b0), .s_arready(), .m_arvalid(), .m_arready(1'b0), .s_awvalid(1'b0), .s_awready(), .m_awvalid(), .m_awready(1'b0),
    .s_wvalid(1'b0), .s_wready(), .m_wvalid(), .m_wready(1'b0), .s_wlast(1'b0), .arlen(8'd0), .awlen(8'd0));
  wire tick; reg looks = 0; integer seen = 0; reg [31:0] left;
  task write(input [25:0] a, input [31:0] d); begin
    @(negedge clk); addr = a; wdata = d; reg_write = 1; @(negedge clk); reg_write = 0;
  end endtask
  task entry(input integer at, input [31:0] window, input [31:0] bytes); begin
    write(26'h0101000 + 16 * at, 32'd0); write(26'h0101004 + 16 * at, bytes); write(26'h0101008 + 16 * at, window);
  end endtask
  // the read budget of each window, in its first cycle
  reg first = 0;
  always @(posedge clk) first <= tick;
  always @(negedge clk) if (first & looks & ~reg_write) begin
    #0.1 addr = 26'h0100020; #0.1 left = rdata; if (seen < 12) $display("%0d", left); seen = seen + 1;
  end
  initial begin
    #7 rst_n = 1;
    write(26'h0100014, 999);
    write(26'h0100800, 2); write(26'h0100804, 0); entry(0, 0, 100); entry(1, 1, 200); entry(2, 32'hffffffff, 0);
    write(26'h0000008, 1);
    repeat (40) @(negedge clk);
    write(26'h0100810, 2); write(26'h0100814, {8'd2, 24'd4});       // table 2: two windows, followed by itself, from entry 4 on
    entry(4, 0, 300); entry(5, 1, 400); entry(6, 32'hffffffff, 0);
    entry(0, 0, 111);                                                // being played: stays as it is
    while (!(dut.unit[0].regulator.window_now == 0 & first)) @(negedge clk);
    looks = 1;
    repeat (20) @(negedge clk);
    write(26'h000001c, 2);
    entry(4, 0, 333);                                                // requested: stays as it is
    repeat (200) @(negedge clk);
    $finish;
  end
endmodule
