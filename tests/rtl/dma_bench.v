// The DMA engine on a memory of 16 KiB, with a regulator of its one AXI4 port in between where REGULATED is 1.
//
//     +latency=L cycles from a read's address to its first beat; +stall=S of 16 cycles in which each handshake may wait
//     +broken=A answers bursts that begin in [A, A + 256) with SLVERR; +budget=B bytes a window of +window=W cycles
// Reads jobs.txt (w or r, cycle, address, value), does each through AXI4-Lite, and writes trace.txt: L and V (a register
// is written or read: address, value), R and W (the address of a burst passes: ID, address, beats), B (ID, answer), D (ID,
// control: RUN is read as 0; not with +poll=0), each with its cycle. Ends when all is done and no channel is known to run.
`default_nettype none
module dma_bench #(
  parameter integer CHANNELS = 4,
  parameter integer REGULATED = 0,
  parameter integer SIZE = 3, BURST = 6, DEPTH = 6
)();
  localparam integer ADDR = 16, BEAT = 1 << SIZE, WIDTH = 8 << SIZE;
  reg clk = 0, rst_n = 0;
  always #1 clk = ~clk;
  reg [31:0] now = 0, latency = 20, stall = 0, broken = 32'h7fff0000, budget = 0, window = 64, seed = 1, poll = 1;
  reg [7:0] memory [0:16383];
  integer jobs, trace, n, count, at, k;
  initial begin
    k = $value$plusargs("latency=%d", latency); k = $value$plusargs("stall=%d", stall); k = $value$plusargs("seed=%d", seed);
    k = $value$plusargs("broken=%d", broken); k = $value$plusargs("budget=%d", budget); k = $value$plusargs("window=%d", window); k = $value$plusargs("poll=%d", poll);
    $readmemh("before.memh", memory);
    jobs = $fopen("jobs.txt", "r"); trace = $fopen("trace.txt", "w");
  end

  // ---------------------------------------------------------------------------------------------- registers
  reg  l_awvalid = 0, l_wvalid = 0, l_arvalid = 0, asks = 0, more = 1, due = 0;
  reg  [15:0] l_awaddr = 0, l_araddr = 0; reg [63:0] l_wdata = 0;
  wire l_awready, l_wready, l_bvalid, l_arready, l_rvalid; wire [1:0] l_bresp, l_rresp; wire [63:0] l_rdata;
  reg  [31:0] when; reg [15:0] place; reg [63:0] value; reg [7:0] order = "w"; reg polls = 0; reg [CHANNELS-1:0] runs = 0, ran;
  always @(posedge clk) begin
    now <= now + 1;
    rst_n <= now > 2;
    if (!due & more) begin
      count = $fscanf(jobs, "%c %d %h %h\n", order, when, place, value);
      if (count == 4) due <= 1; else more <= 0;
    end
    if (l_awvalid & l_awready) begin
      {l_awvalid, l_wvalid, due} <= 3'd0;
      $fwrite(trace, "L %0d %0d %0d\n", l_awaddr, l_wdata, now);
      if ((l_awaddr[11:0] == 0) & (l_wdata[1:0] == 2'd3) & (poll != 0)) runs[l_awaddr[15:12]] <= 1;
    end else if (due & rst_n & (now >= when) & !l_awvalid & (order == "w")) begin
      {l_awvalid, l_wvalid, l_awaddr, l_wdata} <= {2'b11, place, value};
    end
    if (l_arvalid & l_arready) l_arvalid <= 0;
    if (l_rvalid) begin
      asks <= 0;
      if (!polls) begin
        due <= 0; order <= "w";
        $fwrite(trace, "V %0d %0d %0d\n", l_araddr, l_rdata, now);
      end else if (!l_rdata[1] & runs[l_araddr[15:12]]) begin
        runs[l_araddr[15:12]] <= 0;
        $fwrite(trace, "D %0d %0d %0d\n", l_araddr[15:12], l_rdata[31:0], now);
      end
    end
    if (!asks & due & rst_n & (now >= when) & (order == "r")) begin
      {asks, l_arvalid, polls, l_araddr} <= {3'b110, place};
    end else if (!asks & (runs != 0) & rst_n) begin
      asks <= 1; l_arvalid <= 1; polls <= 1;
      l_araddr[11:0] <= 0; l_araddr[15:12] <= (l_araddr[15:12] + 1) % CHANNELS;
    end
    if ((now > 20000) | (!more & !due & (runs == 0) & (now > 100))) begin
      $writememh("after.memh", memory);
      $fclose(trace); $finish;
    end
  end

  // ---------------------------------------------------------------------------------------------- engine and regulator
  wire arvalid, awvalid, rvalid, wvalid, wlast, bvalid, rready, bready, rlast, p_arvalid, p_awvalid, p_wvalid;
  wire [ADDR-1:0] araddr, awaddr; wire [7:0] arlen, awlen; wire [3:0] arid, awid, rid, bid; wire [2:0] arsize, awsize;
  wire [1:0] arburst, awburst, rresp, bresp; wire [WIDTH-1:0] rdata, wdata; wire [BEAT-1:0] wstrb;
  wire m_arready, m_awready, m_wready, arready, awready, wready;
  halpipe_dma #(.CHANNELS(CHANNELS), .ADDR(ADDR), .SIZE(SIZE), .BURST(BURST), .DEPTH(DEPTH)) dut (
    .clk(clk), .rst_n(rst_n), .l_awvalid(l_awvalid), .l_awready(l_awready), .l_awaddr(l_awaddr), .l_wvalid(l_wvalid),
    .l_wready(l_wready), .l_wdata(l_wdata), .l_wstrb(8'hff), .l_bvalid(l_bvalid), .l_bready(1'b1), .l_bresp(l_bresp),
    .l_arvalid(l_arvalid), .l_arready(l_arready), .l_araddr(l_araddr), .l_rvalid(l_rvalid), .l_rready(1'b1), .l_rdata(l_rdata),
    .l_rresp(l_rresp), .m_arvalid(arvalid), .m_arready(arready), .m_araddr(araddr), .m_arlen(arlen), .m_arid(arid),
    .m_arsize(arsize), .m_arburst(arburst), .m_rvalid(rvalid), .m_rready(rready), .m_rdata(rdata), .m_rid(rid), .m_rresp(rresp),
    .m_rlast(rlast), .m_awvalid(awvalid), .m_awready(awready), .m_awaddr(awaddr), .m_awlen(awlen), .m_awid(awid), .m_awsize(awsize),
    .m_awburst(awburst), .m_wvalid(wvalid), .m_wready(wready), .m_wdata(wdata), .m_wstrb(wstrb), .m_wlast(wlast),
    .m_bvalid(bvalid), .m_bready(bready), .m_bid(bid), .m_bresp(bresp));
  generate if (REGULATED != 0) begin : regulated
    reg [31:0] cycle = 0;
    wire tick = (cycle == 0);
    always @(posedge clk) cycle <= !rst_n | tick ? window - 1 : cycle - 1;
    wire [31:0] left; wire admit;
    halpipe_regulator_gate gate (
      .clk(clk), .rst_n(rst_n), .refill(tick), .budget(budget), .room(1'b1), .valid_i(arvalid), .ready_o(arready),
      .bytes(({8'd0, arlen} + 16'd1) << SIZE), .valid_o(p_arvalid), .ready_i(m_arready), .admit(admit), .left(left));
  end else begin : direct
    assign {p_arvalid, arready} = {arvalid, m_arready};
  end endgenerate
  assign {p_awvalid, awready, p_wvalid, wready} = {awvalid, m_awready, wvalid, m_wready};

  // ---------------------------------------------------------------------------------------------- memory
  reg  [31:0] x = 32'h1234567;
  wire [15:0] free;                                    // handshakes that do not wait in this cycle
  function [31:0] turn; input [31:0] v; reg [31:0] a, b; begin a = v ^ (v << 13); b = a ^ (a >> 17); turn = b ^ (b << 5); end endfunction
  assign free = {12'd0, x[27:24] >= stall[3:0], x[19:16] >= stall[3:0], x[11:8] >= stall[3:0], x[3:0] >= stall[3:0]};
  reg [31:0] r_due [0:255]; reg [ADDR-1:0] r_addr [0:255]; reg [7:0] r_len [0:255]; reg [3:0] r_id [0:255];
  reg [7:0] r_head = 0, r_tail = 0, r_beat = 0, a_head = 0, a_tail = 0, w_beat = 0;
  reg [ADDR-1:0] a_addr [0:255]; reg [7:0] a_len [0:255]; reg [3:0] a_id [0:255];
  reg [3:0] b_ids [0:255]; reg b_bad [0:255]; reg [7:0] b_head = 0, b_tail = 0; reg r_held = 0, b_held = 0;
  wire r_bad = (r_addr[r_head] >= broken) & (r_addr[r_head] < broken + 256), a_bad = (a_addr[a_head] >= broken) & (a_addr[a_head] < broken + 256);
  assign m_arready = free[0]; assign m_awready = free[1];
  assign m_wready = free[2] & (a_head != a_tail);
  wire [ADDR-1:0] r_from = r_addr[r_head] + r_beat * BEAT, w_to = a_addr[a_head] + w_beat * BEAT;
  assign rvalid = (r_head != r_tail) & (now >= r_due[r_head]) & (free[3] | r_held);
  assign {rid, rlast, rresp} = {r_id[r_head], r_beat == r_len[r_head], r_bad ? 2'd2 : 2'd0};
  genvar g;
  generate for (g = 0; g < BEAT; g = g + 1) begin : lane assign rdata[8*g +: 8] = memory[(r_from + g) & 16'h3fff]; end endgenerate
  assign bvalid = (b_head != b_tail) & (free[0] | b_held);
  assign {bid, bresp} = {b_ids[b_head], b_bad[b_head] ? 2'd2 : 2'd0};
  always @(posedge clk) if (rst_n) begin
    x <= turn(x ^ (now == 5 ? seed : 0));
    r_held <= rvalid & !rready; b_held <= bvalid & !bready;
    if (p_arvalid & m_arready) begin
      {r_addr[r_tail], r_len[r_tail], r_id[r_tail]} <= {araddr, arlen, arid}; r_due[r_tail] <= now + latency; r_tail <= r_tail + 1;
      $fwrite(trace, "R %0d %0d %0d %0d\n", arid, araddr, arlen + 1, now);
      if ((arsize != SIZE) | (arburst != 1)) $fwrite(trace, "X read\n");
    end
    if (rvalid & rready) begin r_beat <= rlast ? 0 : r_beat + 1; if (rlast) r_head <= r_head + 1; end
    if (p_awvalid & m_awready) begin
      {a_addr[a_tail], a_len[a_tail], a_id[a_tail]} <= {awaddr, awlen, awid}; a_tail <= a_tail + 1;
      $fwrite(trace, "W %0d %0d %0d %0d\n", awid, awaddr, awlen + 1, now);
      if ((awsize != SIZE) | (awburst != 1)) $fwrite(trace, "X write\n");
    end
    if (p_wvalid & m_wready) begin
      for (n = 0; n < BEAT; n = n + 1) if (wstrb[n] & !a_bad) memory[(w_to + n) & 16'h3fff] <= wdata[8*n +: 8];
      if (wlast != (w_beat == a_len[a_head])) $fwrite(trace, "X last\n");
      w_beat <= wlast ? 0 : w_beat + 1;
      if (wlast) begin a_head <= a_head + 1; {b_ids[b_tail], b_bad[b_tail]} <= {a_id[a_head], a_bad}; b_tail <= b_tail + 1; end
    end
    if (bvalid & bready) begin
      b_head <= b_head + 1;
      $fwrite(trace, "B %0d %0d %0d\n", bid, bresp, now);
    end
  end
endmodule
`default_nettype wire
