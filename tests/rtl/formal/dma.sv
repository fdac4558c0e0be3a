// The DMA engine at its ports, with two channels, beats of 2 bytes and bursts of 2 beats: AXI4 and AXI4-Lite for all software
// and every memory that answers what was asked for.
`default_nettype none
module formal_dma (
  input wire clk, input wire rst_n, input wire l_awvalid, input wire [15:0] l_awaddr, input wire l_wvalid, input wire [63:0] l_wdata,
  input wire [7:0] l_wstrb, input wire l_bready, input wire l_arvalid, input wire [15:0] l_araddr, input wire l_rready,
  input wire m_arready, input wire m_rvalid, input wire [15:0] m_rdata, input wire [3:0] m_rid, input wire [1:0] m_rresp,
  input wire m_rlast, input wire m_awready, input wire m_wready, input wire m_bvalid, input wire [3:0] m_bid, input wire [1:0] m_bresp
);
  wire l_awready, l_wready, l_bvalid, l_arready, l_rvalid; wire [1:0] l_bresp, l_rresp; wire [63:0] l_rdata;
  wire m_arvalid, m_rready, m_awvalid, m_wvalid, m_wlast, m_bready; wire [3:0] m_araddr, m_awaddr; wire [7:0] m_arlen, m_awlen;
  wire [3:0] m_arid, m_awid; wire [2:0] m_arsize, m_awsize; wire [1:0] m_arburst, m_awburst, m_wstrb; wire [15:0] m_wdata;
  halpipe_dma #(.CHANNELS(2), .ADDR(4), .SIZE(1), .BURST(2), .DEPTH(2)) dut (.*);
  (* keep *) wire now_valid, next_valid, now_first, next_first, now_end, next_end; (* keep *) wire [7:0] now_left, next_left;
  (* keep *) wire [3:0] now_id, next_id; (* keep *) wire [5:0] read_bursts, write_bursts;
  reg first = 1, begun = 0;
  always @(posedge clk) begin first <= 0; begun <= first; end
  always @* assume (rst_n == !first);

  // The memory answers beats and bursts that it owes, a write after its data; of each channel, and in order.
  reg [3:0] owed [0:1]; reg [2:0] open_ [0:1];                    // beats to come; writes taken whose answer is due
  wire ar = m_arvalid & m_arready, aw = m_awvalid & m_awready, w = m_wvalid & m_wready;
  integer c;
  initial begin owed[0] = 0; owed[1] = 0; open_[0] = 0; open_[1] = 0; end
  reg [2:0] shown = 0; reg [1:0] len0 = 0, len1 = 0, len2 = 0; reg id0 = 0, id1 = 0, id2 = 0, beat = 0, aw_old = 0;
  wire aw_new = m_awvalid & !aw_old;                              // an address is shown: its data may follow
  wire [2:0] shown_now = shown + aw_new;
  wire [1:0] len_now = (shown == 0) ? m_awlen[1:0] : len0; wire id_now = (shown == 0) ? m_awid[0] : id0;
  always @(posedge clk) if (rst_n) begin
    for (c = 0; c < 2; c = c + 1) begin
      owed[c] <= owed[c] + (ar & m_arid == c ? m_arlen[1:0] + 4'd1 : 4'd0) - (m_rvalid & m_rid == c);
      open_[c] <= open_[c] + (w & m_wlast & id_now == c) - (m_bvalid & m_bid == c);
    end
    aw_old <= m_awvalid & !m_awready;
    if (w) beat <= !m_wlast & !beat;
    shown <= shown_now - (w & m_wlast);
    if (w & m_wlast) begin
      {len0, id0} <= (shown > 1) ? {len1, id1} : {m_awlen[1:0], m_awid[0]};
      {len1, id1} <= (shown > 2) ? {len2, id2} : {m_awlen[1:0], m_awid[0]};
    end else begin
      if (shown == 0) {len0, id0} <= {m_awlen[1:0], m_awid[0]};
      if (shown == 1) {len1, id1} <= {m_awlen[1:0], m_awid[0]};
      if (shown == 2) {len2, id2} <= {m_awlen[1:0], m_awid[0]};
    end
  end
  always @* begin
    if (m_rvalid) assume (m_rid < 2 & owed[m_rid[0]] != 0);
    if (m_bvalid) assume (m_bid < 2 & open_[m_bid[0]] != 0);
  end
  reg ar_waits = 0, w_waits = 0, b_waits = 0, r_waits = 0; reg [15:0] ar_ = 0, aw_ = 0; reg [18:0] w_ = 0; reg [63:0] r_ = 0;
  always @(posedge clk) begin
    ar_waits <= rst_n & m_arvalid & !m_arready; w_waits <= rst_n & m_wvalid & !m_wready;
    b_waits <= rst_n & l_bvalid & !l_bready; r_waits <= rst_n & l_rvalid & !l_rready;
    ar_ <= {m_araddr, m_arlen, m_arid}; aw_ <= {m_awaddr, m_awlen, m_awid}; w_ <= {m_wdata, m_wstrb, m_wlast}; r_ <= l_rdata;
  end
  // What is proven of a channel alone (dma_channel.sv, stays): the beat that is due does not change before it is taken.
  always @* if (w_waits) assume (m_wdata == w_[18:3]);
  wire [1:0] second_len = (shown == 1) ? m_awlen[1:0] : len1; wire second_id = (shown == 1) ? m_awid[0] : id1;
  always @* if (!first) begin
    bounds:    assert ((read_bursts[2:0] == 2 | read_bursts[2:0] == 4) & (read_bursts[5:3] == 2 | read_bursts[5:3] == 4)
                       & (write_bursts[2:0] == 2 | write_bursts[2:0] == 4) & (write_bursts[5:3] == 2 | write_bursts[5:3] == 4));
    counted:   assert ((now_valid | !beat) & shown_now == now_valid + next_valid & (now_valid | !next_valid) & m_wvalid == now_valid);
    current:   assert (!now_valid | (now_left < 2 & now_left + beat == len_now & len_now < 2 & now_id == id_now));
    following: assert (!next_valid | (next_left == second_len & second_len < 2 & next_id == second_id));
    edges:     assert (!now_valid | !(now_left == 0 & now_first & now_end));
    edges_too: assert (!next_valid | !(next_left == 0 & next_first & next_end));
    quiet:     assert (!begun | !(m_arvalid | m_awvalid | m_wvalid | l_bvalid | l_rvalid));
    ar_stays:  assert (!ar_waits | (m_arvalid & {m_araddr, m_arlen, m_arid} == ar_));
    aw_stays:  assert (!aw_old | (m_awvalid & {m_awaddr, m_awlen, m_awid} == aw_));
    w_stays:   assert (!w_waits | (m_wvalid & {m_wdata, m_wstrb, m_wlast} == w_));
    b_stays:   assert (!b_waits | l_bvalid);
    r_stays:   assert (!r_waits | (l_rvalid & l_rdata == r_));
    takes:     assert (m_rready & m_bready);
    reads:     assert (!m_arvalid | (m_arlen < 2 & m_araddr[1:0] + 2 * m_arlen < 4 & !m_araddr[0] & m_arid < 2));
    writes:    assert (!m_awvalid | (m_awlen < 2 & m_awaddr[1:0] + 2 * m_awlen < 4 & !m_awaddr[0] & m_awid < 2));
    kinds:     assert ({m_arsize, m_awsize, m_arburst, m_awburst} == {3'd1, 3'd1, 2'd1, 2'd1});
    data:      assert (!m_wvalid | shown_now != 0);               // no data before its address is shown
    last:      assert (!m_wvalid | m_wlast == (beat == len_now));
    strobes:   assert (!m_wvalid | m_wstrb != 0);
    few:       assert (shown_now <= 2);
    lite:      assert (!(l_awready ^ l_wready) & (!l_awready | (l_awvalid & l_wvalid)) & (!l_arready | l_arvalid));
  end
endmodule
`default_nettype wire
