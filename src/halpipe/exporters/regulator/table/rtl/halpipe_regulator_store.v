// Holds the data of writes back until a burst is there as a whole, and its address until then: a manager that withholds
// data stalls itself, and no other behind it in the memory. The address is taken at once, one at a time.
//
// A burst longer than BEATS is shown to the regulator as soon as the buffer is full, so that nothing is stuck unseen; state a
// LONGEST of at most BEATS, and it goes no further.
`default_nettype none
module halpipe_regulator_store #(
  parameter integer BEATS = 16,   // of the buffer, a power of two from 2 on
  parameter integer DATA  = 64,   // bits of data
  parameter integer INFO  = 64    // bits of an address with all that belongs to it
)(
  input  wire              clk,
  input  wire              rst_n,
  // manager's side
  input  wire              s_awvalid, output wire              s_awready, input  wire [INFO-1:0]   s_aw,
  input  wire              s_wvalid,  output wire              s_wready,  input  wire [DATA-1:0]   s_wdata,
  input  wire [DATA/8-1:0] s_wstrb,   input  wire              s_wlast,
  // the regulator's side
  output wire              m_awvalid, input  wire              m_awready, output reg  [INFO-1:0]   m_aw,
  output wire              m_wvalid,  input  wire              m_wready,  output wire [DATA-1:0]   m_wdata,
  output wire [DATA/8-1:0] m_wstrb,   output wire              m_wlast
);
  localparam integer A = $clog2(BEATS);
  localparam integer WIDTH = DATA + DATA / 8 + 1;
  reg [WIDTH-1:0] beats [0:BEATS-1];
  reg [A:0] head, tail;
  reg signed [A+1:0] whole;       // bursts that are there with their last beat, less addresses that have passed
  reg held;                       // an address waits
  wire full = (tail - head == BEATS[A:0]);
  wire push = s_wvalid & ~full;
  wire pop = m_wvalid & m_wready;
  wire passes = m_awvalid & m_awready;
  reg shown;                      // an address that was shown stays, whatever becomes of the buffer

  assign s_wready = ~full;
  assign m_wvalid = (tail != head);
  assign {m_wlast, m_wstrb, m_wdata} = beats[head[A-1:0]];
  assign s_awready = ~held | passes;
  assign m_awvalid = held & (shown | (whole > 0) | full);
  always @(posedge clk) if (push) beats[tail[A-1:0]] <= {s_wlast, s_wstrb, s_wdata};
  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      head <= 0; tail <= 0; whole <= 0; held <= 1'b0; shown <= 1'b0; m_aw <= 0;
    end else begin
      if (push) tail <= tail + 1'b1;
      if (pop) head <= head + 1'b1;
      whole <= whole + $signed({{A+1{1'b0}}, push & s_wlast}) - $signed({{A+1{1'b0}}, passes});
      shown <= m_awvalid & ~m_awready;
      if (s_awvalid & s_awready) begin
        held <= 1'b1; m_aw <= s_aw;
      end else if (passes) held <= 1'b0;
    end
endmodule
`default_nettype wire
