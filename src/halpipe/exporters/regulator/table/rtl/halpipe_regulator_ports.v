// Joins one or two AXI4-Lite ports in front of the registers of halpipe_regulator: one access in a cycle. Where both ask,
// they take turns, so that a port waits for one access of the other at most, whatever the other does.
`default_nettype none
module halpipe_regulator_ports #(
  parameter integer PORTS = 1          // 1 or 2, port 0 lowest
)(
  input  wire                clk,
  input  wire                rst_n,
  input  wire [PORTS-1:0]    s_awvalid, output wire [PORTS-1:0]    s_awready, input  wire [26*PORTS-1:0] s_awaddr,
  input  wire [PORTS-1:0]    s_wvalid,  output wire [PORTS-1:0]    s_wready,  input  wire [32*PORTS-1:0] s_wdata,
  input  wire [4*PORTS-1:0]  s_wstrb,
  output wire [PORTS-1:0]    s_bvalid,  input  wire [PORTS-1:0]    s_bready,  output wire [2*PORTS-1:0]  s_bresp,
  input  wire [PORTS-1:0]    s_arvalid, output wire [PORTS-1:0]    s_arready, input  wire [26*PORTS-1:0] s_araddr,
  output wire [PORTS-1:0]    s_rvalid,  input  wire [PORTS-1:0]    s_rready,  output wire [32*PORTS-1:0] s_rdata,
  output wire [2*PORTS-1:0]  s_rresp,
  // to halpipe_regulator
  output wire                reg_port,
  output wire                reg_write,
  output wire [25:0]         reg_addr,
  output wire [31:0]         reg_wdata,
  input  wire [31:0]         reg_rdata,
  input  wire                reg_refused
);
  wire [1:0] asks, write;
  wire [51:0] addr; wire [63:0] wdata;
  reg  turn;                           // the port that goes first when both ask
  assign reg_port = asks[1] & (~asks[0] | turn);
  always @(posedge clk or negedge rst_n)
    if (!rst_n) turn <= 1'b0;
    else if (&asks) turn <= ~turn;
  assign reg_write = |write;
  assign reg_addr = reg_port ? addr[51:26] : addr[25:0];
  assign reg_wdata = reg_port ? wdata[63:32] : wdata[31:0];

  genvar i;
  generate for (i = 0; i < 2; i = i + 1) begin : port
    if (i < PORTS) begin : used
      halpipe_regulator_axil axil (
        .clk(clk), .rst_n(rst_n), .s_awvalid(s_awvalid[i]), .s_awready(s_awready[i]), .s_awaddr(s_awaddr[26*i +: 26]),
        .s_wvalid(s_wvalid[i]), .s_wready(s_wready[i]), .s_wdata(s_wdata[32*i +: 32]), .s_wstrb(s_wstrb[4*i +: 4]),
        .s_bvalid(s_bvalid[i]), .s_bready(s_bready[i]), .s_bresp(s_bresp[2*i +: 2]),
        .s_arvalid(s_arvalid[i]), .s_arready(s_arready[i]), .s_araddr(s_araddr[26*i +: 26]),
        .s_rvalid(s_rvalid[i]), .s_rready(s_rready[i]), .s_rdata(s_rdata[32*i +: 32]), .s_rresp(s_rresp[2*i +: 2]),
        .asks(asks[i]), .grant((i == 0) ? ~reg_port : reg_port), .reg_refused(reg_refused),
        .reg_write(write[i]), .reg_addr(addr[26*i +: 26]), .reg_wdata(wdata[32*i +: 32]), .reg_rdata(reg_rdata));
    end else begin : absent
      assign {asks[i], write[i], addr[26*i +: 26], wdata[32*i +: 32]} = 60'd0;
    end
  end endgenerate
endmodule
`default_nettype wire
