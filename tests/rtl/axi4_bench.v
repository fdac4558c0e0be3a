// Two managers of a memory that serves one write after the other: manager 0 shows an address and withholds its data, manager 1
// writes all the time. Registers are set through AXI4-Lite, and reads pass with their IDs.
`timescale 1ns/1ns
module axi4_bench #(parameter integer BUFFER = 16, parameter integer STAGE = 0);
  reg clk = 0, rst_n = 0;
  always #1 clk = ~clk;
  reg lwvalid = 0, larvalid = 0; reg [25:0] laddr = 0; reg [31:0] lwdata = 0;
  wire lwready, lbvalid, lrvalid, larready; wire [31:0] lrdata;
  reg [1:0] awvalid = 0, wvalid = 0, arvalid = 0; reg [1:0] busy = 0; reg held = 1;
  wire [1:0] awready, wready, m_awvalid, m_awready, m_wvalid, m_wready, m_wlast, m_arvalid, s_bvalid, arready;
  wire [7:0] m_awid, m_arid; wire [79:0] m_awaddr; wire [15:0] m_awlen; wire [127:0] m_wdata; wire [15:0] m_wstrb;
  reg [7:0] beat0 = 0, beat1 = 0; reg [31:0] sent0 = 0, sent1 = 0, seen0 = 0, seen1 = 0;
  wire [1:0] wlast = {beat1 == 3, beat0 == 15};
  reg [63:0] now = 0;
  always @(posedge clk) now <= now + 1;

  halpipe_regulator_axi4 #(.UNITS(2), .DEPTH(4), .TABLES(2), .CYCLES(64), .BUFFER(BUFFER), .STAGE(STAGE)) dut (
    .clk(clk), .rst_n(rst_n), .now(now), .tick(), .link_valid_i(1'b0), .link_valid_o(), .link_table_i(8'd0), .link_table_o(), .link_barred_i(1'b0), .link_barred_o(),
    .l_awvalid(lwvalid), .l_awready(lwready), .l_awaddr(laddr), .l_wvalid(lwvalid), .l_wready(), .l_wdata(lwdata), .l_wstrb(4'hf),
    .l_bvalid(lbvalid), .l_bready(1'b1), .l_bresp(), .l_arvalid(larvalid), .l_arready(larready), .l_araddr(laddr),
    .l_rvalid(lrvalid), .l_rready(1'b1), .l_rdata(lrdata), .l_rresp(),
    .s_awvalid(awvalid), .s_awready(awready), .m_awvalid(m_awvalid), .m_awready(m_awready), .s_awid(8'h21), .m_awid(m_awid),
    .s_awaddr({40'h2000, 40'h1000}), .m_awaddr(m_awaddr), .s_awlen({8'd3, 8'd15}), .m_awlen(m_awlen), .s_awsize(6'o33), .m_awsize(),
    .s_awburst(4'b0101), .m_awburst(), .s_awlock(2'b0), .m_awlock(), .s_awcache(8'h22), .m_awcache(), .s_awprot(6'o22), .m_awprot(),
    .s_awqos(8'd0), .m_awqos(), .s_wvalid(wvalid), .s_wready(wready), .m_wvalid(m_wvalid), .m_wready(m_wready),
    .s_wdata({32'd1, sent1, 32'd0, sent0}), .m_wdata(m_wdata), .s_wstrb({8'hff, 8'h0f}), .m_wstrb(m_wstrb), .s_wlast(wlast), .m_wlast(m_wlast),
    .s_bvalid(s_bvalid), .s_bready(2'b11), .m_bvalid(m_wvalid & m_wready & m_wlast), .m_bready(), .s_bid(), .m_bid(8'h21), .s_bresp(), .m_bresp(4'd0),
    .s_arvalid(arvalid), .s_arready(arready), .m_arvalid(m_arvalid), .m_arready(2'b11), .s_arid(8'h54), .m_arid(m_arid),
    .s_araddr(80'd0), .m_araddr(), .s_arlen({8'd31, 8'd0}), .m_arlen(), .s_arsize(6'o33), .m_arsize(), .s_arburst(4'b0101), .m_arburst(),
    .s_arlock(2'b0), .m_arlock(), .s_arcache(8'h22), .m_arcache(), .s_arprot(6'o22), .m_arprot(), .s_arqos(8'd0), .m_arqos(),
    .s_rvalid(), .s_rready(2'b11), .m_rvalid(2'b0), .m_rready(), .s_rid(), .m_rid(8'd0), .s_rdata(), .m_rdata(128'd0), .s_rresp(), .m_rresp(4'd0),
    .s_rlast(), .m_rlast(2'b0));

  // the memory: one write at a time, manager 0 first
  assign m_awready = (busy != 0) ? 2'b00 : m_awvalid[0] ? 2'b01 : 2'b10;
  assign m_wready = busy;
  integer writes0 = 0, writes1 = 0, wrong = 0, reads0 = 0, reads1 = 0;
  always @(posedge clk) if (rst_n) begin
    if (m_awvalid & m_awready) busy <= m_awvalid & m_awready;
    if (m_wvalid & m_wready & m_wlast) busy <= 0;
    if (m_awvalid[0] & m_awready[0] & ({m_awid[3:0], m_awaddr[39:0], m_awlen[7:0]} != {4'h1, 40'h1000, 8'd15})) wrong = wrong + 1;
    if (m_awvalid[1] & m_awready[1] & ({m_awid[7:4], m_awaddr[79:40], m_awlen[15:8]} != {4'h2, 40'h2000, 8'd3})) wrong = wrong + 1;
    if (m_wvalid[0] & m_wready[0]) begin
      if ((m_wdata[63:0] != {32'd0, seen0}) | (m_wstrb[7:0] != 8'h0f)) wrong = wrong + 1;
      seen0 <= seen0 + 1; writes0 = writes0 + m_wlast[0];
    end
    if (m_wvalid[1] & m_wready[1]) begin
      if ((m_wdata[127:64] != {32'd1, seen1}) | (m_wstrb[15:8] != 8'hff)) wrong = wrong + 1;
      seen1 <= seen1 + 1; writes1 = writes1 + m_wlast[1];
    end
    reads0 = reads0 + (m_arvalid[0] & (m_arid[3:0] == 4'h4)); reads1 = reads1 + m_arvalid[1];
    // the managers
    if (awvalid[0] & awready[0]) awvalid[0] <= 0;
    if (wvalid[0] & wready[0]) begin sent0 <= sent0 + 1; beat0 <= wlast[0] ? 8'd0 : beat0 + 8'd1; if (wlast[0]) wvalid[0] <= 0; end
    if (wvalid[1] & wready[1]) begin sent1 <= sent1 + 1; beat1 <= wlast[1] ? 8'd0 : beat1 + 8'd1; end
  end

  task write(input [25:0] a, input [31:0] d); begin
    @(negedge clk); laddr = a; lwdata = d; lwvalid = 1; #0; while (!lwready) @(negedge clk);
    @(negedge clk); lwvalid = 0; @(negedge clk);
  end endtask
  task read(input [25:0] a); begin
    @(negedge clk); laddr = a; larvalid = 1; #0; while (!larready) @(negedge clk);
    @(negedge clk); larvalid = 0; while (!lrvalid) @(negedge clk);
  end endtask

  initial begin
    #7 rst_n = 1;
    write(26'h0100014, 512); write(26'h0100018, 512); write(26'h0200014, 512); write(26'h0200018, 512); write(26'h0000028, 128);
    repeat (64) @(negedge clk);
    arvalid = 2'b01; @(negedge clk); arvalid = 2'b10; repeat (130) @(negedge clk); arvalid = 2'b00;
    read(26'h020000c);
    $display("reads %0d, too long %0d, status %h", reads0, reads1, lrdata);
    awvalid[0] = 1; @(negedge clk); @(negedge clk);
    awvalid[1] = 1; wvalid[1] = 1;
    repeat (500) @(negedge clk);
    $display("withheld: %0d writes of the other", writes1);
    wvalid[0] = 1;
    repeat (200) @(negedge clk);
    $display("then: %0d of its own, %0d wrong", writes0, wrong);
    $finish;
  end
endmodule
