// One channel of the DMA engine: bursts of one transfer, any alignment, with a buffer that turns source beats into target beats.
//
// Reads are requested only where the buffer has room for all their beats, so that data of reads is always taken. A burst is
// written when the buffer has all its beats. After an error of the memory nothing more is requested; what was under way ends.
`default_nettype none
module halpipe_dma_channel #(
  parameter integer ADDR  = 40,
  parameter integer SIZE  = 3,           // log2 of the bytes of a beat, 1 to 5
  parameter integer BURST = 6,           // log2 of the bytes of the longest burst, above SIZE
  parameter integer DEPTH = 6            // log2 of the beats of the buffer; of bursts it holds two at least
)(
  input  wire                clk,
  input  wire                rst_n,
  input  wire                start,      // of a transfer, while none is running
  input  wire [ADDR-1:0]     source,
  input  wire [ADDR-1:0]     target,
  input  wire [ADDR-1:0]     bytes,
  input  wire [3:0]          read_log,   // log2 of the bytes of a burst; out of SIZE to BURST the nearest of them
  input  wire [3:0]          write_log,
  output wire                ends,       // the last cycle of a transfer,
  output reg                 failed,     // and whether the memory has answered one of its bursts with an error
  // a burst to read, and its beats
  output wire                ar_want,
  output wire [ADDR-1:0]     ar_addr,
  output wire [7:0]          ar_len,
  input  wire                ar_take,
  input  wire                r_beat,
  input  wire                r_error,
  input  wire [(8<<SIZE)-1:0] r_data,
  // a burst to write, its beats as they are due, and its answer
  output wire                aw_want,
  output wire [ADDR-1:0]     aw_addr,    // of its first byte
  output wire [7:0]          aw_len,
  output wire [SIZE-1:0]     aw_end,     // place of the byte behind its last
  input  wire                aw_take,
  output wire [(8<<SIZE)-1:0] w_data,
  input  wire                w_beat,
  input  wire                b_beat,
  input  wire                b_error
);
  localparam integer BEAT = 1 << SIZE, WIDTH = 8 << SIZE;
  function [BURST:0] burst_of; input [3:0] log; integer k; begin
    burst_of = BEAT[BURST:0];
    for (k = SIZE + 1; k <= BURST; k = k + 1) if ({28'd0, log} >= k) burst_of = burst_of << 1;
  end endfunction
  // Bytes of the next burst from an address on: up to a boundary of the burst's size, at most what is left.
  function [BURST:0] next; input [BURST-1:0] at; input [ADDR-1:0] left; input [BURST:0] burst; reg [BURST:0] room; begin
    room = burst - ({1'b0, at} & (burst - 1'b1));
    next = (left < {{(ADDR-BURST-1){1'b0}}, room}) ? left[BURST:0] : room;
  end endfunction
  // Beats that so many bytes touch, from a place in the first beat on.
  // verilator lint_off UNUSEDSIGNAL
  function [BURST-SIZE:0] beats_of; input [SIZE-1:0] at; input [BURST:0] count; reg [BURST+1:0] sum; begin
    sum = {{(BURST-SIZE+2){1'b0}}, at} + {1'b0, count} + {{(BURST-SIZE+2){1'b0}}, {SIZE{1'b1}}};
    beats_of = sum[BURST:SIZE];
  end endfunction
  // verilator lint_on UNUSEDSIGNAL

  reg             running;
  reg  [ADDR-1:0] from, to, to_read, to_write;     // addresses and bytes of what is not requested yet
  reg  [BURST:0]  read_burst, write_burst;
  reg  [SIZE-1:0] shift;                           // places by which bytes move up from source to target beats
  reg             skips;                           // the first source beat fills no target beat
  reg  [DEPTH:0]  room, in_flight, filled;         // beats: of the buffer, that are not spoken for; to come; to be written
  reg  [ADDR-1:0] due;                             // target beats that are still to come out of source beats
  reg  [ADDR-1:0] unanswered;                      // writes without an answer

  wire [BURST:0]      read_bytes = next(from[BURST-1:0], to_read, read_burst);
  wire [BURST-SIZE:0] read_beats = beats_of(from[SIZE-1:0], read_bytes);
  wire [BURST:0]      write_bytes = next(to[BURST-1:0], to_write, write_burst);
  wire [BURST-SIZE:0] write_beats = beats_of(to[SIZE-1:0], write_bytes);
  wire [DEPTH:0]      read_cost = {{(DEPTH-BURST+SIZE){1'b0}}, read_beats};
  wire [DEPTH:0]      write_cost = {{(DEPTH-BURST+SIZE){1'b0}}, write_beats};
  wire [SIZE-1:0]     last_place = to[SIZE-1:0] + write_bytes[SIZE-1:0];
  assign ar_want = running & ~failed & (to_read != 0) & (room >= read_cost);
  assign ar_addr = {from[ADDR-1:SIZE], {SIZE{1'b0}}};
  assign ar_len  = {{(7-BURST+SIZE){1'b0}}, read_beats} - 8'd1;
  assign aw_want = running & ~failed & (to_write != 0) & (filled >= write_cost);
  assign aw_addr = to;
  assign aw_len  = {{(7-BURST+SIZE){1'b0}}, write_beats} - 8'd1;
  assign aw_end  = last_place;
  assign ends = running & (failed | (to_write == 0)) & (in_flight == 0) & (unanswered == 0);

  // ---------------------------------------------------------------------------------------------- source beats to target beats
  reg  [WIDTH-1:0] carry, buffer [0:(1<<DEPTH)-1];
  reg  [DEPTH-1:0] head, tail;
  // verilator lint_off UNUSEDSIGNAL
  wire [2*WIDTH-1:0] turned = {r_data, r_data} << {shift, 3'd0};
  // verilator lint_on UNUSEDSIGNAL
  wire [WIDTH-1:0] rotated = turned[2*WIDTH-1:WIDTH];
  wire [WIDTH-1:0] made;
  genvar p;
  generate for (p = 0; p < BEAT; p = p + 1) begin : place
    assign made[8*p +: 8] = (p >= shift) & r_beat ? rotated[8*p +: 8] : carry[8*p +: 8];
  end endgenerate
  wire flush = running & ~failed & (to_read == 0) & (in_flight == 0) & (due != 0);   // what is left of the last source beat
  wire fill = (r_beat & ~skips & (due != 0)) | flush;
  assign w_data = buffer[head];
  always @(posedge clk) if (fill) buffer[tail] <= made;

  // verilator lint_off UNUSEDSIGNAL
  wire [ADDR:0] target_span = {{(ADDR-SIZE+1){1'b0}}, target[SIZE-1:0]} + {1'b0, bytes} + {{(ADDR-SIZE+1){1'b0}}, {SIZE{1'b1}}};
  // verilator lint_on UNUSEDSIGNAL
  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      running <= 1'b0; failed <= 1'b0; from <= 0; to <= 0; to_read <= 0; to_write <= 0; read_burst <= BEAT[BURST:0];
      write_burst <= BEAT[BURST:0]; shift <= 0; skips <= 1'b0; room <= 0; in_flight <= 0; filled <= 0; due <= 0;
      unanswered <= 0; head <= 0; tail <= 0; carry <= 0;
    end else if (start & ~running) begin
      running <= 1'b1; failed <= 1'b0; from <= source; to <= target; to_read <= bytes; to_write <= bytes;
      read_burst <= burst_of(read_log); write_burst <= burst_of(write_log);
      shift <= target[SIZE-1:0] - source[SIZE-1:0]; skips <= target[SIZE-1:0] < source[SIZE-1:0];
      // Where the first source beat fills a target beat and leaves bytes, a last beat may come of what the last one leaves.
      room <= (target[SIZE-1:0] > source[SIZE-1:0]) ? {1'b0, {DEPTH{1'b1}}} : {1'b1, {DEPTH{1'b0}}};
      filled <= 0; due <= (bytes == 0) ? 0 : {{(SIZE-1){1'b0}}, target_span[ADDR:SIZE]}; head <= 0; tail <= 0;
    end else begin
      running <= running & ~ends;
      failed <= failed | (r_beat & r_error) | (b_beat & b_error);
      if (ar_take) begin from <= from + {{(ADDR-BURST-1){1'b0}}, read_bytes}; to_read <= to_read - {{(ADDR-BURST-1){1'b0}}, read_bytes}; end
      if (aw_take) begin to <= to + {{(ADDR-BURST-1){1'b0}}, write_bytes}; to_write <= to_write - {{(ADDR-BURST-1){1'b0}}, write_bytes}; end
      room <= room - (ar_take ? read_cost : 0) + {{DEPTH{1'b0}}, w_beat};
      in_flight <= in_flight + (ar_take ? read_cost : 0) - {{DEPTH{1'b0}}, r_beat};
      filled <= filled - (aw_take ? write_cost : 0) + {{DEPTH{1'b0}}, fill};
      unanswered <= unanswered + {{(ADDR-1){1'b0}}, aw_take} - {{(ADDR-1){1'b0}}, b_beat};
      if (fill) begin tail <= tail + 1'b1; due <= due - 1'b1; end
      if (w_beat) head <= head + 1'b1;
      if (r_beat) begin carry <= rotated; skips <= 1'b0; end
    end
endmodule
`default_nettype wire
