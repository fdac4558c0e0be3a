// Holds the data of writes back until a burst is there as a whole, and its address until then: a manager that withholds
// data stalls itself, and no other behind it in the memory. The address is taken at once, one at a time.
//
// A burst longer than BEATS can never be there as a whole. It is shown to the regulator at once, which refuses it. That the
// buffer is full shows nothing: it may be full of data of the burst before, whose address has passed.
`default_nettype none
module halpipe_regulator_store #(
  parameter integer BEATS = 16,   // of the buffer, a power of two from 2 on
  parameter integer BEAT  = 73,   // bits of a beat, its LAST highest
  parameter integer INFO  = 64    // bits of an address with all that belongs to it, its length highest
)(
  input  wire            clk,
  input  wire            rst_n,
  // manager's side
  input  wire            s_awvalid, output wire            s_awready, input  wire [INFO-1:0] s_aw,
  input  wire            s_wvalid,  output wire            s_wready,  input  wire [BEAT-1:0] s_w,
  // the regulator's side
  output wire            m_awvalid, input  wire            m_awready, output reg  [INFO-1:0] m_aw,
  output wire            m_wvalid,  input  wire            m_wready,  output wire [BEAT-1:0] m_w
);
  localparam integer A = $clog2(BEATS);
  reg [BEAT-1:0] beats [0:BEATS-1];
  reg [A:0] head, tail;
  reg signed [A+9:0] whole;       // bursts that came with their last beat, less addresses that have passed
  reg held, huge;                 // an address waits; its burst is longer than the buffer
  wire full = (tail - head == BEATS[A:0]);
  wire push = s_wvalid & ~full;
  wire pop = m_wvalid & m_wready;
  wire passes = m_awvalid & m_awready;

  assign s_wready = ~full;
  assign m_wvalid = (tail != head);
  assign m_w = beats[head[A-1:0]];
  assign s_awready = ~held | passes;
  assign m_awvalid = held & (huge | (whole > 0));
  always @(posedge clk) if (push) beats[tail[A-1:0]] <= s_w;
  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      head <= 0; tail <= 0; whole <= 0; held <= 1'b0; huge <= 1'b0; m_aw <= 0;
    end else begin
      if (push) tail <= tail + 1'b1;
      if (pop) head <= head + 1'b1;
      whole <= whole + $signed({{A+9{1'b0}}, push & s_w[BEAT-1]}) - $signed({{A+9{1'b0}}, passes});
      if (s_awvalid & s_awready) begin
        held <= 1'b1; m_aw <= s_aw; huge <= ({24'd0, s_aw[INFO-1 -: 8]} >= BEATS);
      end else if (passes) held <= 1'b0;
    end
endmodule
`default_nettype wire
