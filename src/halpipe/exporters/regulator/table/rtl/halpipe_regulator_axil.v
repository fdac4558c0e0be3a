// Puts the registers of halpipe_regulator behind AXI4-Lite (32 bit). One access at a time, a write before a read.
// A write takes effect in the cycle in which its address and data are taken. A write of part of a word, and one that the
// registers refuse, changes nothing and is answered with SLVERR.
`default_nettype none
module halpipe_regulator_axil (
  input  wire        clk,
  input  wire        rst_n,
  input  wire        s_awvalid, output wire        s_awready, input  wire [25:0] s_awaddr,
  input  wire        s_wvalid,  output wire        s_wready,  input  wire [31:0] s_wdata, input wire [3:0] s_wstrb,
  output reg         s_bvalid,  input  wire        s_bready,  output reg  [1:0]  s_bresp,
  input  wire        s_arvalid, output wire        s_arready, input  wire [25:0] s_araddr,
  output reg         s_rvalid,  input  wire        s_rready,  output reg  [31:0] s_rdata, output wire [1:0] s_rresp,
  // to halpipe_regulator, or to the arbiter of several ports
  output wire        asks,               // an access could be made in this cycle,
  input  wire        grant,              // and is
  input  wire        reg_refused,        // the write of this cycle changes nothing
  output wire        reg_write,
  output wire [25:0] reg_addr,
  output wire [31:0] reg_wdata,
  input  wire [31:0] reg_rdata
);
  wire may_write = s_awvalid & s_wvalid & (~s_bvalid | s_bready);
  wire may_read = s_arvalid & ~may_write & (~s_rvalid | s_rready);
  assign asks = may_write | may_read;
  wire writes = may_write & grant;
  wire reads = may_read & grant;
  assign s_awready = writes;
  assign s_wready = writes;
  assign s_arready = reads;
  assign s_rresp = 2'b00;
  assign reg_write = writes & (s_wstrb == 4'hf);
  assign reg_addr = may_write ? s_awaddr : s_araddr;
  assign reg_wdata = s_wdata;
  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      s_bvalid <= 1'b0; s_bresp <= 2'b00; s_rvalid <= 1'b0; s_rdata <= 32'd0;
    end else begin
      if (writes) begin
        s_bvalid <= 1'b1; s_bresp <= ((s_wstrb == 4'hf) & ~reg_refused) ? 2'b00 : 2'b10;
      end else if (s_bready) s_bvalid <= 1'b0;
      if (reads) begin
        s_rvalid <= 1'b1; s_rdata <= reg_rdata;
      end else if (s_rready) s_rvalid <= 1'b0;
    end
endmodule
`default_nettype wire
