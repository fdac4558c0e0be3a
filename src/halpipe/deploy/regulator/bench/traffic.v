// Requests of one direction of one manager, as the address channel of AXI shows them: VALID and length are stable until
// READY. For a writer also the beats of data, which may be shown before the address is taken, as AXI allows.
`default_nettype none
module traffic #(
  parameter [31:0] STREAM = 0,          // tells the streams of one seed apart
  parameter        DATA = 1             // a writer; a reader has no data side
)(
  input  wire        clk,
  input  wire        rst_n,
  input  wire [31:0] seed,
  input  wire [3:0]  kind,              // bit 0 on, bit 1 random lengths, bit 2 random gaps, bit 3 comes in clusters
  input  wire [8:0]  longest,           // beats of the longest burst
  output reg         valid,
  input  wire        ready,
  output reg  [7:0]  len,               // beats - 1
  output wire        data_valid,
  input  wire        data_ready,
  output wire        data_last
);
  // Two words of xorshift32: one draws lengths and gaps, the other whether a cluster begins or ends.
  reg [31:0] x, y;
  function [31:0] next; input [31:0] v; reg [31:0] a, b; begin
    a = v ^ (v << 13); b = a ^ (a >> 17); next = b ^ (b << 5);
  end endfunction
  function [31:0] nonzero; input [31:0] v; nonzero = (v == 0) ? 32'h6b84a5c1 : v; endfunction

  reg  calm;                            // between two clusters
  // verilator lint_off UNUSEDSIGNAL
  wire [23:0] scaled = x[31:16] * {7'd0, longest};   // the upper byte is uniform in 0..longest-1
  // verilator lint_on UNUSEDSIGNAL
  wire [7:0] drawn = kind[1] ? scaled[23:16] : longest[7:0] - 8'd1;
  wire fits;                            // the data side can remember one burst more
  wire start = kind[0] & fits & ~(kind[2] & (x[2:0] != 0)) & ~(kind[3] & calm);

  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      x <= 0; y <= 0; calm <= 0; valid <= 0; len <= 0;
    end else begin
      x <= (x == 0) ? nonzero(next(seed ^ (STREAM * 32'h9e3779b9) ^ 32'h1f123bb5)) : next(x);
      y <= (y == 0) ? nonzero(next(seed + STREAM * 32'h85ebca6b + 32'h27d4eb2f)) : next(y);
      if (y[7:0] == 0) calm <= ~calm;   // clusters and calms of 256 cycles on average
      if (!valid || ready) begin
        valid <= start & (x != 0);
        len   <= drawn;
      end
    end

  // Lengths of the bursts whose data is still to come.
  reg [7:0] fifo [0:511];
  reg [8:0] head, tail;
  reg [9:0] held;
  reg [7:0] beat;
  wire push = (DATA != 0) & (!valid || ready) & start & (x != 0);
  wire pop  = data_valid & data_ready & data_last;
  assign fits = (DATA == 0) | (held < 10'd510);
  assign data_valid = (held != 0);
  assign data_last = (beat == fifo[head]);
  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      head <= 0; tail <= 0; held <= 0; beat <= 0;
    end else begin
      if (push) begin fifo[tail] <= drawn; tail <= tail + 9'd1; end
      if (data_valid & data_ready) beat <= data_last ? 8'd0 : beat + 8'd1;
      if (pop) head <= head + 9'd1;
      held <= held + {9'd0, push} - {9'd0, pop};
    end
endmodule
`default_nettype wire
