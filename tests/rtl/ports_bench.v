// Two ports for registers, two banks: port 0 loads a schedule into the spare bank and requests it, while port 1 changes budgets
// by requests all the time, in the very cycles of port 0. No window has the defaults (999), and none a budget that is half written.
module ports_bench;
  reg clk = 0, rst_n = 0;
  always #1 clk = ~clk;
  reg [1:0] valid = 0, rvalid = 0; reg [51:0] addr = 0; reg [63:0] wdata = 0; wire [1:0] ready, bvalid, arready, has; wire [3:0] bresp; wire [63:0] rdata;
  halpipe_regulator_axi4 #(.UNITS(1), .DEPTH(16), .TABLES(8), .BANKS(2), .PORTS(2), .CYCLES(16), .BUFFER(0)) dut (
    .clk(clk), .rst_n(rst_n), .now(64'd0), .tick(tick), .link_valid_i(1'b0), .link_valid_o(), .link_table_i(8'd0), .link_table_o(),
    .link_barred_i(1'b0), .link_barred_o(), .l_awvalid(valid), .l_awready(ready), .l_awaddr(addr), .l_wvalid(valid), .l_wready(), .l_wdata(wdata),
    .l_wstrb(8'hff), .l_bvalid(bvalid), .l_bready(2'b11), .l_bresp(bresp), .l_arvalid(rvalid), .l_arready(arready), .l_araddr(addr), .l_rvalid(has),
    .l_rready(2'b11), .l_rdata(rdata), .l_rresp(), .s_awvalid(1'b0), .s_awlen(8'd0), .s_wvalid(1'b0), .s_arvalid(1'b0), .s_arlen(8'd0), .m_awready(1'b0),
    .m_wready(1'b0), .m_arready(1'b0), .m_bvalid(1'b0), .m_rvalid(1'b0));
  wire tick; integer refused0 = 0, refused1 = 0, wrong = 0, high = 0, sent = 0; reg first = 0, looks = 0;
  always @(posedge clk) begin
    if (bvalid[0] & bresp[1]) refused0 = refused0 + 1;
    if (bvalid[1] & bresp[3]) refused1 = refused1 + 1;
    first <= tick;
    // budgets come in pairs: reads and writes of an entry are equal, unless it is half written
    if (first & looks & dut.regulators.unit[0].regulator.rd_left != dut.regulators.unit[0].regulator.wr_left) wrong = wrong + 1;
    if (first & looks & dut.regulators.unit[0].regulator.rd_left == 999) wrong = wrong + 1;
    if (first & looks & dut.regulators.unit[0].regulator.rd_left == 0) wrong = wrong + 1;
    if (first & looks & dut.regulators.unit[0].regulator.rd_left >= 300) high = high + 1;
  end
  task automatic write(input integer port, input [25:0] a, input [31:0] d); begin
    @(negedge clk); addr[26*port +: 26] = a; wdata[32*port +: 32] = d; valid[port] = 1; #0.1; while (!ready[port]) begin @(negedge clk); #0.1; end
    @(negedge clk); valid[port] = 0;
  end endtask
  task entry(input integer at, input [31:0] window, input [31:0] bytes); begin
    write(0, 26'h0101000 + 16 * at, bytes); write(0, 26'h0101004 + 16 * at, bytes); write(0, 26'h0101008 + 16 * at, window);
  end endtask
  task head(input integer number, input [31:0] windows, input [23:0] base); begin
    write(0, 26'h0100800 + 8 * number, windows); write(0, 26'h0100804 + 8 * number, {number[7:0], base});
  end endtask
  initial begin
    #7 rst_n = 1;
    write(0, 26'h0100014, 999);                                       // without the lock: refused
    write(0, 26'h34, 1); write(1, 26'h34, 1);                          // port 1 comes too late
    write(0, 26'h0100014, 999); write(0, 26'h0100018, 999);
    head(0, 1, 0); entry(0, 0, 100); head(1, 1, 1); entry(1, 0, 200); entry(2, 32'hffffffff, 0);
    write(0, 26'h8, 1); write(0, 26'h34, 0);
    repeat (60) @(negedge clk);
    $display("set up: refused %0d and %0d", refused0, refused1); refused0 = 0; refused1 = 0; looks = 1;
    fork
      begin
        write(0, 26'h34, 1);
        repeat (20) begin entry(8, 0, 300); entry(9, 0, 400); head(4, 1, 8); head(5, 1, 9); end
        write(0, 26'h34, 0); write(0, 26'h1c, 4);
      end
      repeat (250) begin write(1, 26'h1c, sent % 2); sent = sent + 1; if (sent % 9 == 0) write(1, 26'h1c, 4); end
    join
    repeat (60) @(negedge clk);
    $display("both: refused %0d and %0d, %0d wrong windows", refused0, refused1, wrong);
    write(0, 26'h1c, 4); repeat (60) @(negedge clk); high = 0; repeat (160) @(negedge clk);
    $display("then: %0d windows of the new schedule", high);
    write(1, 26'h34, 1); write(0, 26'h34, 2); write(0, 26'h34, 1);      // port 0 may take the lock from another
    @(negedge clk); addr[25:0] = 26'h34; rvalid = 1; @(negedge clk); rvalid = 0; $display("lock %h, %0d wrong windows", rdata[31:0], wrong);
    $finish;
  end
endmodule
