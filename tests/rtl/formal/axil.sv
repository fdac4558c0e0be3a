// What stands between AXI4-Lite and the registers: whole words, once each, answers that wait to be taken.
`default_nettype none
module formal_axil (
  input wire clk, input wire rst_n, input wire s_awvalid, input wire [25:0] s_awaddr, input wire s_wvalid,
  input wire [31:0] s_wdata, input wire [3:0] s_wstrb, input wire s_bready, input wire s_arvalid,
  input wire [25:0] s_araddr, input wire s_rready, input wire [31:0] reg_rdata,
  input wire grant, input wire reg_refused
);
  wire s_awready, s_wready, s_bvalid, s_arready, s_rvalid, reg_write, asks;
  wire [1:0] s_bresp, s_rresp; wire [31:0] s_rdata, reg_wdata; wire [25:0] reg_addr;
  halpipe_regulator_axil dut (
    .clk(clk), .rst_n(rst_n), .s_awvalid(s_awvalid), .s_awready(s_awready), .s_awaddr(s_awaddr), .s_wvalid(s_wvalid),
    .s_wready(s_wready), .s_wdata(s_wdata), .s_wstrb(s_wstrb), .s_bvalid(s_bvalid), .s_bready(s_bready),
    .s_bresp(s_bresp), .s_arvalid(s_arvalid), .s_arready(s_arready), .s_araddr(s_araddr), .s_rvalid(s_rvalid),
    .s_rready(s_rready), .s_rdata(s_rdata), .s_rresp(s_rresp), .reg_write(reg_write), .reg_addr(reg_addr),
    .reg_wdata(reg_wdata), .reg_rdata(reg_rdata), .asks(asks), .grant(grant), .reg_refused(reg_refused));
  reg first = 1;
  always @(posedge clk) first <= 0;
  always @* assume (rst_n == !first);
  wire written = s_awvalid & s_awready, read = s_arvalid & s_arready, whole = s_wstrb == 4'hf;
  reg m_b = 0, m_r = 0, m_ok = 0; reg [31:0] m_data = 0;
  always @(posedge clk)
    if (!rst_n) begin m_b <= 0; m_r <= 0; end
    else begin
      if (written) begin m_b <= 1; m_ok <= whole & !reg_refused; end else if (s_bready) m_b <= 0;
      if (read) begin m_r <= 1; m_data <= reg_rdata; end else if (s_rready) m_r <= 0;
    end
  always @* if (!first) begin
    paired:  assert (written == (s_wvalid & s_wready));
    whole_:  assert (reg_write == (written & whole));
    placed:  assert (!reg_write | (reg_addr == s_awaddr & reg_wdata == s_wdata));
    aimed:   assert (!read | (reg_addr == s_araddr & !written));
    replied: assert (s_bvalid == m_b & (!m_b | s_bresp == (m_ok ? 2'b00 : 2'b10)));
    given:   assert (s_rvalid == m_r & (!m_r | (s_rdata == m_data & s_rresp == 2'b00)));
    unhurt:  assert (!(written & m_b & !s_bready) & !(read & m_r & !s_rready));
    asked:   assert (asks | !(s_awvalid & s_wvalid & !s_bvalid | s_arvalid & !s_rvalid));
    granted: assert ((written | read) == (asks & grant));
    only:    assert (!asks | s_awvalid & s_wvalid | s_arvalid);
    first_:  assert (!(s_awvalid & s_wvalid & !s_bvalid) | !read);
  end
endmodule
`default_nettype wire
