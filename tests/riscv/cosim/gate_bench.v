// A manager behind the gate of a regulator: transfers in bursts of 64 bytes, 8 bytes a cycle, one after the other. Windows have
// 40 cycles; a burst costs whole beats, as in the unit. For each transfer the cycle is printed in which it is over.
`default_nettype none
module gate_bench;
  reg clk = 0, rst_n = 0;
  reg [31:0] budgets [0:1023];
  reg [31:0] transfers [0:2047];     // pause and size of each
  integer windows, count, cycle = 0, number = 0, free = 0, left = 0;
  reg is_moving = 0;

  wire refill = (cycle + 41) % 40 == 0;
  wire [31:0] next = (cycle + 1) / 40;
  wire [31:0] budget = next < windows ? budgets[next] : 0;
  wire [15:0] bytes = left > 64 ? 64 : left;
  wire valid = is_moving && cycle >= free;
  wire ready, shown;
  halpipe_regulator_gate gate (
    .clk(clk), .rst_n(rst_n), .refill(refill), .budget(budget), .room(1'b1), .valid_i(valid), .ready_o(ready),
    .bytes((bytes + 16'd7) & 16'hfff8), .valid_o(shown), .ready_i(1'b1), .admit(), .left());

  task begin_next;  // the next transfer, from the cycle `free` on
    if (number == count) $finish;
    else begin
      free = free + transfers[2 * number];
      left = transfers[2 * number + 1];
      is_moving = 1;
      number = number + 1;
    end
  endtask

  initial begin
    if (!$value$plusargs("windows=%d", windows) || !$value$plusargs("transfers=%d", count)) $finish;
    $readmemh("budgets.hex", budgets, 0, windows - 1);
    $readmemh("transfers.hex", transfers, 0, 2 * count - 1);
    cycle = -2;
    #1 clk = 1; #1 clk = 0;
    rst_n = 1;
    begin_next;
    for (cycle = -1; cycle < 40 * windows; cycle = cycle + 1) begin
      #1;
      if (valid && ready) begin
        free = cycle + (bytes + 7) / 8;
        left = left - bytes;
        if (left == 0) begin
          $display("%0d", free);
          clk = 1; #1 clk = 0;  // the gate sees the burst before the next transfer is shown
          begin_next;
        end else begin
          clk = 1; #1 clk = 0;
        end
      end else begin
        clk = 1; #1 clk = 0;
      end
    end
    $finish;
  end
endmodule
`default_nettype wire
