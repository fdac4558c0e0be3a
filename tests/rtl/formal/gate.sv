// What a gate must do, for all traffic and budgets. `left` and `shown` are the registers of the gate itself.
`default_nettype none
module formal_gate (
  input wire clk, input wire rst_n, input wire refill, input wire [31:0] budget, input wire room,
  input wire valid_i, input wire [15:0] bytes, input wire ready_i
);
  wire ready_o, valid_o, admit;
  wire [31:0] left;
  halpipe_regulator_gate dut (
    .clk(clk), .rst_n(rst_n), .refill(refill), .budget(budget), .room(room), .valid_i(valid_i), .ready_o(ready_o),
    .bytes(bytes), .valid_o(valid_o), .ready_i(ready_i), .admit(admit), .left(left));
  reg first = 1;
  always @(posedge clk) first <= 0;
  always @* assume (rst_n == !first);

  // The manager keeps to AXI: what it shows, it goes on showing. A burst has a beat at least.
  reg asked = 0; reg [15:0] asked_bytes = 0;
  always @(posedge clk) begin asked <= valid_i & ~ready_o & rst_n; asked_bytes <= bytes; end
  always @* if (asked) assume (valid_i & bytes == asked_bytes);
  always @* if (valid_i) assume (bytes != 0);

  // A window of its own: charged are bytes first shown in it and what was waiting before it; taken is what memory took.
  reg [32:0] charged = 0, taken = 0, most = 0;
  reg waits = 0; reg [15:0] waiting = 0;
  wire fresh = valid_o & ~waits;
  wire [32:0] charged_now = charged + (fresh ? bytes : 0);
  wire [32:0] taken_now = taken + ((valid_o & ready_i) ? bytes : 0);
  wire [32:0] carried = (valid_o & ~ready_i) ? bytes : 0;
  always @(posedge clk) begin
    waits <= valid_o & ~ready_i & rst_n; waiting <= bytes;
    if (!rst_n) begin charged <= 0; taken <= 0; most <= 0; end
    else if (refill) begin charged <= carried; taken <= 0; most <= (budget > carried) ? budget : carried; end
    else begin charged <= charged_now; taken <= taken_now; end
  end
  always @* if (!first) begin
    bounded:    assert (charged_now <= most);           // the budget of the window, or a burst that was waiting before it
    served:     assert (taken_now <= most);
    kept:       assert (!waits | (valid_o & bytes == waiting));
    admits:     assert (admit == fresh);
    progress:   assert (!(valid_i & room & (left >= bytes)) | valid_o);
    closed:     assert (!(fresh & (!room | (left < bytes))));
    honest:     assert (!valid_o | valid_i);
    both_sides: assert ((valid_i & ready_o) == (valid_o & ready_i));
    remainder:  assert ({1'b0, left} + charged == most); // nothing of the budget is lost: what is left is all the rest
    ledger:     assert (taken + (waits ? waiting : 0) == charged);
    pending:    assert (!waits | asked);
  end
endmodule
`default_nettype wire
