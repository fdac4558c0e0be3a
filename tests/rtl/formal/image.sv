// That a player with the exported images plays tables.json: whichever table and window is played, whatever is requested and
// whenever windows end, the budgets are those of that window. What stands between @ comes from tables.json, not from the
// images. That tables and windows come in their order is proven of the player with tables of any content.
`default_nettype none
module formal_image (
  input wire clk, input wire rst_n, input wire tick, input wire go, input wire [31:0] def_rd, input wire [31:0] def_wr,
  input wire req_valid, input wire [7:0] req_table
);
  wire running, pending;
  wire [7:0] table_now, pending_table;
  wire [31:0] window_now, next_rd, next_wr;
  halpipe_regulator_player #(.DEPTH(@depth@), .TABLES(@tables@), .TABFILE("tab.memh"), .HDRFILE("hdr.memh")) dut (
    .clk(clk), .rst_n(rst_n), .tick(tick), .go(go), .def_rd(def_rd), .def_wr(def_wr), .req_valid(req_valid),
    .req_table(req_table), .entry_write(3'd0), .header_write(2'd0), .write_index(16'd0), .write_data(96'd0),
    .running(running), .table_now(table_now), .window_now(window_now), .pending(pending),
    .pending_table(pending_table), .next_rd(next_rd), .next_wr(next_wr));
  (* keep *) wire [23:0] place; (* keep *) wire [31:0] length, rd_now, wr_now; (* keep *) wire [7:0] follower;
  reg first = 1;
  always @(posedge clk) first <= 0;
  always @* assume (rst_n == !first);
  always @* assume (req_table < @tables@);
  reg [2:0] since = 0;                 // windows have 4 cycles at least
  always @(posedge clk) since <= (!rst_n | tick) ? 3'd0 : (since == 3'd7) ? since : since + 3'd1;
  always @* if (tick) assume (since >= 3 & rst_n);

  // of an entry: its table, its windows [from, to), and its budgets; of a table: what follows it, and its windows
  function [135:0] entry(input [23:0] place); case (place)
@entries@
    default: entry = {8'hff, 128'd0};
  endcase endfunction
  function [39:0] head(input [7:0] number); case (number)
@heads@
    default: head = 40'd0;
  endcase endfunction
  wire [7:0] of; wire [31:0] from, to, rd, wr;
  assign {of, from, to, rd, wr} = entry(place);
  reg [31:0] rd_given = 0, wr_given = 0;  // as handed out at the tick before this window
  always @(posedge clk)
    if (!rst_n) begin rd_given <= 0; wr_given <= 0; end
    else if (tick) begin rd_given <= next_rd; wr_given <= next_wr; end
  always @* if (!first) begin
    asked: assert (!pending | pending_table < @tables@);
    if (running) begin
      placed:  assert (of == table_now & from <= window_now & window_now < to);
      granted: assert (rd_given == rd & wr_given == wr & rd_now == rd & wr_now == wr);
      headed:  assert ({follower, length} == head(table_now));
    end
  end
endmodule
`default_nettype wire
