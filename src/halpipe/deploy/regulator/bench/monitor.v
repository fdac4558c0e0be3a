// Counts what one manager gets past its regulator. It sees the handshakes on both sides and the bench's own windows, and
// never a register of the regulator.
`default_nettype none
module monitor (
  input  wire        clk,
  input  wire        rst_n,
  input  wire        ends,        // last cycle of a window
  input  wire        valid_i,      // address, manager's side
  input  wire        ready_i,
  input  wire        valid_o,      // address, memory's side
  input  wire        ready_o,
  input  wire [7:0]  len,
  input  wire [15:0] bytes,
  output reg  [31:0] taken,        // bytes whose addresses were taken in the window that just closed,
  output reg  [31:0] carried,      // of these, bytes of a burst first shown in an earlier window,
  output reg  [31:0] waiting,      // and bytes of a burst shown and not yet taken when it closed
  output reg         retracted,    // VALID fell, or the burst changed, before READY
  output reg         unequal,      // a burst passed on one side only
  output wire        first         // the burst is shown for the first time
);
  reg pending, old; reg [7:0] pending_len;
  wire hs = valid_o & ready_o;
  assign first = valid_o & ~pending;
  wire [31:0] got = hs ? {16'd0, bytes} : 32'd0;
  reg [31:0] sum, sum_old;
  wire [31:0] sum_now = sum + got;
  wire [31:0] old_now = sum_old + (old ? got : 32'd0);
  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      pending <= 0; old <= 0; pending_len <= 0; sum <= 0; sum_old <= 0;
      taken <= 0; carried <= 0; waiting <= 0; retracted <= 0; unequal <= 0;
    end else begin
      pending <= valid_o & ~ready_o; pending_len <= len;
      old <= valid_o & ~ready_o & (old | ends);
      if (pending & (~valid_o | (len != pending_len))) retracted <= 1;
      if ((valid_i & ready_i) != hs) unequal <= 1;
      if (ends) begin
        taken <= sum_now; carried <= old_now; sum <= 0; sum_old <= 0;
        waiting <= (valid_o & ~ready_o) ? {16'd0, bytes} : 32'd0;
      end else begin
        sum <= sum_now; sum_old <= old_now;
      end
    end
endmodule
`default_nettype wire
