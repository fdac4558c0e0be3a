// Eight managers with bursts of every length, size and kind behind AXI4, and a memory that serves one beat in a cycle in the
// order of the addresses: what waits for data stalls all behind it. Manager 0 reads whole bursts and always asks; the others
// draw lengths of 1 to 256 beats, sizes of 1 to 8 bytes, FIXED, INCR and WRAP, four IDs, and withhold data and READY.
// Each counts what it was answered: bursts above 128 B by SLVERR and never by the memory, all others by what the memory has.
`timescale 1ns/1ns
module beats_manager #(parameter integer M = 0, parameter integer DIR = 0, parameter integer EVEN = 0)(
  input wire clk, input wire rst_n, input wire [31:0] seed, input wire stop,
  output reg avalid, input wire aready, output wire [39:0] addr, output wire [7:0] len, output wire [2:0] size, output wire [1:0] burst, output wire [3:0] id,
  output wire wvalid, input wire wready, output wire [63:0] wdata, output wire wlast,
  input wire valid, output wire ready, input wire [3:0] rid, input wire [1:0] resp, input wire [63:0] data, input wire last
);
  function [31:0] h(input [31:0] n); reg [31:0] v; begin   // what is drawn for burst or cycle n
    v = n * 32'h9e3779b9 ^ seed * 32'h85ebca6b ^ (2 * M + DIR + 1) * 32'hc2b2ae35;
    v = (v ^ (v >> 15)) * 32'h2c1b3c6d; v = (v ^ (v >> 12)) * 32'h297a2d39; h = v ^ (v >> 15);
  end endfunction
  function [7:0] len_of(input [31:0] n); reg [31:0] v; begin
    v = h(n);
    len_of = EVEN ? 8'd15 : v[1:0] == 0 ? {4'd0, v[11:8]} : v[1:0] == 1 ? v[15:8] : v[1:0] == 2 ? {4'd0, v[11:8]} : (8'd2 << v[9:8]) - 8'd1;
  end endfunction
  function [3:0] id_of(input [31:0] n); reg [31:0] v; begin v = h(n); id_of = {2'd0, v[5:4]}; end endfunction
  wire [31:0] now_h = h(n_addr);
  reg [31:0] n_addr, n_data, cycle; reg [7:0] beat; reg [15:0] pause; wire [31:0] luck = h(cycle + 32'h40000000);
  assign addr = {8'd0, n_addr}; assign len = len_of(n_addr); assign id = id_of(n_addr);
  assign size = EVEN ? 3'd3 : now_h[3:2]; assign burst = EVEN ? 2'd1 : now_h[1:0] == 2 ? 2'd0 : now_h[1:0] == 3 ? 2'd2 : 2'd1;
  // data, up to a burst ahead of its address
  reg has; assign wvalid = has; assign wdata = {8'd1, n_data[23:0], M[15:0], 8'd0, beat}; assign wlast = (beat == len_of(n_data));
  assign ready = EVEN | luck[8];

  integer next [0:3]; integer got [0:3]; integer wrong, refused, done, k;
  reg [7:0] due; reg is_long;
  always @(posedge clk)
    if (!rst_n) begin
      avalid <= 0; n_addr <= 0; n_data <= 0; cycle <= 0; beat <= 0; pause <= 0; has <= 0; wrong = 0; refused = 0; done = 0;
      for (k = 0; k < 4; k = k + 1) begin next[k] = -1; got[k] = -1; end
    end else begin
      cycle <= cycle + 1;
      if (avalid & aready) begin avalid <= 0; n_addr <= n_addr + 1; end
      if (!(avalid & ~aready) & !stop & (EVEN | luck[1:0] == 0)) avalid <= 1;
      if (pause != 0) pause <= pause - 1; else if (luck[17:10] == 0 & !EVEN) pause <= 300;   // withheld
      if (has & wready) begin beat <= wlast ? 8'd0 : beat + 8'd1; if (wlast) n_data <= n_data + 1; end
      if (!has | wready) has <= (DIR == 1) & (pause == 0) & luck[9] & ((has & wlast) ? n_data < n_addr : stop ? n_data < n_addr | (avalid & n_data == n_addr) : n_data <= n_addr);
      if (valid & ready) begin
        if (next[rid[1:0]] < 0) begin                         // the oldest burst of this ID that was not answered
          k = got[rid[1:0]] + 1; while (id_of(k) != rid) k = k + 1;
          next[rid[1:0]] = k; got[rid[1:0]] = k; beats[rid[1:0]] = 0;
        end
        k = next[rid[1:0]]; due = len_of(k); is_long = (due > 15);
        if (k > n_addr | (k == n_addr & !(avalid & aready))) wrong = wrong + 1;   // before its address
        if (resp != (is_long ? 2'd2 : 2'd0)) wrong = wrong + 1;
        if (DIR == 0 & last != (beats[rid[1:0]] == due)) wrong = wrong + 1;
        if (DIR == 0 & data != (is_long ? 64'd0 : {8'd2, k[23:0], M[15:0], 8'd0, beats[rid[1:0]]})) wrong = wrong + 1;
        beats[rid[1:0]] = beats[rid[1:0]] + 1;
        if (DIR == 1 | last) begin next[rid[1:0]] = -1; done = done + 1; refused = refused + is_long; end
      end
    end
  reg [7:0] beats [0:3];
endmodule

module beats_bench #(parameter integer BUFFER = 16, parameter integer STAGE = 0, parameter integer WINDOWS = 6);
  localparam integer N = 8, Q = 4096, LONGEST = 128;
  reg clk = 0, rst_n = 0, stop = 0, measured = 0; always #1 clk = ~clk;
  reg [31:0] seed; initial if (!$value$plusargs("seed=%d", seed)) seed = 1;
  reg lwvalid = 0; reg [25:0] laddr = 0; reg [31:0] lwdata = 0; wire lwready, tick;
  wire [N-1:0] awvalid, awready, wvalid, wready, wlast, bvalid, bready, arvalid, arready, rvalid, rready, rlast;
  wire [N-1:0] m_awvalid, m_wvalid, m_wlast, m_bready, m_arvalid, m_rready; reg [N-1:0] m_awready, m_arready, m_wready, m_bvalid, m_rvalid, m_rlast;
  wire [4*N-1:0] awid, arid, bid, rid, m_awid, m_arid; reg [4*N-1:0] m_bid, m_rid; wire [40*N-1:0] awaddr, araddr, m_awaddr, m_araddr;
  wire [8*N-1:0] awlen, arlen, m_awlen, m_arlen, m_wstrb; wire [3*N-1:0] awsize, arsize, m_awsize, m_arsize; wire [2*N-1:0] awburst, arburst, m_awburst, m_arburst, bresp, rresp;
  wire [64*N-1:0] wdata, rdata, m_wdata; reg [64*N-1:0] m_rdata;
  halpipe_regulator_axi4 #(.UNITS(N), .DEPTH(4), .TABLES(2), .CYCLES(1000), .BUFFER(BUFFER), .STAGE(STAGE)) dut (
    .clk(clk), .rst_n(rst_n), .now(64'd0), .tick(tick), .link_valid_i(1'b0), .link_valid_o(), .link_table_i(8'd0), .link_table_o(), .link_barred_i(1'b0), .link_barred_o(),
    .l_awvalid(lwvalid), .l_awready(lwready), .l_awaddr(laddr), .l_wvalid(lwvalid), .l_wready(), .l_wdata(lwdata), .l_wstrb(4'hf),
    .l_bvalid(), .l_bready(1'b1), .l_bresp(), .l_arvalid(1'b0), .l_arready(), .l_araddr(26'd0), .l_rvalid(), .l_rready(1'b1), .l_rdata(), .l_rresp(),
    .s_awvalid(awvalid), .s_awready(awready), .s_awid(awid), .s_awaddr(awaddr), .s_awlen(awlen), .s_awsize(awsize), .s_awburst(awburst),
    .s_awlock({N{1'b0}}), .s_awcache({4*N{1'b0}}), .s_awprot({3*N{1'b0}}), .s_awqos({4*N{1'b0}}), .m_awlock(), .m_awcache(), .m_awprot(), .m_awqos(),
    .m_awvalid(m_awvalid), .m_awready(m_awready), .m_awid(m_awid), .m_awaddr(m_awaddr), .m_awlen(m_awlen), .m_awsize(m_awsize), .m_awburst(m_awburst),
    .s_wvalid(wvalid), .s_wready(wready), .s_wdata(wdata), .s_wstrb({8*N{1'b1}}), .s_wlast(wlast),
    .m_wvalid(m_wvalid), .m_wready(m_wready), .m_wdata(m_wdata), .m_wstrb(m_wstrb), .m_wlast(m_wlast),
    .s_bvalid(bvalid), .s_bready(bready), .s_bid(bid), .s_bresp(bresp), .m_bvalid(m_bvalid), .m_bready(m_bready), .m_bid(m_bid), .m_bresp({2*N{1'b0}}),
    .s_arvalid(arvalid), .s_arready(arready), .s_arid(arid), .s_araddr(araddr), .s_arlen(arlen), .s_arsize(arsize), .s_arburst(arburst),
    .s_arlock({N{1'b0}}), .s_arcache({4*N{1'b0}}), .s_arprot({3*N{1'b0}}), .s_arqos({4*N{1'b0}}), .m_arlock(), .m_arcache(), .m_arprot(), .m_arqos(),
    .m_arvalid(m_arvalid), .m_arready(m_arready), .m_arid(m_arid), .m_araddr(m_araddr), .m_arlen(m_arlen), .m_arsize(m_arsize), .m_arburst(m_arburst),
    .s_rvalid(rvalid), .s_rready(rready), .s_rid(rid), .s_rdata(rdata), .s_rresp(rresp), .s_rlast(rlast),
    .m_rvalid(m_rvalid), .m_rready(m_rready), .m_rid(m_rid), .m_rdata(m_rdata), .m_rresp({2*N{1'b0}}), .m_rlast(m_rlast));

  integer reads, writes, refused_reads, refused_writes, wrong, unanswered, taken_long = 0, memory_wrong = 0;
  genvar i;
  generate for (i = 0; i < N; i = i + 1) begin : manager
    beats_manager #(.M(i), .DIR(0), .EVEN(i == 0)) reader (.clk(clk), .rst_n(rst_n), .seed(seed), .stop(stop), .avalid(arvalid[i]), .aready(arready[i]), .addr(araddr[40*i +: 40]),
      .len(arlen[8*i +: 8]), .size(arsize[3*i +: 3]), .burst(arburst[2*i +: 2]), .id(arid[4*i +: 4]), .wvalid(), .wready(1'b0), .wdata(), .wlast(),
      .valid(rvalid[i]), .ready(rready[i]), .rid(rid[4*i +: 4]), .resp(rresp[2*i +: 2]), .data(rdata[64*i +: 64]), .last(rlast[i]));
    beats_manager #(.M(i), .DIR(1)) writer (.clk(clk), .rst_n(rst_n & (i != 0)), .seed(seed), .stop(stop), .avalid(awvalid[i]), .aready(awready[i]), .addr(awaddr[40*i +: 40]),
      .len(awlen[8*i +: 8]), .size(awsize[3*i +: 3]), .burst(awburst[2*i +: 2]), .id(awid[4*i +: 4]), .wvalid(wvalid[i]), .wready(wready[i]), .wdata(wdata[64*i +: 64]), .wlast(wlast[i]),
      .valid(bvalid[i]), .ready(bready[i]), .rid(bid[4*i +: 4]), .resp(bresp[2*i +: 2]), .data(64'd0), .last(1'b1));
  end endgenerate

  // ---- the memory: addresses in the order in which they came; answers of a manager in two lanes, by the lowest bit of the ID
  reg [71:0] order [0:Q-1]; integer head = 0, tail = 0; reg [7:0] beat = 0;   // {write, manager, id, number, length}
  reg [52:0] lane [0:2*N*Q-1]; integer first [0:2*N-1], end_ [0:2*N-1]; reg [3:0] b_ids [0:N*Q-1]; integer b_first [0:N-1], b_end [0:N-1];
  reg [N-1:0] in_burst, upper; integer m, l; reg [71:0] one; reg serves; reg [31:0] noise = 1;
  integer served = 0, stalls = 0; integer taken = 0, least = 1 << 30, windows = 0, promise = 0, lag = 0;
  initial for (m = 0; m < 2 * N; m = m + 1) begin first[m] = 0; end_[m] = 0; b_first[m % N] = 0; b_end[m % N] = 0; end
  always @(negedge clk) if (!rst_n) begin
    m_awready = 0; m_arready = 0; m_wready = 0; m_bvalid = 0; m_rvalid = 0; m_rlast = 0; m_bid = 0; m_rid = 0; m_rdata = 0; in_burst = 0; upper = 0;
  end else begin   // what is shown until the next falling edge
    noise = noise * 32'd1664525 + 32'd1013904223 + seed;
    m_arready = {N{1'b1}} & ~(noise[15:8] & noise[23:16] & noise[31:24]); m_awready = ~(noise[31:24] & noise[14:7]); m_arready[0] = 1;
    one = order[head % Q]; m_wready = 0;
    if (head != tail & one[71]) m_wready[one[66:64]] = 1;
    for (m = 0; m < N; m = m + 1) begin
      m_bvalid[m] = (b_first[m] != b_end[m]); m_bid[4*m +: 4] = b_ids[m * Q + b_first[m] % Q];
      if (!in_burst[m] & !m_rvalid[m]) upper[m] = (first[2*m] == end_[2*m]) | (noise[m] & first[2*m+1] != end_[2*m+1]);
      l = 2 * m + upper[m]; m_rvalid[m] = (first[l] != end_[l]);
      {m_rid[4*m +: 4], m_rlast[m], m_rdata[64*m +: 64]} = {lane[l * Q + first[l] % Q][52:49], lane[l * Q + first[l] % Q][48], 8'd2, lane[l * Q + first[l] % Q][31:8], m[15:0], 8'd0, lane[l * Q + first[l] % Q][7:0]};
    end
  end
  always @(posedge clk) if (rst_n) begin
    for (m = 0; m < N; m = m + 1) begin
      l = 2 * m + upper[m];
      if (m_rvalid[m] & m_rready[m]) begin first[l] = first[l] + 1; in_burst[m] = ~m_rlast[m]; m_rvalid[m] <= 0; end
      if (m_bvalid[m] & m_bready[m]) b_first[m] = b_first[m] + 1;
    end
    if (head != tail) begin
      one = order[head % Q]; m = one[66:64]; serves = !one[71] | m_wvalid[m];
      if (one[71] & !m_wvalid[m]) stalls = stalls + 1;
      if (one[71] & m_wvalid[m] & (m_wdata[64*m +: 64] != {8'd1, one[31:8], m[15:0], 8'd0, beat} | m_wlast[m] != (beat == one[7:0]))) memory_wrong = memory_wrong + 1;
      if (serves & !one[71]) begin
        l = 2 * m + one[60]; lane[l * Q + end_[l] % Q] = {one[63:60], beat == one[7:0], 16'd0, one[31:8], beat}; end_[l] = end_[l] + 1; served = served + (m == 0);
      end
      if (serves) beat = beat + 1;
      if (serves & beat == one[7:0] + 8'd1) begin
        if (one[71]) begin b_ids[m * Q + b_end[m] % Q] = one[63:60]; b_end[m] = b_end[m] + 1; end
        beat = 0; head = head + 1;
      end
    end
    for (m = 0; m < N; m = m + 1) begin
      if (m_arvalid[m] & m_arready[m]) begin order[tail % Q] = {4'd0, 1'b0, m[2:0], m_arid[4*m +: 4], 28'd0, m_araddr[40*m +: 24], m_arlen[8*m +: 8]}; tail = tail + 1; taken_long = taken_long + (m_arlen[8*m +: 8] > 15); end
      if (m_awvalid[m] & m_awready[m]) begin order[tail % Q] = {4'd8, 1'b0, m[2:0], m_awid[4*m +: 4], 28'd0, m_awaddr[40*m +: 24], m_awlen[8*m +: 8]}; tail = tail + 1; taken_long = taken_long + (m_awlen[8*m +: 8] > 15); end
    end
    if (m_arvalid[0] & m_arready[0]) taken = taken + 128;
    if (tick) begin
      if (!measured & windows > 1) begin
        if (taken < least) least = taken;
        promise = promise + 7040; if (promise - 7040 - 8 * served > lag) lag = promise - 7040 - 8 * served;
      end else served = 0;
      windows = windows + 1; taken = 0;
    end
  end

  task write(input [25:0] a, input [31:0] d); begin
    @(negedge clk); laddr = a; lwdata = d; lwvalid = 1; #0; while (!lwready) @(negedge clk);
    @(negedge clk); lwvalid = 0; @(negedge clk);
  end endtask
  `define SUM(m) begin \
    reads = reads + manager[m].reader.done; refused_reads = refused_reads + manager[m].reader.refused; \
    writes = writes + manager[m].writer.done; refused_writes = refused_writes + manager[m].writer.refused; \
    wrong = wrong + manager[m].reader.wrong + manager[m].writer.wrong; \
    unanswered = unanswered + manager[m].reader.n_addr - manager[m].reader.done + manager[m].writer.n_addr - manager[m].writer.done; end
  task count; begin
    reads = 0; writes = 0; refused_reads = 0; refused_writes = 0; wrong = 0; unanswered = 0;
    `SUM(0) `SUM(1) `SUM(2) `SUM(3) `SUM(4) `SUM(5) `SUM(6) `SUM(7)
  end endtask

  integer n;
  initial begin
    #7 rst_n = 1;
    write(26'h0000028, LONGEST); write(26'h0100014, 7040); write(26'h0100018, 0);
    for (n = 1; n < N; n = n + 1) begin write((n + 1) << 20 | 26'h14, 128); write((n + 1) << 20 | 26'h18, 128); end
    while (windows < WINDOWS) @(negedge clk);
    measured = 1; write(26'h0100014, 128);   // then as much as the others may ask for
    for (n = 1; n < N; n = n + 1) begin write((n + 1) << 20 | 26'h14, 8000); write((n + 1) << 20 | 26'h18, 8000); end
    repeat (2500) @(negedge clk);
    stop = 1; count; for (n = 0; n < 400 & unanswered != 0; n = n + 1) begin repeat (100) @(negedge clk); count; end
    $display("refused: some reads %0d, some writes %0d, long ones at the memory %0d", refused_reads > 15, refused_writes > 10, taken_long);
    $display("passed: some reads %0d, some writes %0d", reads - refused_reads > 200, writes - refused_writes > 40);
    $display("wrong %0d and %0d, unanswered %0d", wrong, memory_wrong, unanswered);
    $display("victim: at most %0d B of 7040 B missed in a window, late by %0d B", 7040 - least, lag);
    $display("stalled %0d", stalls > 20);
    if ($test$plusargs("figures")) $display("reads %0d/%0d writes %0d/%0d stalls %0d", reads, refused_reads, writes, refused_writes, stalls);
    $finish;
  end
endmodule
