// What a unit must do: registers, what reaches its tables, and data that never goes ahead of its address.
`default_nettype none
module formal_unit (
  input wire clk, input wire rst_n, input wire tick, input wire all_go, input wire all_req_valid, input wire [7:0] all_req_table,
  input wire holds, input wire foreign,
  input wire [15:0] longest,
  input wire reg_write, input wire [19:0] reg_addr, input wire [31:0] reg_wdata,
  input wire s_arvalid, input wire m_arready, input wire s_awvalid, input wire m_awready, input wire s_wvalid,
  input wire m_wready, input wire s_wlast, input wire [7:0] arlen, input wire [7:0] awlen
);
  wire [31:0] reg_rdata; wire ar_long, aw_long, refused, running, plays_upper;
  wire m_arvalid, s_arready, m_awvalid, s_awready, m_wvalid, s_wready;
  halpipe_regulator_unit #(.DEPTH(4), .TABLES(4), .BANKS(2), .SIZE(5), .BUFFER(8), .DEF_RD(32'd4096), .DEF_WR(32'd512)) dut (
    .clk(clk), .rst_n(rst_n), .tick(tick), .all_go(all_go), .all_req_valid(all_req_valid), .all_req_table(all_req_table), .holds(holds), .foreign(foreign), .refused(refused),
    .running(running), .plays_upper(plays_upper), .longest(longest),
    .reg_write(reg_write), .reg_addr(reg_addr), .reg_wdata(reg_wdata), .reg_rdata(reg_rdata),
    .s_arvalid(s_arvalid), .m_arvalid(m_arvalid), .s_arready(s_arready), .m_arready(m_arready),
    .s_awvalid(s_awvalid), .m_awvalid(m_awvalid), .s_awready(s_awready), .m_awready(m_awready),
    .s_wvalid(s_wvalid), .m_wvalid(m_wvalid), .s_wready(s_wready), .m_wready(m_wready), .s_wlast(s_wlast),
    .arlen(arlen), .ar_long(ar_long), .awlen(awlen), .aw_long(aw_long));
  // inputs of the parts, as they are connected
  (* keep *) wire go_here, long_rd, long_wr; (* keep *) wire [31:0] rd_bytes, wr_bytes, rd_waits, wr_waits; (* keep *) wire [31:0] held_rd, held_wr;
  (* keep *) wire p_tick, p_go, p_req_valid, r_refill, w_refill, r_room, w_room, r_valid, w_valid;
  (* keep *) wire [7:0] p_req_table, owed;
  (* keep *) wire [2:0] p_entry_write; (* keep *) wire [1:0] p_header_write;
  (* keep *) wire [15:0] p_index, r_bytes, w_bytes; (* keep *) wire [95:0] p_data;
  (* keep *) wire [31:0] p_def_rd, p_def_wr, p_next_rd, p_next_wr, r_budget, w_budget, r_left, w_left;
  (* keep *) wire p_running, p_pending, w_admit; (* keep *) wire [7:0] p_table, p_pending_table, p_entry_table; (* keep *) wire [31:0] p_window;
  reg first = 1;
  always @(posedge clk) first <= 0;
  always @* assume (rst_n == !first);
  always @* if (all_req_valid) assume (all_req_table < 4);   // as is proven of the block around the units

  // ---- registers, as regulator.rdl has them
  wire control = reg_addr < 20'h00800, headers = (reg_addr >= 20'h00800) & (reg_addr < 20'h01000), entries = reg_addr >= 20'h01000;
  reg m_go = 0; reg [31:0] m_rd = 0, m_wr = 0, m_held_rd = 0, m_held_wr = 0;
  wire plays = m_go | all_go;
  // the bank of a table or entry, and whether it is the one that is neither played, nor requested, nor about to be played
  wire [1:0] bank = entries ? reg_addr[5:4] : reg_addr[4:3];
  wire spare = p_running & bank[1] != (p_table >= 2) & bank[1] != (p_entry_table >= 2) & !(p_pending & bank[1] == (p_pending_table >= 2));
  wire may = holds & (!plays | spare);
  wire heard = reg_write & reg_addr == 20'h01c & !all_req_valid & reg_wdata[7:0] < 4 & (!foreign | (p_running & (reg_wdata[7:0] >= 2) == (p_table >= 2)));
  wire asks = all_req_valid | heard;
  wire entered = may & entries & reg_addr < 20'h01040 & reg_addr[3:0] <= 4'h8 & reg_addr[1:0] == 0;
  wire works = heard | entered | (may & headers & reg_addr < 20'h00820) | reg_addr == 20'h00c | (holds & (reg_addr == 20'h008 | reg_addr == 20'h014 | reg_addr == 20'h018));
  wire [7:0] asked = all_req_valid ? all_req_table : reg_wdata[7:0];
  always @(posedge clk)
    if (!rst_n) begin m_go <= 0; m_rd <= 4096; m_wr <= 512; m_held_rd <= 0; m_held_wr <= 0; end
    else if (reg_write) begin
      if (holds & reg_addr == 20'h008) m_go <= reg_wdata[0];
      if (holds & reg_addr == 20'h014) m_rd <= reg_wdata;
      if (holds & reg_addr == 20'h018) m_wr <= reg_wdata;
      if (may & reg_addr < 20'h01040 & entries & reg_addr[3:0] == 4'h0) m_held_wr <= reg_wdata;
      if (may & reg_addr < 20'h01040 & entries & reg_addr[3:0] == 4'h4) m_held_rd <= reg_wdata;
    end
  reg m_long_rd = 0, m_long_wr = 0; reg [31:0] m_rd_bytes = 0, m_wr_bytes = 0, m_rd_waits = 0, m_wr_waits = 0;
  always @(posedge clk)
    if (!rst_n) begin m_rd_bytes <= 0; m_wr_bytes <= 0; m_rd_waits <= 0; m_wr_waits <= 0; end
    else begin
      if (s_arvalid & s_arready) m_rd_bytes <= m_rd_bytes + r_bytes;
      if (s_awvalid & s_awready) m_wr_bytes <= m_wr_bytes + w_bytes;
      if (s_arvalid & !m_arvalid) m_rd_waits <= m_rd_waits + 1;
      if (s_awvalid & !m_awvalid) m_wr_waits <= m_wr_waits + 1;
    end
  wire settles = reg_write & reg_addr == 20'h00c;
  always @(posedge clk) begin
    m_long_rd <= rst_n & ((m_long_rd & !settles) | ar_long);
    m_long_wr <= rst_n & ((m_long_wr & !settles) | (s_awvalid & (w_bytes > longest | awlen >= 8) & !m_awvalid));
  end
  always @* if (!first) begin
    started:  assert (p_go == plays & p_tick == tick);
    state:    assert (go_here == m_go & held_rd == m_held_rd & held_wr == m_held_wr);
    counters: assert ({rd_bytes, wr_bytes, rd_waits, wr_waits} == {m_rd_bytes, m_wr_bytes, m_rd_waits, m_wr_waits});
    long:     assert (long_rd == m_long_rd & long_wr == m_long_wr);
    asks_rd:  assert (ar_long == (s_arvalid & r_bytes > longest & !m_arvalid) & !(ar_long & s_arready));
    asks_wr:  assert (aw_long == (s_awvalid & (w_bytes > longest | awlen >= 8) & !m_awvalid & owed == 0) & !(aw_long & s_awready));
    defaults: assert (p_def_rd == m_rd & p_def_wr == m_wr);
    requests: assert (p_req_valid == asks & (!p_req_valid | p_req_table == asked));
    refuses:  assert (refused == (reg_write & !works));
    shows:    assert (running == p_running & plays_upper == (p_table >= 2));
    // an entry is stored whole when its START is written, a header word by word; both only where there is one, and no table plays
    if (p_entry_write != 0) stored: assert (reg_write & may & entries & reg_addr[3:0] == 4'h8 & p_entry_write == 3'b111
                                            & reg_addr < 20'h01040 & p_index == (reg_addr - 20'h01000) >> 4
                                            & p_data == {reg_wdata, m_held_rd, m_held_wr});
    if (reg_write & may & entries & reg_addr[3:0] == 4'h8 & reg_addr < 20'h01040) storable: assert (p_entry_write == 3'b111);
    if (p_header_write != 0) headed: assert (reg_write & may & headers & reg_addr < 20'h00820
                                             & p_index == (reg_addr - 20'h00800) >> 3 & p_header_write == (reg_addr[2] ? 2'b10 : 2'b01)
                                             & (reg_addr[2] ? p_data[63:32] : p_data[31:0]) == reg_wdata);
    if (reg_write & may & headers & reg_addr < 20'h00820) headable: assert (p_header_write != 0);
    if (control) case (reg_addr)
      20'h000: id:      assert (reg_rdata == 32'h48425754);
      20'h004: params:  assert (reg_rdata == {8'd4, 8'd4, 16'd4});
      20'h008: ctrl:    assert (reg_rdata == {31'd0, m_go});
      20'h00c: status:  assert (reg_rdata == {8'd0, p_pending_table, 4'd0, m_long_wr, m_long_rd, p_pending, p_running, p_table});
      20'h010: window:  assert (reg_rdata == p_window);
      20'h014: rd:      assert (reg_rdata == m_rd);
      20'h018: wr:      assert (reg_rdata == m_wr);
      20'h020: rd_left: assert (reg_rdata == r_left);
      20'h024: wr_left: assert (reg_rdata == w_left);
      20'h028: r_moved: assert (reg_rdata == m_rd_bytes);
      20'h02c: w_moved: assert (reg_rdata == m_wr_bytes);
      20'h030: r_waits: assert (reg_rdata == m_rd_waits);
      20'h034: w_waits: assert (reg_rdata == m_wr_waits);
      default: ;
    endcase

    // ---- the gates stand in the right channels, with the right budgets
    reads:   assert (r_refill == tick & r_budget == p_next_rd & r_room == (r_bytes <= longest) & r_valid == s_arvalid
                     & r_bytes == ({8'd0, arlen} + 16'd1) * 32);
    writes:  assert (w_refill == tick & w_budget == p_next_wr & w_valid == s_awvalid
                     & w_bytes == ({8'd0, awlen} + 16'd1) * 32);
    ar_both: assert ((s_arvalid & s_arready) == (m_arvalid & m_arready) & (!m_arvalid | s_arvalid));
    aw_both: assert ((s_awvalid & s_awready) == (m_awvalid & m_awready) & (!m_awvalid | s_awvalid));
  end

  // ---- data: never without an address that was shown before, or is shown no later than the last beat before it was
  reg [8:0] open = 0;                  // writes shown whose last beat has not passed
  wire passes = m_wvalid & m_wready & s_wlast;
  always @(posedge clk) open <= !rst_n ? 9'd0 : open + {8'd0, w_admit} - {8'd0, passes};
  always @* if (!first) begin
    counted: assert (open == {1'b0, owed});
    ahead:   assert (!m_wvalid | (s_wvalid & open != 0));
    carries: assert (!(s_wvalid & open != 0) | m_wvalid);
    w_both:  assert ((s_wvalid & s_wready) == (m_wvalid & m_wready));
    bounded: assert (!(w_admit & open == 255));
    room:    assert (w_room == (open < 255 & w_bytes <= longest & awlen < 8));
  end
endmodule
`default_nettype wire
