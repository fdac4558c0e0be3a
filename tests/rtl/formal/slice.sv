// What a register stage must do: each transfer leaves once, unchanged and in order, and what it shows stays until it is taken.
`default_nettype none
module formal_slice (
  input wire clk, input wire rst_n, input wire s_valid, input wire [3:0] s_data, input wire m_ready
);
  wire s_ready, m_valid; wire [3:0] m_data;
  halpipe_regulator_slice #(.WIDTH(4)) dut (
    .clk(clk), .rst_n(rst_n), .s_valid(s_valid), .s_ready(s_ready), .s_data(s_data), .m_valid(m_valid), .m_ready(m_ready), .m_data(m_data));
  (* keep *) wire spare; (* keep *) wire [3:0] kept;
  reg first = 1;
  always @(posedge clk) first <= 0;
  always @* assume (rst_n == !first);
  // A queue of two, oldest first.
  reg [1:0] count = 0; reg [3:0] older = 0, newer = 0;
  wire in = s_valid & s_ready, out = m_valid & m_ready;
  wire [1:0] left = count - {1'b0, out};
  always @(posedge clk)
    if (!rst_n) count <= 0;
    else begin
      count <= left + {1'b0, in};
      if (out) older <= newer;
      if (in) begin if (left == 0) older <= s_data; else newer <= s_data; end
    end
  always @* if (!first) begin
    holds:  assert (count <= 2 & m_valid == (count != 0) & spare == (count == 2));
    oldest: assert (count == 0 | m_data == older);
    second: assert (count != 2 | kept == newer);
    room:   assert (s_ready == (count != 2));
  end
endmodule
`default_nettype wire
