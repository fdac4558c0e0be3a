// What a write buffer must do: beats leave once, unchanged and in order; an address is shown when its burst is there as a whole,
// or never can be, and stays shown. The buffer's own memory is connected to the one of the same name below.
//
// Fewer than 1000 bursts and addresses are on their way: the unit owes 255 writes at most, the buffer holds BEATS.
`default_nettype none
module formal_store #(parameter BEATS = 4)(
  input wire clk, input wire rst_n, input wire s_awvalid, input wire [9:0] s_aw, input wire s_wvalid, input wire [2:0] s_w,
  input wire m_awready, input wire m_wready
);
  wire s_awready, s_wready, m_awvalid, m_wvalid; wire [9:0] m_aw; wire [2:0] m_w;
  halpipe_regulator_store #(.BEATS(BEATS), .BEAT(3), .INFO(10)) dut (
    .clk(clk), .rst_n(rst_n), .s_awvalid(s_awvalid), .s_awready(s_awready), .s_aw(s_aw), .s_wvalid(s_wvalid), .s_wready(s_wready),
    .s_w(s_w), .m_awvalid(m_awvalid), .m_awready(m_awready), .m_aw(m_aw), .m_wvalid(m_wvalid), .m_wready(m_wready), .m_w(m_w));
  (* keep *) wire [2:0] head, tail; (* keep *) wire signed [11:0] whole; (* keep *) wire held, huge;
  reg [2:0] beats [0:BEATS-1];
  reg first = 1;
  always @(posedge clk) first <= 0;
  always @* assume (rst_n == !first);
  wire push = s_wvalid & s_wready, pop = m_wvalid & m_wready, takes = s_awvalid & s_awready, passes = m_awvalid & m_awready;

  // ---- addresses
  reg m_held = 0; reg [9:0] m_copy = 0; reg signed [11:0] m_whole = 0; reg waits = 0;
  always @(posedge clk) begin
    waits <= rst_n & m_awvalid & !m_awready;
    if (!rst_n) begin m_held <= 0; m_whole <= 0; m_copy <= 0; end
    else begin
      m_held <= takes | (m_held & !passes);
      if (takes) m_copy <= s_aw;
      m_whole <= m_whole + (push & s_w[2] ? 12'sd1 : 12'sd0) - (passes ? 12'sd1 : 12'sd0);
    end
  end
  always @* assume (m_whole > -12'sd1000 & m_whole < 12'sd1000);
  wire too_long = {1'b0, m_copy[9:2]} + 9'd1 > BEATS;
  always @* if (!first) begin
    carried: assert (held == m_held & whole == m_whole & (!held | (m_aw == m_copy & huge == too_long)));
    shown:   assert (m_awvalid == (m_held & (too_long | m_whole > 0)));
    stays:   assert (!waits | m_awvalid);
    accepts: assert (s_awready == (!m_held | passes));
  end

  // ---- beats: how many there are, and any one of them on its way
  reg [2:0] m_count = 0; (* anyseq *) reg pick; reg watched = 0; reg [2:0] place = 0, beat = 0;
  always @(posedge clk)
    if (!rst_n) begin m_count <= 0; watched <= 0; end
    else begin
      m_count <= m_count + {2'd0, push} - {2'd0, pop};
      if (pop & watched & place == head) watched <= 0;
      else if (push & pick & !watched) begin watched <= 1; place <= tail; beat <= s_w; end
    end
  wire [2:0] filled = tail - head, before = place - head;
  always @* if (!first) begin
    counted: assert (m_count == filled & m_count <= BEATS);
    offers:  assert (m_wvalid == (m_count != 0) & s_wready == (m_count != BEATS));
    kept:    assert (!watched | (before < m_count & beats[place[1:0]] == beat));
    leaves:  assert (!(watched & place == head) | m_w == beat);
  end
endmodule
`default_nettype wire
