// The shared memory: one beat in every cycle, reads and writes together, round robin over all queues. A read is served
// LATENCY cycles after its address was taken, or later; a write when its data is there, but none before cycle HOLD.
`default_nettype none
module memory #(
  parameter integer PORTS = 4
)(
  input  wire               clk,
  input  wire               rst_n,
  input  wire [9:0]         depth,       // addresses that a queue takes before it says no, 1..512
  input  wire [31:0]        latency,
  input  wire [31:0]        hold,        // data of writes is not taken before this cycle
  input  wire [PORTS-1:0]   ar_valid,
  output wire [PORTS-1:0]   ar_ready,
  input  wire [8*PORTS-1:0] ar_len,
  input  wire [PORTS-1:0]   aw_valid,
  output wire [PORTS-1:0]   aw_ready,
  input  wire [8*PORTS-1:0] aw_len,
  input  wire [PORTS-1:0]   w_valid,
  output wire [PORTS-1:0]   w_ready,
  output wire [PORTS-1:0]   r_beat       // a beat of read data is served
);
  reg [31:0] now;
  always @(posedge clk or negedge rst_n) if (!rst_n) now <= 0; else now <= now + 1;

  wire [2*PORTS-1:0] want;
  reg  [2*PORTS-1:0] mask;
  wire [2*PORTS-1:0] upper = want & mask;
  wire [2*PORTS-1:0] pick = (upper != 0) ? upper : want;
  wire [2*PORTS-1:0] grant = pick & (~pick + 1'b1);
  always @(posedge clk or negedge rst_n)
    if (!rst_n) mask <= 0;
    else if (grant != 0) mask <= ~(grant | (grant - 1'b1));

  genvar p;
  generate for (p = 0; p < PORTS; p = p + 1) begin : port
    memory_queue read (
      .clk(clk), .rst_n(rst_n), .now(now), .depth(depth), .latency(latency),
      .valid(ar_valid[p]), .ready(ar_ready[p]), .len(ar_len[8*p +: 8]),
      .has_data(1'b1), .want(want[2*p]), .grant(grant[2*p]));
    memory_queue write (
      .clk(clk), .rst_n(rst_n), .now(now), .depth(depth), .latency(32'd0),
      .valid(aw_valid[p]), .ready(aw_ready[p]), .len(aw_len[8*p +: 8]),
      .has_data(w_valid[p] & (now >= hold)), .want(want[2*p+1]), .grant(grant[2*p+1]));
    assign w_ready[p] = grant[2*p+1];
    assign r_beat[p] = grant[2*p];
  end endgenerate
endmodule
`default_nettype wire
