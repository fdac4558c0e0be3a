// Register stage of one AXI channel: VALID, READY and the payload leave it from registers, at one transfer in a cycle.
`default_nettype none
module halpipe_regulator_slice #(
  parameter integer WIDTH = 8
)(
  input  wire             clk,
  input  wire             rst_n,
  input  wire             s_valid, output wire             s_ready, input  wire [WIDTH-1:0] s_data,
  output reg              m_valid, input  wire             m_ready, output reg  [WIDTH-1:0] m_data
);
  reg             spare;               // taken while the output was not
  reg [WIDTH-1:0] kept;
  assign s_ready = ~spare;
  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      spare <= 1'b0; kept <= 0; m_valid <= 1'b0; m_data <= 0;
    end else if (~m_valid | m_ready) begin
      m_valid <= spare | s_valid; m_data <= spare ? kept : s_data; spare <= 1'b0;
    end else if (s_valid & s_ready) begin
      spare <= 1'b1; kept <= s_data;
    end
endmodule
`default_nettype wire
