// Two ports for registers: one access in a cycle, each of them that of one port, and none waits for more than one of the other.
`default_nettype none
module formal_ports (
  input wire clk, input wire rst_n, input wire [1:0] s_awvalid, input wire [51:0] s_awaddr, input wire [1:0] s_wvalid,
  input wire [63:0] s_wdata, input wire [7:0] s_wstrb, input wire [1:0] s_bready, input wire [1:0] s_arvalid,
  input wire [51:0] s_araddr, input wire [1:0] s_rready, input wire [31:0] reg_rdata, input wire reg_refused
);
  wire [1:0] s_awready, s_wready, s_bvalid, s_arready, s_rvalid; wire [3:0] s_bresp, s_rresp; wire [63:0] s_rdata;
  wire reg_port, reg_write; wire [25:0] reg_addr; wire [31:0] reg_wdata;
  halpipe_regulator_ports #(.PORTS(2)) dut (
    .clk(clk), .rst_n(rst_n), .s_awvalid(s_awvalid), .s_awready(s_awready), .s_awaddr(s_awaddr), .s_wvalid(s_wvalid),
    .s_wready(s_wready), .s_wdata(s_wdata), .s_wstrb(s_wstrb), .s_bvalid(s_bvalid), .s_bready(s_bready), .s_bresp(s_bresp),
    .s_arvalid(s_arvalid), .s_arready(s_arready), .s_araddr(s_araddr), .s_rvalid(s_rvalid), .s_rready(s_rready),
    .s_rdata(s_rdata), .s_rresp(s_rresp), .reg_port(reg_port), .reg_write(reg_write), .reg_addr(reg_addr),
    .reg_wdata(reg_wdata), .reg_rdata(reg_rdata), .reg_refused(reg_refused));
  (* keep *) wire turn;
  reg first = 1;
  always @(posedge clk) first <= 0;
  always @* assume (rst_n == !first);
  wire [1:0] writes = s_awvalid & s_awready, reads = s_arvalid & s_arready, served = writes | reads;
  // an access that its port can make: its address, and data, are shown, and no answer is left behind
  wire [1:0] able = (s_awvalid & s_wvalid & ~s_bvalid) | (s_arvalid & ~s_rvalid & ~(s_awvalid & s_wvalid));
  reg [1:0] passed_over = 0; reg [1:0] write_ = 0, read_ = 0; reg ok = 0; reg [31:0] data = 0;
  always @(posedge clk) begin
    passed_over <= rst_n ? able & ~served : 2'b00;
    write_ <= rst_n ? writes : 2'b00; read_ <= rst_n ? reads : 2'b00;
    ok <= reg_write & !reg_refused; data <= reg_rdata;
  end
  // AXI: what is shown stays
  reg [1:0] aw_ = 0, w_ = 0, ar_ = 0;
  always @(posedge clk) begin
    aw_ <= s_awvalid & ~s_awready; w_ <= s_wvalid & ~s_wready; ar_ <= s_arvalid & ~s_arready;
  end
  always @* assume (((aw_ & ~s_awvalid) | (w_ & ~s_wvalid) | (ar_ & ~s_arvalid)) == 0);
    wire [1:0] turns_holds;
  wire [1:0] mine_holds;
  wire [1:0] placed_holds;
  wire [1:0] aimed_holds;
  wire [1:0] replied_holds;
  wire [1:0] given_holds;
  genvar i;
  generate for (i = 0; i < 2; i = i + 1) begin : each
    assign turns_holds[i] = !(passed_over[i] & able[i]) | served[i] | !served[1-i] | turn == i;
    assign mine_holds[i] = !served[i] | reg_port == i;
    assign placed_holds[i] = !writes[i] | (reg_addr == s_awaddr[26*i +: 26] & reg_wdata == s_wdata[32*i +: 32] & reg_write == (s_wstrb[4*i +: 4] == 4'hf));
    assign aimed_holds[i] = !reads[i] | reg_addr == s_araddr[26*i +: 26];
    assign replied_holds[i] = !write_[i] | (s_bvalid[i] & s_bresp[2*i +: 2] == (ok ? 2'b00 : 2'b10));
    assign given_holds[i] = !read_[i] | (s_rvalid[i] & s_rdata[32*i +: 32] == data & s_rresp[2*i +: 2] == 2'b00);
  end endgenerate
  always @* if (!first) begin
    turns: assert (&turns_holds);
    mine: assert (&mine_holds);
    placed: assert (&placed_holds);
    aimed: assert (&aimed_holds);
    replied: assert (&replied_holds);
    given: assert (&given_holds);
    one:    assert (served != 2'b11 & (writes & reads) == 0);
    none:   assert (!reg_write | writes != 0);
    busy:   assert (able == 0 | served != 0);
    second: assert (!(passed_over[0] & able[0]) | served[0]);
    other:  assert (!(passed_over[1] & able[1]) | served[1]);
    after:  assert ((!passed_over[0] | !turn) & (!passed_over[1] | turn));
  end
endmodule
`default_nettype wire
