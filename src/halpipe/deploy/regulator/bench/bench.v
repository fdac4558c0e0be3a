// The regulators of a bundle between managers and a shared memory, and a monitor that counts what passes. What software
// would do, a script does: lines "cycle w address data" and "cycle r address 0", in cycles since reset, one per cycle. The
// same through AXI4-Lite: "l" and "a", with the strobes of a write in bits 29:26 of its address; four cycles apart.
//
// The trace has for every window "W", its number, and for every unit: table, window (as the unit says), then for reads and
// writes the bytes taken, carried over and waiting, then beats of data read and written, the faults seen so far, and what
// was left of the budgets of reads and of writes in the first cycle.
`default_nettype none
module bench #(
  parameter integer UNITS  = 4,
  parameter integer DEPTH  = 1024,
  parameter integer TABLES = 16,
  parameter integer SIZE   = 3,        // log2 of the bytes of a beat: what the memory loses to each, narrow or not
  parameter integer FIRST  = 64        // cycles until the first window that counts begins
)(
  input wire clk
);
  // ---------------------------------------------------------------------------------------------- set-up
  integer script, trace, fields;
  // verilator lint_off UNUSEDSIGNAL
  reg [31:0] cycles, extra, of, windows, seed, latency, hold, depth, longest;
  // verilator lint_on UNUSEDSIGNAL
  reg [8*UNITS-1:0] kinds;             // of each unit: reads in the low half, writes in the high half
  initial begin
    cycles = 1024; extra = 0; of = 1; windows = 10; seed = 1; latency = 20; hold = 0; depth = 64; longest = 16; kinds = 0;
    if (!$value$plusargs("cycles=%d", cycles)) $display("cycles: default");
    if (!$value$plusargs("extra=%d", extra)) $display("extra: default");
    if (!$value$plusargs("of=%d", of)) $display("of: default");
    if (!$value$plusargs("windows=%d", windows)) $display("windows: default");
    if (!$value$plusargs("seed=%d", seed)) $display("seed: default");
    if (!$value$plusargs("latency=%d", latency)) $display("latency: default");
    if (!$value$plusargs("hold=%d", hold)) $display("hold: default");
    if (!$value$plusargs("depth=%d", depth)) $display("depth: default");
    if (!$value$plusargs("longest=%d", longest)) $display("longest: default");
    if (!$value$plusargs("kinds=%h", kinds)) $display("kinds: default");
    script = $fopen("script.txt", "r");
    trace = $fopen("trace.txt", "w");
    if (script == 0 || trace == 0) begin
      $display("script.txt or trace.txt cannot be opened");
      $finish;
    end
  end
  reg [2:0] settle = 0;                // reset holds for some cycles
  // verilator lint_off SYNCASYNCNET
  reg rst_n = 0;
  // verilator lint_on SYNCASYNCNET
  always @(posedge clk) begin
    if (settle != 3'd7) settle <= settle + 3'd1;
    rst_n <= (settle >= 3'd6);
  end

  // ---------------------------------------------------------------------------------------------- software
  reg [31:0] now, due, address, word;
  reg [7:0] order;                     // "w", "r", or 0 at the end of the script
  reg [31:0] read_due, read_address, read_word; reg [7:0] read_order;
  initial begin due = 0; address = 0; word = 0; order = 0; read_due = 0; read_address = 0; read_word = 0; read_order = 0; end
  wire acts = (order != 0) & (now == due) & rst_n;
  wire advance = rst_n ? acts : (settle == 3'd4);
  wire [31:0] reg_rdata; wire reg_refused;
  always @(posedge clk) begin
    now <= rst_n ? now + 1 : 0;
    if (advance) begin
      // verilator lint_off BLKSEQ
      fields = $fscanf(script, "%d %s %h %h", read_due, read_order, read_address, read_word);
      // verilator lint_on BLKSEQ
      due <= read_due; order <= (fields == 4) ? read_order : 8'd0; address <= read_address; word <= read_word;
    end
  end

  // AXI4-Lite: an order is shown for one cycle, its answer is taken two cycles after.
  reg [1:0] since; reg [31:0] asked_at, asked_address;
  wire answers = (since == 2'd2);
  wire lite_writes = acts & (order == "l");
  wire lite_reads = acts & (order == "a");
  always @(posedge clk)
    if (!rst_n) begin since <= 0; asked_at <= 0; asked_address <= 0; end
    else if (lite_writes | lite_reads) begin since <= 2'd1; asked_at <= now; asked_address <= address; end
    else since <= ((since == 0) | answers) ? 2'd0 : since + 2'd1;
  // verilator lint_off UNUSEDSIGNAL
  wire lite_awready, lite_wready, lite_arready, lite_asks; wire [1:0] lite_rresp; wire link_valid, link_barred; wire [7:0] link_table;
  // verilator lint_on UNUSEDSIGNAL
  wire lite_bvalid, lite_rvalid, lite_write; wire [1:0] lite_bresp;
  wire [25:0] lite_addr; wire [31:0] lite_rdata, lite_wdata;
  halpipe_regulator_axil lite (
    .clk(clk), .rst_n(rst_n), .s_awvalid(lite_writes), .s_awready(lite_awready), .s_awaddr(lite_writes ? address[25:0] : 26'd0),
    .s_wvalid(lite_writes), .s_wready(lite_wready), .s_wdata(word), .s_wstrb(address[29:26]), .s_bvalid(lite_bvalid),
    .s_bready(answers), .s_bresp(lite_bresp), .s_arvalid(lite_reads), .s_arready(lite_arready),
    .s_araddr(lite_reads ? address[25:0] : 26'd0), .s_rvalid(lite_rvalid), .s_rready(answers), .s_rdata(lite_rdata), .s_rresp(lite_rresp),
    .asks(lite_asks), .grant(1'b1), .reg_refused(reg_refused),
    .reg_write(lite_write), .reg_addr(lite_addr), .reg_wdata(lite_wdata), .reg_rdata(reg_rdata));
  wire is_lite = lite_writes | lite_reads;

  // ---------------------------------------------------------------------------------------------- windows of the bench
  reg [31:0] left, number; reg [63:0] owing;   // extra cycles that were due so far, in parts of `of`
  wire [63:0] due_now = owing + {32'd0, extra};
  // verilator lint_off UNUSEDSIGNAL
  wire [63:0] longer = due_now / {32'd0, of} - owing / {32'd0, of};     // 0 or 1
  // verilator lint_on UNUSEDSIGNAL
  wire ends = (left == 0);
  always @(posedge clk)
    if (!rst_n) begin left <= FIRST - 1; number <= 32'hffffffff; owing <= 0; end
    else begin
      left <= ends ? cycles - 1 + longer[31:0] : left - 1;
      if (ends) owing <= due_now;
      if (ends) number <= number + 1;
    end

  // ---------------------------------------------------------------------------------------------- the system
  wire [UNITS-1:0] s_arvalid, s_arready, m_arvalid, m_arready, s_awvalid, s_awready, m_awvalid, m_awready;
  wire [UNITS-1:0] s_wvalid, s_wready, s_wlast, m_wvalid, m_wready, r_beat;
  wire [8*UNITS-1:0] arlen, awlen;
  wire tick;
  // verilator lint_off UNUSEDSIGNAL
  wire [UNITS-1:0] ar_long, aw_long;   // of none here
  // verilator lint_on UNUSEDSIGNAL
  reg gather = 0;                      // the figures of a window that just closed stand there
  halpipe_regulator #(.UNITS(UNITS), .DEPTH(DEPTH), .TABLES(TABLES), .SIZE(SIZE), .CYCLES(FIRST), .IMAGES("./")) dut (
    .clk(clk), .rst_n(rst_n), .now(64'd0), .reg_port(1'b0), .reg_refused(reg_refused), .link_valid_i(1'b0), .link_valid_o(link_valid), .link_table_i(8'd0),
    .link_table_o(link_table), .link_barred_i(1'b0), .link_barred_o(link_barred), .reg_write(lite_write | (acts & (order == "w"))),
    .reg_addr(is_lite ? lite_addr : address[25:0]), .reg_wdata(is_lite ? lite_wdata : word),
    .reg_rdata(reg_rdata), .tick(tick),
    .s_arvalid(s_arvalid), .s_arready(s_arready), .m_arvalid(m_arvalid), .m_arready(m_arready),
    .s_awvalid(s_awvalid), .s_awready(s_awready), .m_awvalid(m_awvalid), .m_awready(m_awready),
    .s_wvalid(s_wvalid), .s_wready(s_wready), .m_wvalid(m_wvalid), .m_wready(m_wready), .s_wlast(s_wlast),
    .arlen(arlen), .ar_long(ar_long), .awlen(awlen), .aw_long(aw_long));
  memory #(.PORTS(UNITS)) memory (
    .clk(clk), .rst_n(rst_n), .depth(depth[9:0]), .latency(latency), .hold(hold),
    .ar_valid(m_arvalid), .ar_ready(m_arready), .ar_len(arlen), .aw_valid(m_awvalid), .aw_ready(m_awready),
    .aw_len(awlen), .w_valid(m_wvalid), .w_ready(m_wready), .r_beat(r_beat));

  reg [31:0] seen [0:13*UNITS-1];      // a line of the trace, gathered in the cycle after a window
  genvar i;
  generate for (i = 0; i < UNITS; i = i + 1) begin : manager
    wire unused_data, unused_last;
    traffic #(.STREAM(2 * i + 1), .DATA(0)) reader (
      .clk(clk), .rst_n(rst_n), .seed(seed), .kind(kinds[8*i +: 4]), .longest(longest[8:0]),
      .valid(s_arvalid[i]), .ready(s_arready[i]), .len(arlen[8*i +: 8]),
      .data_valid(unused_data), .data_ready(1'b0), .data_last(unused_last));
    traffic #(.STREAM(2 * i + 2), .DATA(1)) writer (
      .clk(clk), .rst_n(rst_n), .seed(seed), .kind(kinds[8*i + 4 +: 4]), .longest(longest[8:0]),
      .valid(s_awvalid[i]), .ready(s_awready[i]), .len(awlen[8*i +: 8]),
      .data_valid(s_wvalid[i]), .data_ready(s_wready[i]), .data_last(s_wlast[i]));

    wire [15:0] ar_bytes = ({8'd0, arlen[8*i +: 8]} + 16'd1) << SIZE;
    wire [15:0] aw_bytes = ({8'd0, awlen[8*i +: 8]} + 16'd1) << SIZE;
    wire ar_retracted, ar_unequal, aw_retracted, aw_unequal, aw_first;
    // verilator lint_off UNUSEDSIGNAL
    wire ar_first;
    // verilator lint_on UNUSEDSIGNAL
    wire [31:0] ar_taken, ar_carried, ar_waiting, aw_taken, aw_carried, aw_waiting;
    monitor reads (
      .clk(clk), .rst_n(rst_n), .ends(ends), .valid_i(s_arvalid[i]), .ready_i(s_arready[i]), .valid_o(m_arvalid[i]),
      .ready_o(m_arready[i]), .len(arlen[8*i +: 8]), .bytes(ar_bytes), .taken(ar_taken), .carried(ar_carried),
      .waiting(ar_waiting), .retracted(ar_retracted), .unequal(ar_unequal), .first(ar_first));
    monitor writes (
      .clk(clk), .rst_n(rst_n), .ends(ends), .valid_i(s_awvalid[i]), .ready_i(s_awready[i]), .valid_o(m_awvalid[i]),
      .ready_o(m_awready[i]), .len(awlen[8*i +: 8]), .bytes(aw_bytes), .taken(aw_taken), .carried(aw_carried),
      .waiting(aw_waiting), .retracted(aw_retracted), .unequal(aw_unequal), .first(aw_first));

    // Data: beats in the window, and whether any was shown before its address.
    reg [31:0] r_beats, w_beats, r_sum, w_sum; reg [15:0] addresses; reg early, held, many, moved;
    wire [31:0] r_now = r_sum + {31'd0, r_beat[i]};
    wire [31:0] w_now = w_sum + {31'd0, m_wvalid[i] & m_wready[i]};
    reg [31:0] table_before, window_before; reg ended;
    wire [31:0] table_now = {24'd0, dut.unit[i].regulator.table_now};
    wire [31:0] window_now = dut.unit[i].regulator.window_now;
    reg [31:0] table_of, window_of;    // of the window that just closed
    reg [31:0] rd_begin, wr_begin, rd_of, wr_of;
    always @(posedge clk)
      if (!rst_n) begin
        r_beats <= 0; w_beats <= 0; r_sum <= 0; w_sum <= 0; addresses <= 0; early <= 0; held <= 0; many <= 0;
        moved <= 0; ended <= 0;
        table_before <= 0; window_before <= 32'hffffffff; table_of <= 0; window_of <= 0;
        rd_begin <= 0; wr_begin <= 0; rd_of <= 0; wr_of <= 0;
      end else begin
        addresses <= addresses + {15'd0, aw_first} - {15'd0, m_wvalid[i] & m_wready[i] & s_wlast[i]};
        if (m_wvalid[i] & (addresses == 0)) early <= 1;
        if (s_wvalid[i] & ~m_wvalid[i] & (addresses != 0)) held <= 1;
        if (addresses > 16'd255) many <= 1;
        table_before <= table_now; window_before <= window_now; ended <= ends;
        if (((table_before != table_now) | (window_before != window_now)) & ~ended) moved <= 1;
        if (tick != ends) moved <= 1;
        if (ended) begin
          rd_begin <= dut.unit[i].regulator.rd_left; wr_begin <= dut.unit[i].regulator.wr_left;
        end
        if (ends) begin
          rd_of <= rd_begin; wr_of <= wr_begin;
          r_beats <= r_now; w_beats <= w_now; r_sum <= 0; w_sum <= 0;
          table_of <= table_now; window_of <= window_now;
        end else begin
          r_sum <= r_now; w_sum <= w_now;
        end
      end
    wire [31:0] faults = {25'd0, many, held, moved, early, aw_unequal | ar_unequal, aw_retracted, ar_retracted};
    always @(posedge clk) if (gather) begin
      seen[13*i] <= table_of; seen[13*i+1] <= window_of;
      seen[13*i+2] <= ar_taken; seen[13*i+3] <= ar_carried; seen[13*i+4] <= ar_waiting;
      seen[13*i+5] <= aw_taken; seen[13*i+6] <= aw_carried; seen[13*i+7] <= aw_waiting;
      seen[13*i+8] <= r_beats; seen[13*i+9] <= w_beats; seen[13*i+10] <= faults;
      seen[13*i+11] <= rd_of; seen[13*i+12] <= wr_of;
    end
  end endgenerate

  // ---------------------------------------------------------------------------------------------- trace
  reg report = 0; integer column;
  always @(posedge clk) begin
    gather <= rst_n & ends & (number != 32'hffffffff);
    report <= gather;
    if (acts & (order == "r")) $fwrite(trace, "R %0d %0d %0d\n", now, address, reg_rdata);
    if (answers & lite_rvalid) $fwrite(trace, "R %0d %0d %0d\n", asked_at, asked_address, lite_rdata);
    if (answers & lite_bvalid) $fwrite(trace, "R %0d %0d %0d\n", asked_at, asked_address, lite_bresp);
    if (report) begin
      $fwrite(trace, "W %0d", number - 1);
      for (column = 0; column < 13 * UNITS; column = column + 1) $fwrite(trace, " %0d", seen[column]);
      $fwrite(trace, "\n");
      if (number == windows) begin
        $fclose(trace);
        $finish;
      end
    end
  end
endmodule
`default_nettype wire
