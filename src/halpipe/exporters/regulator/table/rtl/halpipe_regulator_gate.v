// One direction (AR or AW) of one manager: a burst passes when what is left of the window's budget covers it wholly.
//
// AXI forbids to retract VALID, so a burst that was shown to the memory before the end of a window and not taken yet
// stays shown, and is charged to the new window as well. In each window, therefore:
//     bytes first shown <= budget, always;  bytes taken <= budget, but for at most one burst that was shown before it.
`default_nettype none
module halpipe_regulator_gate (
  input  wire        clk,
  input  wire        rst_n,
  input  wire        refill,      // last cycle of a window
  input  wire [31:0] budget,      // of the window that begins, in bytes; read with refill
  input  wire        room,        // whether a further burst may be taken on (0: only what is already shown)
  input  wire        valid_i,     // from the manager
  output wire        ready_o,
  input  wire [15:0] bytes,       // length of the burst that valid_i shows
  output wire        valid_o,     // to the memory
  input  wire        ready_i,
  output wire        admit,       // the burst is shown for the first time, and charged
  output reg  [31:0] left         // what is left of the budget of this window, in bytes
);
  wire [31:0] cost = {16'd0, bytes};
  reg  shown;                     // valid_o was up in the cycle before and has not been answered
  wire covered = room & (left >= cost);
  wire passes = shown | covered;

  assign valid_o = valid_i & passes;
  assign ready_o = ready_i & passes;

  assign admit = valid_i & ~shown & covered;
  wire keep = valid_o & ~ready_i;  // shown and still waiting: charged again if the window ends here
  wire [31:0] kept = keep ? cost : 32'd0;

  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      shown <= 1'b0;
      left  <= 32'd0;
    end else begin
      shown <= keep;
      if (refill)     left <= (budget > kept) ? budget - kept : 32'd0;
      else if (admit) left <= left - cost;
    end
endmodule
`default_nettype wire
