// What a refusal must do: a burst that never passes is answered with SLVERR, after all answers due before it and before any
// other; a read with as many beats as it asked for, a write after its last beat, of which the unit sees none. All else passes.
//
// Assumed is that the memory answers what it has taken alone, and shows an answer until it is taken.
`default_nettype none
module formal_refusal (
  input wire clk, input wire rst_n, input wire s_awvalid, input wire [1:0] s_awid, input wire m_awready, input wire aw_never,
  input wire s_wvalid, input wire s_wlast, input wire m_wready, input wire s_bready, input wire m_bvalid, input wire [1:0] m_bid,
  input wire [1:0] m_bresp, input wire s_arvalid, input wire [1:0] s_arid, input wire [7:0] s_arlen, input wire m_arready,
  input wire ar_never, input wire s_rready, input wire m_rvalid, input wire [1:0] m_rid, input wire [1:0] m_rresp,
  input wire [2:0] m_rdata, input wire m_rlast
);
  wire s_awready, m_awvalid, s_wready, m_wvalid, s_bvalid, m_bready, s_arready, m_arvalid, s_rvalid, m_rready, s_rlast;
  wire [1:0] s_bid, s_bresp, s_rid, s_rresp; wire [2:0] s_rdata;
  wire aw_long = m_awvalid & aw_never, ar_long = m_arvalid & ar_never;   // as the unit says
  halpipe_regulator_refusal #(.ID(2), .DATA(3)) dut (.*);
  (* keep *) wire [9:0] writes, reads; (* keep *) wire drops, denies, fails; (* keep *) wire [7:0] beats; (* keep *) wire [1:0] wid, rid;
  reg first = 1;
  always @(posedge clk) first <= 0;
  always @* assume (rst_n == !first);
  always @* begin
    if (aw_never & s_awvalid) assume (!m_awready);                       // a unit takes no burst that never passes
    if (ar_never & s_arvalid) assume (!m_arready);
  end

  // ---- bursts that the memory owes an answer, and the one that is refused: its ID, what of it is still to come
  reg [9:0] m_writes = 0, m_reads = 0; reg w_refused = 0, w_whole = 0, r_refused = 0; reg [1:0] w_id = 0, r_id = 0; reg [8:0] r_left = 0;
  reg b_waits = 0, r_waits = 0; reg [3:0] b_before = 0; reg [7:0] r_before = 0;
  wire w_taken = s_awvalid & s_awready, r_taken = s_arvalid & s_arready;
  wire [7:0] r_now = {s_rid, s_rresp, s_rdata, s_rlast};
  always @* assume ((!m_bvalid | m_writes != 0) & (!m_rvalid | m_reads != 0));
  always @* if (!first) assume ((!(b_waits & !w_refused) | (m_bvalid & {m_bid, m_bresp} == b_before))
                                & (!(r_waits & !r_refused) | (m_rvalid & {m_rid, m_rresp, m_rdata, m_rlast} == r_before)));
  always @(posedge clk)
    if (!rst_n) begin m_writes <= 0; m_reads <= 0; w_refused <= 0; w_whole <= 0; r_refused <= 0; b_waits <= 0; r_waits <= 0; end
    else begin
      m_writes <= m_writes + {9'd0, w_taken & !aw_never} - {9'd0, m_bvalid & m_bready};
      m_reads <= m_reads + {9'd0, r_taken & !ar_never} - {9'd0, m_rvalid & m_rready & m_rlast};
      if (w_taken & aw_never) begin w_refused <= 1; w_whole <= 0; w_id <= s_awid; end
      else if (w_refused & !w_whole & s_wvalid & s_wready & s_wlast) w_whole <= 1;
      else if (w_refused & s_bvalid & s_bready) w_refused <= 0;
      if (r_taken & ar_never) begin r_refused <= 1; r_id <= s_arid; r_left <= s_arlen + 9'd1; end
      else if (r_refused & s_rvalid & s_rready) begin r_left <= r_left - 1; if (r_left == 1) r_refused <= 0; end
      b_waits <= s_bvalid & !s_bready; r_waits <= s_rvalid & !s_rready; b_before <= {s_bid, s_bresp}; r_before <= r_now;
    end
  always @* if (!first) begin
    due:      assert (writes == m_writes & reads == m_reads);
    state:    assert (drops == (w_refused & !w_whole) & denies == (w_refused & w_whole) & (!w_refused | wid == w_id));
    rest:     assert (fails == r_refused & (!r_refused | (rid == r_id & {1'b0, beats} + 9'd1 == r_left & r_left <= 256)));
    ordered:  assert ((!w_refused | m_writes == 0) & (!r_refused | m_reads == 0));
    // addresses: all but one that never passes go on; that one is taken as soon as nothing before it is due
    aw_goes:  assert (m_awvalid == (s_awvalid & !w_refused & m_writes != 1023));
    ar_goes:  assert (m_arvalid == (s_arvalid & !r_refused & m_reads != 1023));
    aw_taken: assert (!s_awvalid | s_awready == (m_awvalid & (aw_never ? m_writes == 0 : m_awready)));
    ar_taken: assert (!s_arvalid | s_arready == (m_arvalid & (ar_never ? m_reads == 0 : m_arready)));
    // data of writes: to the unit, or nowhere
    w_goes:   assert (m_wvalid == (s_wvalid & !(w_refused & !w_whole)));
    w_taken_: assert (s_wready == (m_wready | (w_refused & !w_whole)));
    // answers: of the memory, unchanged; or the refusal
    b_passes: assert (w_refused | (s_bvalid == m_bvalid & m_bready == s_bready & {s_bid, s_bresp} == {m_bid, m_bresp}));
    denied:   assert (!w_refused | (s_bvalid == w_whole & (!w_whole | {s_bid, s_bresp} == {w_id, 2'b10})));
    r_passes: assert (r_refused | (s_rvalid == m_rvalid & m_rready == s_rready & r_now == {m_rid, m_rresp, m_rdata, m_rlast}));
    failed:   assert (!r_refused | (s_rvalid & s_rid == r_id & s_rresp == 2'b10 & s_rlast == (r_left == 1)));
    b_stays:  assert (!b_waits | (s_bvalid & {s_bid, s_bresp} == b_before));
    r_stays:  assert (!r_waits | (s_rvalid & r_now == r_before));
  end
endmodule
`default_nettype wire
