// The regulators with whole AXI4 ports, manager's side (s_) and memory's side (m_), unit 0 lowest; registers behind AXI4-Lite.
// Reads and answers pass through. With BUFFER, data of writes is held back until a burst is whole (halpipe_regulator_store).
`default_nettype none
module halpipe_regulator_axi4 #(
  parameter integer UNITS  = 4,
  parameter integer DEPTH  = 1024,
  parameter integer TABLES = 16,
  parameter integer BANKS  = 1,
  parameter integer SIZE   = 3,          // log2 of the bytes of a beat of the bus, 0 to 7
  parameter [31:0]  CYCLES = 32'd4096,
  parameter         IMAGES = "",
  parameter integer ADDR   = 40,
  parameter integer ID     = 4,
  parameter integer BUFFER = 16,         // beats of the write buffer of a unit, a power of two; 0: none
  parameter integer DATA   = 8 << SIZE   // follows from SIZE
)(
  input  wire                    clk,
  input  wire                    rst_n,
  input  wire [63:0]             now,    // the time base that START counts in
  output wire                    tick,
  // registers
  input  wire                    l_awvalid, output wire        l_awready, input  wire [25:0] l_awaddr,
  input  wire                    l_wvalid,  output wire        l_wready,  input  wire [31:0] l_wdata, input wire [3:0] l_wstrb,
  output wire                    l_bvalid,  input  wire        l_bready,  output wire [1:0]  l_bresp,
  input  wire                    l_arvalid, output wire        l_arready, input  wire [25:0] l_araddr,
  output wire                    l_rvalid,  input  wire        l_rready,  output wire [31:0] l_rdata, output wire [1:0] l_rresp,
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
  assign {m_arid, m_araddr, m_arlen, m_arsize, m_arburst} = {s_arid, s_araddr, s_arlen, s_arsize, s_arburst};
  assign {m_arlock, m_arcache, m_arprot, m_arqos} = {s_arlock, s_arcache, s_arprot, s_arqos};
  assign {s_rvalid, m_rready, s_rid, s_rdata, s_rresp, s_rlast} = {m_rvalid, s_rready, m_rid, m_rdata, m_rresp, m_rlast};
  assign {s_bvalid, m_bready, s_bid, s_bresp} = {m_bvalid, s_bready, m_bid, m_bresp};

  // ---------------------------------------------------------------------------------------------- write buffers
  localparam integer INFO = ID + ADDR + 25;
  wire [UNITS-1:0] awvalid, awready, wvalid, wready;
  genvar i;
  generate for (i = 0; i < UNITS; i = i + 1) begin : manager
    wire [INFO-1:0] shown = {s_awid[ID*i +: ID], s_awaddr[ADDR*i +: ADDR], s_awlen[8*i +: 8], s_awsize[3*i +: 3],
                             s_awburst[2*i +: 2], s_awlock[i], s_awcache[4*i +: 4], s_awprot[3*i +: 3], s_awqos[4*i +: 4]};
    wire [INFO-1:0] passed;
    assign {m_awid[ID*i +: ID], m_awaddr[ADDR*i +: ADDR], m_awlen[8*i +: 8], m_awsize[3*i +: 3], m_awburst[2*i +: 2],
            m_awlock[i], m_awcache[4*i +: 4], m_awprot[3*i +: 3], m_awqos[4*i +: 4]} = passed;
    if (BUFFER != 0) begin : buffered
      halpipe_regulator_store #(.BEATS(BUFFER), .DATA(DATA), .INFO(INFO)) store (
        .clk(clk), .rst_n(rst_n), .s_awvalid(s_awvalid[i]), .s_awready(s_awready[i]), .s_aw(shown),
        .s_wvalid(s_wvalid[i]), .s_wready(s_wready[i]), .s_wdata(s_wdata[DATA*i +: DATA]),
        .s_wstrb(s_wstrb[DATA/8*i +: DATA/8]), .s_wlast(s_wlast[i]),
        .m_awvalid(awvalid[i]), .m_awready(awready[i]), .m_aw(passed), .m_wvalid(wvalid[i]), .m_wready(wready[i]),
        .m_wdata(m_wdata[DATA*i +: DATA]), .m_wstrb(m_wstrb[DATA/8*i +: DATA/8]), .m_wlast(m_wlast[i]));
    end else begin : plain
      assign {awvalid[i], s_awready[i], passed} = {s_awvalid[i], awready[i], shown};
      assign {wvalid[i], s_wready[i], m_wlast[i]} = {s_wvalid[i], wready[i], s_wlast[i]};
      assign m_wdata[DATA*i +: DATA] = s_wdata[DATA*i +: DATA];
      assign m_wstrb[DATA/8*i +: DATA/8] = s_wstrb[DATA/8*i +: DATA/8];
    end
  end endgenerate

  // ---------------------------------------------------------------------------------------------- regulators
  wire reg_write; wire [25:0] reg_addr; wire [31:0] reg_wdata, reg_rdata;
  halpipe_regulator_axil registers (
    .clk(clk), .rst_n(rst_n), .s_awvalid(l_awvalid), .s_awready(l_awready), .s_awaddr(l_awaddr), .s_wvalid(l_wvalid),
    .s_wready(l_wready), .s_wdata(l_wdata), .s_wstrb(l_wstrb), .s_bvalid(l_bvalid), .s_bready(l_bready), .s_bresp(l_bresp),
    .s_arvalid(l_arvalid), .s_arready(l_arready), .s_araddr(l_araddr), .s_rvalid(l_rvalid), .s_rready(l_rready),
    .s_rdata(l_rdata), .s_rresp(l_rresp),
    .reg_write(reg_write), .reg_addr(reg_addr), .reg_wdata(reg_wdata), .reg_rdata(reg_rdata));
  halpipe_regulator #(
    .UNITS(UNITS), .DEPTH(DEPTH), .TABLES(TABLES), .BANKS(BANKS), .SIZE(SIZE), .CYCLES(CYCLES), .IMAGES(IMAGES)
  ) regulators (
    .clk(clk), .rst_n(rst_n), .now(now),
    .reg_write(reg_write), .reg_addr(reg_addr), .reg_wdata(reg_wdata), .reg_rdata(reg_rdata), .tick(tick),
    .s_arvalid(s_arvalid), .s_arready(s_arready), .m_arvalid(m_arvalid), .m_arready(m_arready),
    .s_awvalid(awvalid), .s_awready(awready), .m_awvalid(m_awvalid), .m_awready(m_awready),
    .s_wvalid(wvalid), .s_wready(wready), .m_wvalid(m_wvalid), .m_wready(m_wready), .s_wlast(m_wlast),
    .arlen(s_arlen), .awlen(m_awlen));
endmodule
`default_nettype wire
