// Plays the tables of one unit: which table, which window of it, and the budgets of the window that comes next.
//
// The entry of the next window is read from block RAM all through the window before, into one register, so that it stands
// ready when the window ends. A request therefore has to be there two cycles before the last window of a table ends; one
// that comes later waits for the next end of a table. It is dropped if another request is followed at this end: it was
// made for the table that ends, and would be followed after another one.
//
// Between the default budgets and the first table lies one window without any budget: what was shown before it passes in
// it, and the first table begins with nothing carried over.
`default_nettype none
module halpipe_regulator_player #(
  parameter integer DEPTH   = 1024,  // entries of all tables of the unit, with the terminator; 2 at least
  parameter integer TABLES  = 16,    // headers, 2 to 256
  parameter         TABFILE = "",    // $readmemh images; without them software writes the tables
  parameter         HDRFILE = ""     // the latter with as many lines as TABLES
)(
  input  wire        clk,
  input  wire        rst_n,
  input  wire        tick,           // last cycle of a window
  input  wire        go,             // play tables; otherwise the default budgets hold
  input  wire [31:0] def_rd,
  input  wire [31:0] def_wr,
  input  wire        req_valid,      // when the table in force ends, go to req_table instead of its successor
  input  wire [7:0]  req_table,
  input  wire [2:0]  entry_write,    // write enables of {first window, read bytes, write bytes}
  input  wire [1:0]  header_write,   // write enables of {successor and base, windows}
  // verilator lint_off UNUSEDSIGNAL
  input  wire [15:0] write_index,    // as many bits of it as the tables are deep
  // verilator lint_on UNUSEDSIGNAL
  input  wire [95:0] write_data,
  output reg         running,
  output reg  [7:0]  table_now,
  output reg  [31:0] window_now,     // ffffffff while not running
  output reg         pending,
  output reg  [7:0]  pending_table,
  output reg  [7:0]  entry_table,    // whose entry is ready for the next window, if that is the first of a table
  output wire [31:0] next_rd,        // budgets of the window that begins after `tick`, in bytes
  output wire [31:0] next_wr
);
  localparam integer EA = $clog2(DEPTH);
  localparam integer HA = $clog2(TABLES);

  // Entry: {first window, read bytes, write bytes}; header: {successor, base, windows}.
  reg [95:0] entries [0:DEPTH-1];
  reg [63:0] headers [0:TABLES-1];
  integer i;
  initial begin
    if (TABFILE != "") $readmemh(TABFILE, entries);
    if (HDRFILE != "") $readmemh(HDRFILE, headers);   // has a line for each header: Yosys would let zeros prevail
    else for (i = 0; i < TABLES; i = i + 1) headers[i] = 64'd0;
  end

  reg [23:0] entry_now;                              // index of the entry in force,
  reg [31:0] rd_now, wr_now;                         // what it says,
  reg [31:0] windows;                                // and length and successor of the table
  reg [7:0]  successor;
  wire ends = (window_now + 32'd1 == windows);

  // What comes next, looked up in each cycle. Registered together with the entry, so that both belong to one choice.
  wire       begins = ~running | ends;               // the next window is the first of a table
  wire [7:0] choice = pending ? pending_table : running ? successor : 8'd0;
  wire [63:0] header = headers[choice[HA-1:0]];
  wire [23:0] address = begins ? header[55:32] : entry_now + 24'd1;
  reg [95:0] entry;
  reg [31:0] entry_windows;
  reg [7:0]  entry_successor;
  reg [23:0] entry_address;
  reg        entry_begins, entry_requested, requested_late;
  always @(posedge clk) begin
    if (entry_write[2]) entries[write_index[EA-1:0]][95:64] <= write_data[95:64];
    if (entry_write[1]) entries[write_index[EA-1:0]][63:32] <= write_data[63:32];
    if (entry_write[0]) entries[write_index[EA-1:0]][31:0]  <= write_data[31:0];
    entry <= entries[address[EA-1:0]];
  end
  always @(posedge clk) begin
    if (header_write[1]) headers[write_index[HA-1:0]][63:32] <= write_data[63:32];
    if (header_write[0]) headers[write_index[HA-1:0]][31:0]  <= write_data[31:0];
  end
  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      entry_windows <= 0; entry_successor <= 0; entry_table <= 0; entry_address <= 0; entry_begins <= 1'b1;
      entry_requested <= 1'b0; requested_late <= 1'b0;
    end else begin
      entry_windows <= header[31:0]; entry_successor <= header[63:56];
      entry_table <= choice; entry_address <= address; entry_begins <= begins; entry_requested <= pending;
      requested_late <= req_valid;                   // not part of the choice that is registered now
    end

  // A table without windows was never written: it gets one window of the default budgets, and then table 0 is next.
  reg  calm;                                         // this is the window without budgets
  wire calms = go & ~running & ~calm;                // the next one is
  wire plays = go & ~calms & ~(entry_begins & (entry_windows == 32'd0));
  wire applies = entry_begins | (entry[95:64] == window_now + 32'd1);
  assign next_rd = calms ? 32'd0 : !plays ? def_rd : applies ? entry[63:32] : rd_now;
  assign next_wr = calms ? 32'd0 : !plays ? def_wr : applies ? entry[31:0]  : wr_now;

  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      running <= 1'b0; table_now <= 0; window_now <= 32'hffffffff; entry_now <= 0; windows <= 0; successor <= 0;
      rd_now <= 0; wr_now <= 0; calm <= 1'b0;
    end else if (tick) begin
      running <= plays; calm <= calms;
      rd_now <= next_rd; wr_now <= next_wr;
      if (!plays) begin
        table_now <= 0; window_now <= 32'hffffffff;
      end else begin
        window_now <= entry_begins ? 32'd0 : window_now + 32'd1;
        if (applies) entry_now <= entry_address;
        if (entry_begins) begin
          table_now <= entry_table; windows <= entry_windows; successor <= entry_successor;
        end
      end
    end

  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      pending <= 1'b0; pending_table <= 0;
    end else if (tick & go & ~calms & entry_begins & entry_requested) pending <= 1'b0;
    else if (req_valid) begin
      pending <= 1'b1; pending_table <= req_table;
    end else if (tick & go & ~calms & entry_begins & ~requested_late) pending <= 1'b0;
endmodule
`default_nettype wire
