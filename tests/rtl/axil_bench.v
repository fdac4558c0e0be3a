// Writes and reads registers of the regulator through AXI4-Lite, with a master that is slow to take its answers.
module axil_bench;
  reg clk = 0, rst_n = 0;
  always #1 clk = ~clk;
  reg awvalid = 0, wvalid = 0, arvalid = 0, bready = 0, rready = 0;
  reg [25:0] awaddr, araddr; reg [31:0] wdata; reg [3:0] wstrb;
  wire awready, wready, arready, bvalid, rvalid, reg_write, reg_refused; wire [1:0] bresp, rresp;
  wire [25:0] reg_addr; wire [31:0] rdata, reg_wdata, reg_rdata;
  halpipe_regulator_axil axil (
    .clk(clk), .rst_n(rst_n), .s_awvalid(awvalid), .s_awready(awready), .s_awaddr(awaddr), .s_wvalid(wvalid),
    .s_wready(wready), .s_wdata(wdata), .s_wstrb(wstrb), .s_bvalid(bvalid), .s_bready(bready), .s_bresp(bresp),
    .s_arvalid(arvalid), .s_arready(arready), .s_araddr(araddr), .s_rvalid(rvalid), .s_rready(rready), .s_rdata(rdata),
    .s_rresp(rresp), .reg_write(reg_write), .reg_addr(reg_addr), .reg_wdata(reg_wdata), .reg_rdata(reg_rdata), .asks(), .grant(1'b1), .reg_refused(reg_refused));
  halpipe_regulator #(.UNITS(2)) regulator (
    .clk(clk), .rst_n(rst_n), .now(64'd0), .reg_port(1'b0), .reg_refused(reg_refused), .link_valid_i(1'b0), .link_valid_o(), .link_table_i(8'd0), .link_table_o(), .link_barred_i(1'b0), .link_barred_o(), .reg_write(reg_write), .reg_addr(reg_addr), .reg_wdata(reg_wdata), .reg_rdata(reg_rdata),
    .tick(), .s_arvalid(2'd0), .s_arready(), .m_arvalid(), .m_arready(2'd0), .s_awvalid(2'd0), .s_awready(), .m_awvalid(),
    .m_awready(2'd0), .s_wvalid(2'd0), .s_wready(), .m_wvalid(), .m_wready(2'd0), .s_wlast(2'd0), .arlen(16'd0), .awlen(16'd0));

  task write(input [25:0] a, input [31:0] d, input [3:0] s, input integer apart); begin
    @(negedge clk); awaddr = a; wdata = d; wstrb = s;
    awvalid = (apart >= 0); wvalid = (apart <= 0);
    if (apart != 0) begin
      @(negedge clk);
      if (awready | wready) $display("taken apart");
      awvalid = 1; wvalid = 1;
    end
    #0;
    while (!(awready & wready)) @(negedge clk);
    @(negedge clk); awvalid = 0; wvalid = 0;
    repeat (2) begin if (!bvalid) $display("answer lost"); @(negedge clk); end
    $display("write %h %0d", a, bresp); bready = 1; @(negedge clk); bready = 0;
    if (bvalid) $display("answered twice");
  end endtask

  task read(input [25:0] a); begin
    @(negedge clk); araddr = a; arvalid = 1; #0;
    while (!arready) @(negedge clk);
    @(negedge clk); arvalid = 0;
    repeat (2) begin if (!rvalid) $display("data lost"); @(negedge clk); end
    $display("read %h %h", a, rdata); rready = 1; @(negedge clk); rready = 0;
    if (rvalid) $display("read twice");
  end endtask

  initial begin
    #7 rst_n = 1;
    read(26'h0000000);
    write(26'h0200014, 32'h00000400, 4'hf, 0);
    read(26'h0200014);
    read(26'h0100014);
    write(26'h0100018, 32'h00000123, 4'hf, 1);
    write(26'h0100018, 32'h00000999, 4'h3, -1);
    read(26'h0100018);
    $finish;
  end
endmodule
