// The clock, for Icarus Verilog.
`default_nettype none
module clocked #(
  parameter integer UNITS  = 4,
  parameter integer DEPTH  = 1024,
  parameter integer TABLES = 16,
  parameter integer SIZE = 3,
  parameter integer FIRST  = 64
)();
  reg clk = 0;
  always #1 clk = ~clk;
  bench #(.UNITS(UNITS), .DEPTH(DEPTH), .TABLES(TABLES), .SIZE(SIZE), .FIRST(FIRST)) bench (.clk(clk));
endmodule
`default_nettype wire
