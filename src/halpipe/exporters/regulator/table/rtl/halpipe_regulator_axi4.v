// The regulators with whole AXI4 ports, manager's side (s_) and memory's side (m_), unit 0 lowest; registers behind AXI4-Lite.
// A burst that never passes is refused with SLVERR (halpipe_regulator_refusal); other answers pass. With BUFFER, data of writes is held back until a burst is whole (halpipe_regulator_store). With STAGE,
// a register stage takes what the managers send: READY then depends on no comparison of a budget, and a burst comes a cycle
// later. With PORTS = 2 there are two AXI4-Lite ports for registers, and LOCK says whose writes count.
`default_nettype none
module halpipe_regulator_axi4 #(
  parameter integer UNITS  = 4,
  parameter integer DEPTH  = 1024,
  parameter integer TABLES = 16,
  parameter integer BANKS  = 1,
  parameter integer PORTS  = 1,          // AXI4-Lite ports for registers, 1 or 2; port 0 lowest
  parameter integer SIZE   = 3,          // log2 of the bytes of a beat of the bus, 0 to 7
  parameter [31:0]  CYCLES = 32'd4096,
  parameter         IMAGES = "",
  parameter integer ADDR   = 40,
  parameter integer ID     = 4,
  parameter integer BUFFER = 16,         // beats of the write buffer of a unit, a power of two; 0: none
  parameter integer STAGE  = 0,          // 1: a register stage in front of each unit
  parameter integer DATA   = 8 << SIZE   // follows from SIZE
)(
  input  wire                    clk,
  input  wire                    rst_n,
  input  wire [63:0]             now,    // the time base that START counts in
  output wire                    tick,
  // blocks of other memories, which one request switches in the same cycle; 0 where there are none
  input  wire                    link_valid_i,  output wire         link_valid_o,
  input  wire [7:0]              link_table_i,  output wire [7:0]   link_table_o,
  input  wire                    link_barred_i, output wire         link_barred_o,
  // registers
  input  wire [PORTS-1:0]        l_awvalid, output wire [PORTS-1:0]    l_awready, input  wire [26*PORTS-1:0] l_awaddr,
  input  wire [PORTS-1:0]        l_wvalid,  output wire [PORTS-1:0]    l_wready,  input  wire [32*PORTS-1:0] l_wdata,
  input  wire [4*PORTS-1:0]      l_wstrb,
  output wire [PORTS-1:0]        l_bvalid,  input  wire [PORTS-1:0]    l_bready,  output wire [2*PORTS-1:0]  l_bresp,
  input  wire [PORTS-1:0]        l_arvalid, output wire [PORTS-1:0]    l_arready, input  wire [26*PORTS-1:0] l_araddr,
  output wire [PORTS-1:0]        l_rvalid,  input  wire [PORTS-1:0]    l_rready,  output wire [32*PORTS-1:0] l_rdata,
  output wire [2*PORTS-1:0]      l_rresp,
  // addresses of writes
  input  wire [UNITS-1:0]        s_awvalid, output wire [UNITS-1:0]        s_awready,
  output wire [UNITS-1:0]        m_awvalid, input  wire [UNITS-1:0]        m_awready,
  input  wire [ID*UNITS-1:0]     s_awid,    output wire [ID*UNITS-1:0]     m_awid,
  input  wire [ADDR*UNITS-1:0]   s_awaddr,  output wire [ADDR*UNITS-1:0]   m_awaddr,
  input  wire [8*UNITS-1:0]      s_awlen,   output wire [8*UNITS-1:0]      m_awlen,
  input  wire [3*UNITS-1:0]      s_awsize,  output wire [3*UNITS-1:0]      m_awsize,
  input  wire [2*UNITS-1:0]      s_awburst, output wire [2*UNITS-1:0]      m_awburst,
  input  wire [UNITS-1:0]        s_awlock,  output wire [UNITS-1:0]        m_awlock,
  input  wire [4*UNITS-1:0]      s_awcache, output wire [4*UNITS-1:0]      m_awcache,
  input  wire [3*UNITS-1:0]      s_awprot,  output wire [3*UNITS-1:0]      m_awprot,
  input  wire [4*UNITS-1:0]      s_awqos,   output wire [4*UNITS-1:0]      m_awqos,
  // data of writes
  input  wire [UNITS-1:0]        s_wvalid,  output wire [UNITS-1:0]        s_wready,
  output wire [UNITS-1:0]        m_wvalid,  input  wire [UNITS-1:0]        m_wready,
  input  wire [DATA*UNITS-1:0]   s_wdata,   output wire [DATA*UNITS-1:0]   m_wdata,
  input  wire [DATA/8*UNITS-1:0] s_wstrb,   output wire [DATA/8*UNITS-1:0] m_wstrb,
  input  wire [UNITS-1:0]        s_wlast,   output wire [UNITS-1:0]        m_wlast,
  // answers to writes
  output wire [UNITS-1:0]        s_bvalid,  input  wire [UNITS-1:0]        s_bready,
  input  wire [UNITS-1:0]        m_bvalid,  output wire [UNITS-1:0]        m_bready,
  output wire [ID*UNITS-1:0]     s_bid,     input  wire [ID*UNITS-1:0]     m_bid,
  output wire [2*UNITS-1:0]      s_bresp,   input  wire [2*UNITS-1:0]      m_bresp,
  // addresses of reads
  input  wire [UNITS-1:0]        s_arvalid, output wire [UNITS-1:0]        s_arready,
  output wire [UNITS-1:0]        m_arvalid, input  wire [UNITS-1:0]        m_arready,
  input  wire [ID*UNITS-1:0]     s_arid,    output wire [ID*UNITS-1:0]     m_arid,
  input  wire [ADDR*UNITS-1:0]   s_araddr,  output wire [ADDR*UNITS-1:0]   m_araddr,
  input  wire [8*UNITS-1:0]      s_arlen,   output wire [8*UNITS-1:0]      m_arlen,
  input  wire [3*UNITS-1:0]      s_arsize,  output wire [3*UNITS-1:0]      m_arsize,
  input  wire [2*UNITS-1:0]      s_arburst, output wire [2*UNITS-1:0]      m_arburst,
  input  wire [UNITS-1:0]        s_arlock,  output wire [UNITS-1:0]        m_arlock,
  input  wire [4*UNITS-1:0]      s_arcache, output wire [4*UNITS-1:0]      m_arcache,
  input  wire [3*UNITS-1:0]      s_arprot,  output wire [3*UNITS-1:0]      m_arprot,
  input  wire [4*UNITS-1:0]      s_arqos,   output wire [4*UNITS-1:0]      m_arqos,
  // data of reads
  output wire [UNITS-1:0]        s_rvalid,  input  wire [UNITS-1:0]        s_rready,
  input  wire [UNITS-1:0]        m_rvalid,  output wire [UNITS-1:0]        m_rready,
  output wire [ID*UNITS-1:0]     s_rid,     input  wire [ID*UNITS-1:0]     m_rid,
  output wire [DATA*UNITS-1:0]   s_rdata,   input  wire [DATA*UNITS-1:0]   m_rdata,
  output wire [2*UNITS-1:0]      s_rresp,   input  wire [2*UNITS-1:0]      m_rresp,
  output wire [UNITS-1:0]        s_rlast,   input  wire [UNITS-1:0]        m_rlast
);
  // ---------------------------------------------------------------------------------------------- stages, write buffers and refusals
  localparam integer INFO = ID + ADDR + 25;   // of an address: length highest, so that the buffer finds it
  localparam integer BEAT = DATA + DATA / 8 + 1;
  wire [UNITS-1:0] arvalid, arready, awvalid, awready, wvalid, wready, ar_long, aw_long;   // in front of the units
  genvar i;
  generate for (i = 0; i < UNITS; i = i + 1) begin : manager
    wire [INFO-1:0] ar_in = {s_arlen[8*i +: 8], s_arid[ID*i +: ID], s_araddr[ADDR*i +: ADDR], s_arsize[3*i +: 3],
                             s_arburst[2*i +: 2], s_arlock[i], s_arcache[4*i +: 4], s_arprot[3*i +: 3], s_arqos[4*i +: 4]};
    wire [INFO-1:0] aw_in = {s_awlen[8*i +: 8], s_awid[ID*i +: ID], s_awaddr[ADDR*i +: ADDR], s_awsize[3*i +: 3],
                             s_awburst[2*i +: 2], s_awlock[i], s_awcache[4*i +: 4], s_awprot[3*i +: 3], s_awqos[4*i +: 4]};
    wire [BEAT-1:0] w_in = {s_wlast[i], s_wstrb[DATA/8*i +: DATA/8], s_wdata[DATA*i +: DATA]};
    wire [INFO-1:0] ar, aw, aw_out; wire [BEAT-1:0] w, w_out;
    wire ar_valid, ar_ready, aw_valid, aw_ready, w_valid, w_ready, whole_valid, whole_ready, beat_valid, beat_ready;
    assign {m_arlen[8*i +: 8], m_arid[ID*i +: ID], m_araddr[ADDR*i +: ADDR], m_arsize[3*i +: 3],
            m_arburst[2*i +: 2], m_arlock[i], m_arcache[4*i +: 4], m_arprot[3*i +: 3], m_arqos[4*i +: 4]} = ar;
    assign {m_awlen[8*i +: 8], m_awid[ID*i +: ID], m_awaddr[ADDR*i +: ADDR], m_awsize[3*i +: 3],
            m_awburst[2*i +: 2], m_awlock[i], m_awcache[4*i +: 4], m_awprot[3*i +: 3], m_awqos[4*i +: 4]} = aw_out;
    assign {m_wlast[i], m_wstrb[DATA/8*i +: DATA/8], m_wdata[DATA*i +: DATA]} = w_out;
    if (STAGE != 0) begin : staged
      halpipe_regulator_slice #(.WIDTH(INFO)) reads (
        .clk(clk), .rst_n(rst_n), .s_valid(s_arvalid[i]), .s_ready(s_arready[i]), .s_data(ar_in),
        .m_valid(ar_valid), .m_ready(ar_ready), .m_data(ar));
      halpipe_regulator_slice #(.WIDTH(INFO)) writes (
        .clk(clk), .rst_n(rst_n), .s_valid(s_awvalid[i]), .s_ready(s_awready[i]), .s_data(aw_in),
        .m_valid(aw_valid), .m_ready(aw_ready), .m_data(aw));
      halpipe_regulator_slice #(.WIDTH(BEAT)) beats (
        .clk(clk), .rst_n(rst_n), .s_valid(s_wvalid[i]), .s_ready(s_wready[i]), .s_data(w_in),
        .m_valid(w_valid), .m_ready(w_ready), .m_data(w));
    end else begin : direct
      assign {ar_valid, s_arready[i], ar} = {s_arvalid[i], ar_ready, ar_in};
      assign {aw_valid, s_awready[i], aw} = {s_awvalid[i], aw_ready, aw_in};
      assign {w_valid, s_wready[i], w} = {s_wvalid[i], w_ready, w_in};
    end
    if (BUFFER != 0) begin : buffered
      halpipe_regulator_store #(.BEATS(BUFFER), .BEAT(BEAT), .INFO(INFO)) store (
        .clk(clk), .rst_n(rst_n), .s_awvalid(aw_valid), .s_awready(aw_ready), .s_aw(aw),
        .s_wvalid(w_valid), .s_wready(w_ready), .s_w(w),
        .m_awvalid(whole_valid), .m_awready(whole_ready), .m_aw(aw_out),
        .m_wvalid(beat_valid), .m_wready(beat_ready), .m_w(w_out));
    end else begin : plain
      assign {whole_valid, aw_ready, aw_out} = {aw_valid, whole_ready, aw};
      assign {beat_valid, w_ready, w_out} = {w_valid, beat_ready, w};
    end
    halpipe_regulator_refusal #(.ID(ID), .DATA(DATA)) refusal (
      .clk(clk), .rst_n(rst_n), .s_awvalid(whole_valid), .s_awready(whole_ready), .s_awid(m_awid[ID*i +: ID]),
      .m_awvalid(awvalid[i]), .m_awready(awready[i]), .aw_long(aw_long[i]), .s_wvalid(beat_valid), .s_wready(beat_ready),
      .s_wlast(m_wlast[i]), .m_wvalid(wvalid[i]), .m_wready(wready[i]), .s_bvalid(s_bvalid[i]), .s_bready(s_bready[i]),
      .s_bid(s_bid[ID*i +: ID]), .s_bresp(s_bresp[2*i +: 2]), .m_bvalid(m_bvalid[i]), .m_bready(m_bready[i]),
      .m_bid(m_bid[ID*i +: ID]), .m_bresp(m_bresp[2*i +: 2]), .s_arvalid(ar_valid), .s_arready(ar_ready),
      .s_arid(m_arid[ID*i +: ID]), .s_arlen(m_arlen[8*i +: 8]), .m_arvalid(arvalid[i]), .m_arready(arready[i]),
      .ar_long(ar_long[i]), .s_rvalid(s_rvalid[i]), .s_rready(s_rready[i]), .s_rid(s_rid[ID*i +: ID]),
      .s_rresp(s_rresp[2*i +: 2]), .s_rdata(s_rdata[DATA*i +: DATA]), .s_rlast(s_rlast[i]), .m_rvalid(m_rvalid[i]),
      .m_rready(m_rready[i]), .m_rid(m_rid[ID*i +: ID]), .m_rresp(m_rresp[2*i +: 2]), .m_rdata(m_rdata[DATA*i +: DATA]),
      .m_rlast(m_rlast[i]));
  end endgenerate

  // ---------------------------------------------------------------------------------------------- regulators
  wire reg_port, reg_write, reg_refused; wire [25:0] reg_addr; wire [31:0] reg_wdata, reg_rdata;
  halpipe_regulator_ports #(.PORTS(PORTS)) registers (
    .clk(clk), .rst_n(rst_n), .s_awvalid(l_awvalid), .s_awready(l_awready), .s_awaddr(l_awaddr), .s_wvalid(l_wvalid),
    .s_wready(l_wready), .s_wdata(l_wdata), .s_wstrb(l_wstrb), .s_bvalid(l_bvalid), .s_bready(l_bready), .s_bresp(l_bresp),
    .s_arvalid(l_arvalid), .s_arready(l_arready), .s_araddr(l_araddr), .s_rvalid(l_rvalid), .s_rready(l_rready),
    .s_rdata(l_rdata), .s_rresp(l_rresp), .reg_port(reg_port), .reg_refused(reg_refused),
    .reg_write(reg_write), .reg_addr(reg_addr), .reg_wdata(reg_wdata), .reg_rdata(reg_rdata));
  halpipe_regulator #(
    .UNITS(UNITS), .DEPTH(DEPTH), .TABLES(TABLES), .BANKS(BANKS), .PORTS(PORTS), .SIZE(SIZE), .BUFFER(BUFFER), .CYCLES(CYCLES), .IMAGES(IMAGES)
  ) regulators (
    .clk(clk), .rst_n(rst_n), .now(now), .reg_port(reg_port), .reg_refused(reg_refused),
    .link_valid_i(link_valid_i), .link_valid_o(link_valid_o), .link_table_i(link_table_i), .link_table_o(link_table_o),
    .link_barred_i(link_barred_i), .link_barred_o(link_barred_o),
    .reg_write(reg_write), .reg_addr(reg_addr), .reg_wdata(reg_wdata), .reg_rdata(reg_rdata), .tick(tick),
    .s_arvalid(arvalid), .s_arready(arready), .m_arvalid(m_arvalid), .m_arready(m_arready),
    .s_awvalid(awvalid), .s_awready(awready), .m_awvalid(m_awvalid), .m_awready(m_awready),
    .s_wvalid(wvalid), .s_wready(wready), .m_wvalid(m_wvalid), .m_wready(m_wready), .s_wlast(m_wlast),
    .arlen(m_arlen), .ar_long(ar_long), .awlen(m_awlen), .aw_long(aw_long));
endmodule
`default_nettype wire
