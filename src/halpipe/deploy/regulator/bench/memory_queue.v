// Addresses of one direction of one manager, in order.
`default_nettype none
module memory_queue (
  input  wire        clk,
  input  wire        rst_n,
  input  wire [31:0] now,
  input  wire [9:0]  depth,
  input  wire [31:0] latency,
  input  wire        valid,
  output wire        ready,
  input  wire [7:0]  len,
  input  wire        has_data,
  output wire        want,
  input  wire        grant
);
  reg [7:0]  beats [0:511];
  reg [31:0] due [0:511];
  reg [8:0]  head, tail;
  reg [9:0]  count;
  reg [7:0]  beat;
  // verilator lint_off UNUSEDSIGNAL
  wire [31:0] waited = now - due[head];
  // verilator lint_on UNUSEDSIGNAL
  assign ready = (count < depth);
  assign want = (count != 0) & ~waited[31] & has_data;
  wire push = valid & ready;
  wire pop = grant & (beat == beats[head]);
  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      head <= 0; tail <= 0; count <= 0; beat <= 0;
    end else begin
      if (push) begin
        beats[tail] <= len; due[tail] <= now + latency; tail <= tail + 9'd1;
      end
      if (grant) beat <= pop ? 8'd0 : beat + 8'd1;
      if (pop) head <= head + 9'd1;
      count <= count + {9'd0, push} - {9'd0, pop};
    end
endmodule
`default_nettype wire
