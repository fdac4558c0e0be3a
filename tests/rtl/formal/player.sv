// What a player must do with tables of any content: which table, which window of it, and the budgets of the next window.
// Its own registers are connected to the wires below that have no driver, its memories to those of the same name.
`default_nettype none
module formal_player #(
  parameter DEPTH = @depth@, parameter TABLES = @tables@, parameter EA = $clog2(DEPTH), parameter HA = $clog2(TABLES)
)(
  input wire clk, input wire rst_n, input wire tick, input wire go, input wire [31:0] def_rd, input wire [31:0] def_wr,
  input wire req_valid, input wire [7:0] req_table, input wire [2:0] entry_write, input wire [1:0] header_write,
  input wire [15:0] write_index, input wire [95:0] write_data
);
  wire running, pending;
  wire [7:0] table_now, pending_table;
  wire [31:0] window_now, next_rd, next_wr;
  halpipe_regulator_player #(.DEPTH(DEPTH), .TABLES(TABLES)) dut (
    .clk(clk), .rst_n(rst_n), .tick(tick), .go(go), .def_rd(def_rd), .def_wr(def_wr), .req_valid(req_valid),
    .req_table(req_table), .entry_write(entry_write), .header_write(header_write), .write_index(write_index),
    .write_data(write_data), .running(running), .table_now(table_now), .window_now(window_now), .pending(pending),
    .pending_table(pending_table), .next_rd(next_rd), .next_wr(next_wr));
  (* keep *) wire is_calm; (* keep *) wire [23:0] place;
  (* keep *) wire [31:0] length, rd_now, wr_now;
  (* keep *) wire [7:0] follower;
  // The player's own memories, whatever is in them: these reads are joined to them. Nothing is written to these here.
  reg [95:0] entries [0:DEPTH-1];
  reg [63:0] headers [0:TABLES-1];
  reg first = 1;
  always @(posedge clk) first <= 0;
  always @* assume (rst_n == !first);
  always @* assume ({24'd0, req_table} < TABLES);

  // Windows have 4 cycles at least. While tables are played, neither the header nor the entry that is looked at for the next
  // window is written (as is proven of the unit: they are in banks that it keeps closed).
  reg [2:0] since = 0;
  reg went = 0;
  always @(posedge clk) begin
    since <= (!rst_n | tick) ? 3'd0 : (since == 3'd7) ? since : since + 3'd1;
    went <= go & rst_n;
  end
  always @* if (tick) assume (since >= 3 & rst_n);
  wire [7:0] looked = pending ? pending_table : running ? follower : 8'd0;
  wire [23:0] looks = (!running | window_now + 32'd1 == length) ? looked_head[55:32] : place + 24'd1;
  wire [63:0] looked_head = headers[looked[HA-1:0]];
  always @* if (go | went) assume ((entry_write == 0 | write_index[EA-1:0] != looks[EA-1:0])
                                   & (header_write == 0 | write_index[HA-1:0] != looked[HA-1:0]));
  reg wrote = 0;
  always @(posedge clk) wrote <= (entry_write != 0) | (header_write != 0);
  always @* if (go & tick & !went) assume (!wrote);

  // What comes next, from the state and the memories alone; a request counts that is there in the cycle before the tick.
  reg asked = 0; reg [7:0] asked_table = 0;
  always @(posedge clk) begin asked <= pending & rst_n; asked_table <= pending_table; end
  wire ends = ~running | (window_now + 32'd1 == length);
  wire [7:0] chosen = asked ? asked_table : running ? follower : 8'd0;
  wire [63:0] head = headers[chosen[HA-1:0]];
  reg calm = 0;                        // this window has no budgets: it lies between the defaults and the first table
  wire calms = go & ~running & ~calm;
  always @(posedge clk) if (!rst_n) calm <= 0; else if (tick) calm <= calms;
  wire plays = go & ~calms & ~(ends & (head[31:0] == 0));
  wire [23:0] further = ends ? head[55:32] : place + 24'd1;
  wire [95:0] ahead = entries[further[EA-1:0]];
  wire changes = ends | (ahead[95:64] == window_now + 32'd1);

  // The state after a tick, as it must be.
  reg ticked = 0, m_running = 0, m_ends = 0, m_changes = 0;
  reg [7:0] m_table = 0, m_follower = 0; reg [31:0] m_window = 0, m_length = 0, m_rd = 0, m_wr = 0;
  reg [23:0] m_place = 0;
  reg [31:0] rd = 0, wr = 0;           // budgets of this window, as handed out at the tick before it
  reg [7:0] o_table = 0; reg [31:0] o_window = 32'hffffffff; reg o_running = 0;
  always @(posedge clk) begin
    ticked <= tick & rst_n;
    m_running <= plays; m_table <= !plays ? 8'd0 : ends ? chosen : table_now;
    m_window <= !plays ? 32'hffffffff : ends ? 32'd0 : window_now + 32'd1;
    m_length <= ends ? head[31:0] : length; m_follower <= ends ? head[63:56] : follower;
    m_place <= ends ? head[55:32] : changes ? place + 24'd1 : place;
    o_table <= table_now; o_window <= window_now; o_running <= running;
    if (!rst_n) begin rd <= 0; wr <= 0; end
    else if (tick) begin rd <= next_rd; wr <= next_wr; end
  end
  always @* if (!first) begin
    if (ticked) begin
      runs:     assert (running == m_running);
      in_order: assert (table_now == m_table & window_now == m_window);
      if (running) measured: assert (length == m_length & follower == m_follower & place == m_place);
    end else if (rst_n) begin
      holds:    assert (running == o_running & table_now == o_table & window_now == o_window);
    end
    if (tick) begin
      reads:    assert (next_rd == (calms ? 32'd0 : !plays ? def_rd : changes ? ahead[63:32] : rd));
      writes:   assert (next_wr == (calms ? 32'd0 : !plays ? def_wr : changes ? ahead[31:0] : wr));
    end
    granted:    assert (!running | (rd_now == rd & wr_now == wr));
    settled:    assert (calm == is_calm);
    idle:       assert (running | window_now == 32'hffffffff);
    inside:     assert (!running | window_now < length);
  end

  // Requests: the latest counts; one is forgotten when it is followed, and one that was late for that end with it. A late
  // one stays where none is followed.
  reg m_pending = 0; reg [7:0] m_asked = 0; reg late = 0;
  wire follows = tick & go & ~calms & ends & asked;
  always @(posedge clk) begin
    late <= req_valid & rst_n;
    if (!rst_n) begin m_pending <= 0; m_asked <= 0; end
    else if (follows) m_pending <= 0;
    else if (req_valid) begin m_pending <= 1; m_asked <= req_table; end
    else if (tick & go & ~calms & ends & ~late) m_pending <= 0;
  end
  always @* if (!first) requests: assert (pending == m_pending & (!pending | pending_table == m_asked));
  always @* if (!first & asked) known: assert ({24'd0, asked_table} < TABLES);
endmodule
`default_nettype wire
