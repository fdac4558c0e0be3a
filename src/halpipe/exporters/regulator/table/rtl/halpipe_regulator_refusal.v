// Answers the bursts of one manager that its unit never lets pass with SLVERR, in front of the unit.
//
// Order: a burst is refused when every burst of its direction before it was answered, whatever its ID, and the next one is
// shown to the unit when the refusal was answered. So the answers of each ID come in the order of its addresses. The data
// of a refused write is taken to its last beat and dropped, and nothing of it reaches the memory. It is no deadlock to wait:
// AXI4 lets no manager withhold data or an answer's READY until a later address is taken.
`default_nettype none
module halpipe_regulator_refusal #(
  parameter integer ID   = 4,
  parameter integer DATA = 64
)(
  input  wire            clk,
  input  wire            rst_n,
  // addresses of writes: manager's side, unit's side; `aw_long`: the unit is shown one that never passes
  input  wire            s_awvalid, output wire            s_awready, input  wire [ID-1:0]   s_awid,
  output wire            m_awvalid, input  wire            m_awready, input  wire            aw_long,
  input  wire            s_wvalid,  output wire            s_wready,  input  wire            s_wlast,
  output wire            m_wvalid,  input  wire            m_wready,
  output wire            s_bvalid,  input  wire            s_bready,  output wire [ID-1:0]   s_bid,  output wire [1:0] s_bresp,
  input  wire            m_bvalid,  output wire            m_bready,  input  wire [ID-1:0]   m_bid,  input  wire [1:0] m_bresp,
  // the same of reads
  input  wire            s_arvalid, output wire            s_arready, input  wire [ID-1:0]   s_arid, input  wire [7:0] s_arlen,
  output wire            m_arvalid, input  wire            m_arready, input  wire            ar_long,
  output wire            s_rvalid,  input  wire            s_rready,  output wire [ID-1:0]   s_rid,  output wire [1:0] s_rresp,
  output wire [DATA-1:0] s_rdata,   output wire            s_rlast,
  input  wire            m_rvalid,  output wire            m_rready,  input  wire [ID-1:0]   m_rid,  input  wire [1:0] m_rresp,
  input  wire [DATA-1:0] m_rdata,   input  wire            m_rlast
);
  localparam [1:0] SLVERR = 2'b10;
  reg [9:0] writes, reads;             // bursts that the memory has taken and not answered; one more is not shown at 1023
  reg       drops, denies, fails;      // data of a refused write is dropped; it is answered; a read is answered
  reg [7:0] beats;                     // that are still to come, less one
  reg [ID-1:0] wid, rid;

  wire aw_open = ~drops & ~denies & ~&writes;
  wire ar_open = ~fails & ~&reads;
  wire aw_takes = aw_long & (writes == 10'd0);
  wire ar_takes = ar_long & (reads == 10'd0);
  assign m_awvalid = s_awvalid & aw_open;
  assign m_arvalid = s_arvalid & ar_open;
  assign s_awready = (m_awready & aw_open) | aw_takes;
  assign s_arready = (m_arready & ar_open) | ar_takes;
  assign m_wvalid = s_wvalid & ~drops;
  assign s_wready = m_wready | drops;
  assign s_bvalid = m_bvalid | denies;
  assign m_bready = s_bready & ~denies;
  assign {s_bid, s_bresp} = denies ? {wid, SLVERR} : {m_bid, m_bresp};
  assign s_rvalid = m_rvalid | fails;
  assign m_rready = s_rready & ~fails;
  assign {s_rid, s_rresp, s_rdata, s_rlast} = fails ? {rid, SLVERR, {DATA{1'b0}}, beats == 8'd0} : {m_rid, m_rresp, m_rdata, m_rlast};

  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      writes <= 0; reads <= 0; drops <= 1'b0; denies <= 1'b0; fails <= 1'b0; beats <= 0; wid <= 0; rid <= 0;
    end else begin
      writes <= writes + {9'd0, m_awvalid & m_awready} - {9'd0, m_bvalid & m_bready};
      reads <= reads + {9'd0, m_arvalid & m_arready} - {9'd0, m_rvalid & m_rready & m_rlast};
      if (aw_takes) begin
        drops <= 1'b1; wid <= s_awid;
      end else if (drops & s_wvalid & s_wlast) {drops, denies} <= 2'b01;
      else if (s_bready) denies <= 1'b0;
      if (ar_takes) begin
        fails <= 1'b1; rid <= s_arid; beats <= s_arlen;
      end else if (s_rready) begin
        fails <= fails & (beats != 8'd0); beats <= beats - 8'd1;
      end
    end
endmodule
`default_nettype wire
