// A channel of the DMA engine, with beats of 2 bytes, bursts of 2 beats and a buffer of 4: for all transfers and all traffic.
// Its environment takes no burst that is not wanted, brings no beat that was not requested, and answers no write before its data.
`default_nettype none
module formal_dma_channel (
  input wire clk, input wire rst_n, input wire start, input wire [3:0] source, input wire [3:0] target, input wire [3:0] bytes,
  input wire [3:0] read_log, input wire [3:0] write_log, input wire ar_take, input wire r_beat, input wire r_error,
  input wire [15:0] r_data, input wire aw_take, input wire w_beat, input wire b_beat, input wire b_error
);
  wire ends, failed, ar_want, aw_want; wire [3:0] ar_addr, aw_addr; wire [7:0] ar_len, aw_len; wire aw_end; wire [15:0] w_data;
  halpipe_dma_channel #(.ADDR(4), .SIZE(1), .BURST(2), .DEPTH(2)) dut (.*);
  (* keep *) wire running, shift, skips, fill, flush; (* keep *) wire [3:0] from, to, to_read, to_write, due, unanswered;
  (* keep *) wire [2:0] room, in_flight, filled, read_burst, write_burst; (* keep *) wire [1:0] head, tail;
  reg first = 1;
  always @(posedge clk) first <= 0;
  always @* assume (rst_n == !first);

  // What was asked for, and what the environment owes and is owed.
  reg [3:0] s0 = 0, t0 = 0, n0 = 0; reg f0 = 0;          // the transfer; whether its last target beat comes out of no new source beat
  reg [7:0] promised = 0, held = 0, answers = 0; reg [1:0] slack = 0;
  wire [7:0] source_beats = (bytes == 0) ? 8'd0 : (8'd1 + source[0] + bytes) >> 1;
  wire [7:0] target_beats = (bytes == 0) ? 8'd0 : (8'd1 + target[0] + bytes) >> 1;
  wire begins = start & !running;
  always @(posedge clk) if (rst_n) begin
    if (begins) begin
      s0 <= source; t0 <= target; n0 <= bytes; promised <= 0; held <= 0;
      f0 <= (bytes != 0) & (target_beats + (target[0] < source[0]) != source_beats); slack <= (target[0] > source[0]);
    end else begin
      promised <= promised + (aw_take ? aw_len + 8'd1 : 8'd0) - w_beat;
      held <= held + fill - w_beat;
      slack <= slack + (r_beat & !fill) - flush;
      f0 <= f0 & !flush;
    end
  end
  always @* begin
    assume (!ar_take | ar_want); assume (!aw_take | aw_want);
    assume (!r_beat | in_flight != 0); assume (!w_beat | promised != 0); assume (!b_beat | unanswered != 0);
    if (b_beat & unanswered == 6'd1) assume (promised == 0);
    if (begins) assume ({1'b0, target} + bytes <= 5'd16 & {1'b0, source} + bytes <= 5'd16);
  end
  wire [7:0] unread = (to_read == 0) ? 8'd0 : (8'd1 + from[0] + to_read) >> 1;
  wire [7:0] unwritten = (to_write == 0) ? 8'd0 : (8'd1 + to[0] + to_write) >> 1;
  wire [3:0] moved = n0 - to_read, sent = n0 - to_write;
  reg waits = 0; reg [15:0] waiting = 0;
  always @(posedge clk) begin waits <= rst_n & promised != 0 & !w_beat & !begins; waiting <= w_data; end
  always @* if (!first) begin
    idle:       assert (running | (!ar_want & !aw_want & !ends));
    if (running) begin
      credit:   assert (room + in_flight + held + slack == 8'd4);                    // a beat that comes has its place
      owed:     assert (held == filled + promised);
      place:    assert (tail == (head + held[1:0]) % 4);
      offsets:  assert (shift == t0[0] ^ s0[0]);
      slacks:   assert (slack <= 1 & (!f0 | slack == 1 | skips));
      skipped:  assert (!skips | (t0[0] < s0[0] & slack == 0 & held == 0 & (due != 0 | n0 == 0)));
      answered: assert ((promised == 0 | unanswered != 0) & unanswered <= sent);
      from_is:  assert (from == s0 + moved & to_read <= n0);
      to_is:    assert (to == t0 + sent & to_write <= n0);
      arriving: assert (due + (skips & n0 != 0) == unread + in_flight + f0);
      leaving:  assert (filled + due == unwritten);
      bounds:   assert ((read_burst == 2 | read_burst == 4) & (write_burst == 2 | write_burst == 4));
      inside:   assert (!ar_want | (ar_len < 2 & {ar_addr[1:0], 1'b0} + 2 * (ar_len + 1) * 2 <= 8));
      within:   assert (!aw_want | (aw_len < 2 & aw_addr[1:0] + (aw_len + 1) * 2 <= 4 + aw_addr[0]));
      alive:    assert (failed | ar_want | aw_want | flush | ends | in_flight != 0 | unanswered != 0);
      whole:    assert (!ends | failed | (held == 0 & to_read == 0 & due == 0));
    end
    stays:      assert (!waits | w_data == waiting);
  end
endmodule
`default_nettype wire
