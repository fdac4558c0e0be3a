// The AXI4 top as a whole, with its stages, buffers and units: AXI4 on all its ports towards managers and memory that keep to it.
`default_nettype none
module formal_axi4 (
  input wire clk, input wire rst_n, input wire [63:0] now, input wire link_valid_i, input wire [7:0] link_table_i, input wire link_barred_i,
  input wire [1:0] l_awvalid, input wire [51:0] l_awaddr, input wire [1:0] l_wvalid, input wire [63:0] l_wdata, input wire [7:0] l_wstrb,
  input wire [1:0] l_bready, input wire [1:0] l_arvalid, input wire [51:0] l_araddr, input wire [1:0] l_rready,
  input wire [1:0] s_awvalid, input wire [1:0] s_awid, input wire [3:0] s_awaddr, input wire [15:0] s_awlen, input wire [5:0] s_awsize,
  input wire [3:0] s_awburst, input wire [1:0] s_awlock, input wire [7:0] s_awcache, input wire [5:0] s_awprot, input wire [7:0] s_awqos,
  input wire [1:0] s_wvalid, input wire [15:0] s_wdata, input wire [1:0] s_wstrb, input wire [1:0] s_wlast, input wire [1:0] s_bready,
  input wire [1:0] s_arvalid, input wire [1:0] s_arid, input wire [3:0] s_araddr, input wire [15:0] s_arlen, input wire [5:0] s_arsize,
  input wire [3:0] s_arburst, input wire [1:0] s_arlock, input wire [7:0] s_arcache, input wire [5:0] s_arprot, input wire [7:0] s_arqos,
  input wire [1:0] s_rready, input wire [1:0] m_awready, input wire [1:0] m_wready, input wire [1:0] m_arready,
  input wire [1:0] m_bvalid, input wire [1:0] m_bid, input wire [3:0] m_bresp,
  input wire [1:0] m_rvalid, input wire [1:0] m_rid, input wire [15:0] m_rdata, input wire [3:0] m_rresp, input wire [1:0] m_rlast
);
  wire [1:0] l_awready, l_wready, l_bvalid, l_arready, l_rvalid; wire [3:0] l_bresp, l_rresp; wire [63:0] l_rdata;
  wire [1:0] s_awready, s_wready, s_bvalid, s_bid, s_arready, s_rvalid, s_rid, s_rlast; wire [3:0] s_bresp, s_rresp; wire [15:0] s_rdata;
  wire [1:0] m_awvalid, m_awid, m_awlock, m_wvalid, m_wstrb, m_wlast, m_bready, m_arvalid, m_arid, m_arlock, m_rready;
  wire [3:0] m_awaddr, m_awburst, m_araddr, m_arburst; wire [15:0] m_awlen, m_wdata, m_arlen;
  wire [5:0] m_awsize, m_awprot, m_arsize, m_arprot; wire [7:0] m_awcache, m_awqos, m_arcache, m_arqos, link_table_o;
  wire tick, link_valid_o, link_barred_o;
  halpipe_regulator_axi4 #(.UNITS(2), .DEPTH(2), .TABLES(2), .BANKS(2), .PORTS(2), .SIZE(0), .ADDR(2), .ID(1), .BUFFER(2), .STAGE(@stage@)) dut (.*);
  (* keep *) wire [3:0] head, tail; (* keep *) wire [21:0] whole;   // of the two buffers
  (* keep *) wire [19:0] writes, reads; (* keep *) wire [1:0] drops, denies, fails;          // of the two refusals
  reg first = 1, begun = 0;
  always @(posedge clk) begin first <= 0; begun <= first; end  // begun: the first cycle after reset
  always @* assume (rst_n == !first);

  // of each unit: a channel's payload, whether it is shown, and whether it is taken
    wire [1:0] filled_holds;
  wire [1:0] aw_stays_holds;
  wire [1:0] w_stays_holds;
  wire [1:0] ar_stays_holds;
  wire [1:0] lb_stays_holds;
  wire [1:0] lr_stays_holds;
  wire [1:0] quiet_holds;
  wire [1:0] b_passes_holds;
  wire [1:0] r_passes_holds;
  wire [1:0] b_stays_holds;
  wire [1:0] r_stays_holds;
  wire [1:0] ordered_holds;
  genvar i;
  generate for (i = 0; i < 2; i = i + 1) begin : unit
    wire [33:0] s_aw = {s_awid[i], s_awaddr[2*i +: 2], s_awlen[8*i +: 8], s_awsize[3*i +: 3], s_awburst[2*i +: 2], s_awlock[i], s_awcache[4*i +: 4], s_awprot[3*i +: 3], s_awqos[4*i +: 4]};
    wire [33:0] m_aw = {m_awid[i], m_awaddr[2*i +: 2], m_awlen[8*i +: 8], m_awsize[3*i +: 3], m_awburst[2*i +: 2], m_awlock[i], m_awcache[4*i +: 4], m_awprot[3*i +: 3], m_awqos[4*i +: 4]};
    wire [33:0] s_ar = {s_arid[i], s_araddr[2*i +: 2], s_arlen[8*i +: 8], s_arsize[3*i +: 3], s_arburst[2*i +: 2], s_arlock[i], s_arcache[4*i +: 4], s_arprot[3*i +: 3], s_arqos[4*i +: 4]};
    wire [33:0] m_ar = {m_arid[i], m_araddr[2*i +: 2], m_arlen[8*i +: 8], m_arsize[3*i +: 3], m_arburst[2*i +: 2], m_arlock[i], m_arcache[4*i +: 4], m_arprot[3*i +: 3], m_arqos[4*i +: 4]};
    wire [9:0] s_w = {s_wdata[8*i +: 8], s_wstrb[i], s_wlast[i]}, m_w = {m_wdata[8*i +: 8], m_wstrb[i], m_wlast[i]};
    wire [2:0] m_b = {m_bid[i], m_bresp[2*i +: 2]}; wire [11:0] m_r = {m_rid[i], m_rdata[8*i +: 8], m_rresp[2*i +: 2], m_rlast[i]};
    wire [2:0] s_b = {s_bid[i], s_bresp[2*i +: 2]}; wire [11:0] s_r = {s_rid[i], s_rdata[8*i +: 8], s_rresp[2*i +: 2], s_rlast[i]};
    reg [2:0] s_b_ = 0; reg [11:0] s_r_ = 0; reg b_kept = 0, r_kept = 0;
    reg [33:0] s_aw_ = 0, m_aw_ = 0, s_ar_ = 0, m_ar_ = 0; reg [9:0] s_w_ = 0, m_w_ = 0; reg [2:0] m_b_ = 0; reg [11:0] m_r_ = 0;
    reg aw_in = 0, w_in = 0, ar_in = 0, b_in = 0, r_in = 0, aw_out = 0, w_out = 0, ar_out = 0, lb = 0, lr = 0; reg [1:0] lb_ = 0; reg [31:0] lr_ = 0;
    always @(posedge clk) begin
      s_aw_ <= s_aw; m_aw_ <= m_aw; s_ar_ <= s_ar; m_ar_ <= m_ar; s_w_ <= s_w; m_w_ <= m_w; m_b_ <= m_b; m_r_ <= m_r;
      aw_in <= rst_n & s_awvalid[i] & !s_awready[i]; w_in <= rst_n & s_wvalid[i] & !s_wready[i]; ar_in <= rst_n & s_arvalid[i] & !s_arready[i];
      b_in <= rst_n & m_bvalid[i] & !m_bready[i]; r_in <= rst_n & m_rvalid[i] & !m_rready[i];
      aw_out <= rst_n & m_awvalid[i] & !m_awready[i]; w_out <= rst_n & m_wvalid[i] & !m_wready[i]; ar_out <= rst_n & m_arvalid[i] & !m_arready[i];
      lb <= rst_n & l_bvalid[i] & !l_bready[i]; lr <= rst_n & l_rvalid[i] & !l_rready[i];
      s_b_ <= s_b; s_r_ <= s_r; b_kept <= rst_n & s_bvalid[i] & !s_bready[i]; r_kept <= rst_n & s_rvalid[i] & !s_rready[i];
      lb_ <= l_bresp[2*i +: 2]; lr_ <= l_rdata[32*i +: 32];
    end
    always @* assume ((!m_bvalid[i] | writes[10*i +: 10] != 0) & (!m_rvalid[i] | reads[10*i +: 10] != 0));   // see refusal.sv
    always @* assume ($signed(whole[11*i +: 11]) < 11'sd1000);       // see store.sv
    // managers and memory keep to AXI: what they show, they go on showing
    always @* if (!first) begin
      if (aw_in) assume (s_awvalid[i] & s_aw == s_aw_);
      if (w_in) assume (s_wvalid[i] & s_w == s_w_);
      if (ar_in) assume (s_arvalid[i] & s_ar == s_ar_);
      if (b_in) assume (m_bvalid[i] & m_b == m_b_);
      if (r_in) assume (m_rvalid[i] & m_r == m_r_);
    end
    assign filled_holds[i] = tail[2*i +: 2] - head[2*i +: 2] <= 2'd2;
    assign aw_stays_holds[i] = !aw_out | (m_awvalid[i] & m_aw == m_aw_);
    assign w_stays_holds[i] = !w_out | (m_wvalid[i] & m_w == m_w_);
    assign ar_stays_holds[i] = !ar_out | (m_arvalid[i] & m_ar == m_ar_);
    assign lb_stays_holds[i] = !lb | (l_bvalid[i] & l_bresp[2*i +: 2] == lb_);
    assign lr_stays_holds[i] = !lr | (l_rvalid[i] & l_rdata[32*i +: 32] == lr_);
    assign quiet_holds[i] = !begun | (m_awvalid == 0 & m_wvalid == 0 & m_arvalid == 0 & l_bvalid == 0 & l_rvalid == 0);
    assign ordered_holds[i] = (!(drops[i] | denies[i]) | writes[10*i +: 10] == 0) & (!fails[i] | reads[10*i +: 10] == 0);
    assign b_stays_holds[i] = !b_kept | (s_bvalid[i] & s_b == s_b_);
    assign r_stays_holds[i] = !r_kept | (s_rvalid[i] & s_r == s_r_);
    assign b_passes_holds[i] = denies[i] | (s_bvalid[i] == m_bvalid[i] & m_bready[i] == s_bready[i] & s_b == m_b);
    assign r_passes_holds[i] = fails[i] | (s_rvalid[i] == m_rvalid[i] & m_rready[i] == s_rready[i] & s_r == m_r);
  end endgenerate
  always @* if (!first) begin
    filled: assert (&filled_holds);
    aw_stays: assert (&aw_stays_holds);
    w_stays: assert (&w_stays_holds);
    ar_stays: assert (&ar_stays_holds);
    lb_stays: assert (&lb_stays_holds);
    lr_stays: assert (&lr_stays_holds);
    quiet: assert (&quiet_holds);
    b_passes: assert (&b_passes_holds);
    r_passes: assert (&r_passes_holds);
    b_stays: assert (&b_stays_holds);
    r_stays: assert (&r_stays_holds);
    ordered: assert (&ordered_holds);
  end
endmodule
`default_nettype wire
