`timescale 1ps / 1fs
// Three blocks with clocks of their own and windows of 8 us each: 250 MHz, 249 997 498 Hz and 33.33 MHz. One time base of
// 100 MHz is their `now`, and all are armed for 5 us. Prints the picosecond at which each window of the first table begins.
module one_clock #(parameter integer NUMBER = 0, CYCLES = 2000, EXTRA = 0, OF = 1, parameter real HALF = 2000.0) (input wire [63:0] now);
  reg clk = 0, rst_n = 0, reg_write = 0; reg [25:0] addr = 0; reg [31:0] wdata = 0; wire [31:0] seen; reg [31:0] held;
  always #(HALF) clk = ~clk;
  halpipe_regulator #(.UNITS(1), .DEPTH(4), .TABLES(2), .CYCLES(50)) dut (
    .clk(clk), .rst_n(rst_n), .now(now), .reg_port(1'b0), .reg_refused(), .link_valid_i(1'b0), .link_valid_o(), .link_table_i(8'd0), .link_table_o(), .link_barred_i(1'b0), .link_barred_o(), .reg_write(reg_write), .reg_addr(addr), .reg_wdata(wdata), .reg_rdata(seen), .tick(),
    .s_arvalid(1'b0), .s_arready(), .m_arvalid(), .m_arready(1'b0), .s_awvalid(1'b0), .s_awready(), .m_awvalid(), .m_awready(1'b0),
    .s_wvalid(1'b0), .s_wready(), .m_wvalid(), .m_wready(1'b0), .s_wlast(1'b0), .arlen(8'd0), .awlen(8'd0));
  task write(input [25:0] a, input [31:0] d); begin @(negedge clk); addr = a; wdata = d; reg_write = 1; @(negedge clk); reg_write = 0; end endtask
  initial begin
    #(3 * HALF) rst_n = 1;
    write(26'h0100800, 12); write(26'h0100804, 32'h01000000); write(26'h0100808, 5); write(26'h010080c, 32'h01000000);
    write(26'h0101000, 64); write(26'h0101004, 64); write(26'h0101008, 0); write(26'h0101018, 32'hffffffff);
    write(26'h0000018, CYCLES); write(26'h0000020, EXTRA); write(26'h0000024, OF);
    write(26'h000002c, 500); write(26'h0000008, 2);
    held = 32'hffffffff; addr = 26'h0100010;
    forever begin
      @(posedge clk); #1 if (seen != held) $display("%0d %0d %0.0f", NUMBER, seen, $realtime);
      held = seen;
    end
  end
endmodule
module clocks_bench;
  reg [63:0] now = 0;
  always #10000 now = now + 1;
  one_clock one (now);
  one_clock #(1, 1999, 61249, 62500, 2000.020) two (now);
  one_clock #(2, 266, 16, 25, 15001.5) three (now);
  initial #160000000 $finish;
endmodule
