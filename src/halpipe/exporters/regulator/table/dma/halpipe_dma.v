// DMA engine with the registers of SiFive's PDMA: channels that copy between memories in bursts, several of them under way.
//
// Channel n at n * 4 KiB, registers behind AXI4-Lite of 64 bits:
//   0x00 control  bit 0 CLAIM, bit 1 RUN, bit 30 DONE, bit 31 ERROR. Claiming clears 0x04 to 0x1f. RUN of a claimed channel
//                 starts a transfer; until it has ended control cannot be written. Giving the claim back clears all bits.
//   0x04 config   bits 24 to 27, 28 to 31: log2 of the bytes of a burst that is written, that is read
//   0x08 bytes, 0x10 target, 0x18 source: 64 bits each
// DONE comes with the answer to the last write. ERROR: the memory has answered a burst with an error, or an address or
// the bytes have more than ADDR bits; what was written before stays.
// On AXI4 the ID is the channel; channels take turns burst by burst. Bursts are INCR and end at multiples of their size.
`default_nettype none
module halpipe_dma #(
  parameter integer CHANNELS = 4,        // 1 to 16
  parameter integer ADDR  = 40,
  parameter integer SIZE  = 3,           // log2 of the bytes of a beat, 1 to 5
  parameter integer BURST = 6,           // log2 of the bytes of the longest burst, above SIZE and below 12
  parameter integer DEPTH = 6            // log2 of the beats of a channel's buffer: reads that are under way fit into it
)(
  input  wire                 clk,
  input  wire                 rst_n,
  // verilator lint_off UNUSEDSIGNAL
  // registers
  input  wire                 l_awvalid, output wire l_awready, input  wire [15:0] l_awaddr,
  input  wire                 l_wvalid,  output wire l_wready,  input  wire [63:0] l_wdata, input wire [7:0] l_wstrb,
  output reg                  l_bvalid,  input  wire l_bready,  output wire [1:0]  l_bresp,
  input  wire                 l_arvalid, output wire l_arready, input  wire [15:0] l_araddr,
  output reg                  l_rvalid,  input  wire l_rready,  output reg  [63:0] l_rdata, output wire [1:0] l_rresp,
  // memories
  output reg                  m_arvalid, input  wire m_arready, output reg  [ADDR-1:0] m_araddr, output reg [7:0] m_arlen,
  output reg  [3:0]           m_arid,    output wire [2:0] m_arsize, output wire [1:0] m_arburst,
  input  wire                 m_rvalid,  output wire m_rready,  input  wire [(8<<SIZE)-1:0] m_rdata, input wire [3:0] m_rid,
  input  wire [1:0]           m_rresp,   input  wire m_rlast,
  output reg                  m_awvalid, input  wire m_awready, output reg  [ADDR-1:0] m_awaddr, output reg [7:0] m_awlen,
  output reg  [3:0]           m_awid,    output wire [2:0] m_awsize, output wire [1:0] m_awburst,
  output wire                 m_wvalid,  input  wire m_wready,  output wire [(8<<SIZE)-1:0] m_wdata,
  output wire [(1<<SIZE)-1:0] m_wstrb,   output wire m_wlast,
  input  wire                 m_bvalid,  output wire m_bready,  input  wire [3:0] m_bid, input wire [1:0] m_bresp
  // verilator lint_on UNUSEDSIGNAL
);
  localparam integer BEAT = 1 << SIZE, WIDTH = 8 << SIZE;
  assign {m_arsize, m_awsize} = {SIZE[2:0], SIZE[2:0]};
  assign {m_arburst, m_awburst, l_bresp, l_rresp} = {2'd1, 2'd1, 2'd0, 2'd0};
  assign {m_rready, m_bready} = 2'b11;

  // ---------------------------------------------------------------------------------------------- registers
  wire l_write = l_awvalid & l_wvalid & (~l_bvalid | l_bready);
  wire l_read  = l_arvalid & (~l_rvalid | l_rready);
  assign {l_awready, l_wready, l_arready} = {l_write, l_write, l_read};
  wire [64*CHANNELS-1:0] shown;          // what a read of this address shows of each channel
  reg  [63:0] answer;
  integer c;
  always @* begin
    answer = 64'd0;
    for (c = 0; c < CHANNELS; c = c + 1) if ({28'd0, l_araddr[15:12]} == c) answer = shown[64*c +: 64];
  end
  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      l_bvalid <= 1'b0; l_rvalid <= 1'b0; l_rdata <= 64'd0;
    end else begin
      l_bvalid <= l_write | (l_bvalid & ~l_bready);
      l_rvalid <= l_read | (l_rvalid & ~l_rready);
      if (l_read) l_rdata <= answer;
    end

  // ---------------------------------------------------------------------------------------------- channels
  wire [CHANNELS-1:0] ar_want, aw_want, ar_take, aw_take, w_beat;
  wire [ADDR*CHANNELS-1:0] ar_addr, aw_addr; wire [8*CHANNELS-1:0] ar_len, aw_len;
  wire [SIZE*CHANNELS-1:0] aw_end; wire [WIDTH*CHANNELS-1:0] w_data;
  genvar i;
  generate for (i = 0; i < CHANNELS; i = i + 1) begin : channel
    reg         claim, run, done, error;
    reg  [31:0] config_; reg [63:0] bytes, target, source;
    wire        here = l_write & ({28'd0, l_awaddr[15:12]} == i) & (l_awaddr[11:5] == 7'd0);
    wire        orders = here & (l_awaddr[4:3] == 2'd0) & l_wstrb[0] & ~run;
    wire        claims = orders & l_wdata[0] & ~claim;
    wire        starts = orders & l_wdata[0] & claim & l_wdata[1];
    reg         begun;                   // the transfer has been given to the channel
    wire        begins = run & ~begun;
    wire        wide = |{bytes >> ADDR, target >> ADDR, source >> ADDR};
    wire        ends, failed;
    wire        over = begun ? ends : begins & wide;
    integer     n;
    always @(posedge clk or negedge rst_n)
      if (!rst_n) begin
        claim <= 1'b0; run <= 1'b0; done <= 1'b0; error <= 1'b0; begun <= 1'b0;
        config_ <= 32'd0; bytes <= 64'd0; target <= 64'd0; source <= 64'd0;
      end else begin
        if (orders & ~l_wdata[0]) {claim, done, error} <= 3'd0;
        if (claims) begin claim <= 1'b1; config_ <= 32'd0; bytes <= 64'd0; target <= 64'd0; source <= 64'd0; end
        else for (n = 0; n < 8; n = n + 1) if (here & l_wstrb[n]) begin
          if ((l_awaddr[4:3] == 2'd0) & (n > 3)) config_[8*(n%4) +: 8] <= l_wdata[8*n +: 8];
          if (l_awaddr[4:3] == 2'd1) bytes[8*n +: 8] <= l_wdata[8*n +: 8];
          if (l_awaddr[4:3] == 2'd2) target[8*n +: 8] <= l_wdata[8*n +: 8];
          if (l_awaddr[4:3] == 2'd3) source[8*n +: 8] <= l_wdata[8*n +: 8];
        end
        begun <= run & ~over;
        if (starts) run <= 1'b1;
        else if (over) begin
          run <= 1'b0;
          if (failed | ~begun) error <= 1'b1; else done <= 1'b1;
        end
      end
    assign shown[64*i +: 64] = (l_araddr[11:5] != 7'd0) ? 64'd0
      : (l_araddr[4:3] == 2'd0) ? {config_, error, done, 28'd0, run, claim}
      : (l_araddr[4:3] == 2'd1) ? bytes : (l_araddr[4:3] == 2'd2) ? target : source;
    halpipe_dma_channel #(.ADDR(ADDR), .SIZE(SIZE), .BURST(BURST), .DEPTH(DEPTH)) copies (
      .clk(clk), .rst_n(rst_n), .start(begins & ~wide), .source(source[ADDR-1:0]), .target(target[ADDR-1:0]),
      .bytes(bytes[ADDR-1:0]), .read_log(config_[31:28]), .write_log(config_[27:24]),
      .ends(ends), .failed(failed),
      .ar_want(ar_want[i]), .ar_addr(ar_addr[ADDR*i +: ADDR]), .ar_len(ar_len[8*i +: 8]), .ar_take(ar_take[i]),
      .r_beat(m_rvalid & ({28'd0, m_rid} == i)), .r_error(m_rresp[1]), .r_data(m_rdata),
      .aw_want(aw_want[i]), .aw_addr(aw_addr[ADDR*i +: ADDR]), .aw_len(aw_len[8*i +: 8]),
      .aw_end(aw_end[SIZE*i +: SIZE]), .aw_take(aw_take[i]), .w_data(w_data[WIDTH*i +: WIDTH]), .w_beat(w_beat[i]),
      .b_beat(m_bvalid & ({28'd0, m_bid} == i)), .b_error(m_bresp[1]));
  end endgenerate

  // ---------------------------------------------------------------------------------------------- turns
  reg  [CHANNELS-1:0] read_mask, write_mask;       // channels behind the one that had the last turn
  wire [CHANNELS-1:0] read_upper = ar_want & read_mask, write_upper = aw_want & write_mask;
  wire [CHANNELS-1:0] read_pick = (read_upper != 0) ? read_upper : ar_want;
  wire [CHANNELS-1:0] write_pick = (write_upper != 0) ? write_upper : aw_want;
  wire [CHANNELS-1:0] read_grant = read_pick & (~read_pick + 1'b1), write_grant = write_pick & (~write_pick + 1'b1);
  reg  now_valid, next_valid;            // bursts whose data is being written, and is written then
  wire reads = ~m_arvalid | m_arready, writes = (~m_awvalid | m_awready) & ~next_valid;
  assign ar_take = reads ? read_grant : {CHANNELS{1'b0}};
  assign aw_take = writes ? write_grant : {CHANNELS{1'b0}};

  reg [ADDR-1:0] read_addr, write_addr; reg [7:0] read_len, write_len; reg [3:0] read_id, write_id; reg [SIZE-1:0] write_end;
  always @* begin
    {read_addr, read_len, read_id, write_addr, write_len, write_id, write_end} = 0;
    for (c = 0; c < CHANNELS; c = c + 1) begin
      if (read_grant[c]) {read_addr, read_len, read_id} = {ar_addr[ADDR*c +: ADDR], ar_len[8*c +: 8], c[3:0]};
      if (write_grant[c]) {write_addr, write_len, write_id, write_end} = {aw_addr[ADDR*c +: ADDR], aw_len[8*c +: 8], c[3:0], aw_end[SIZE*c +: SIZE]};
    end
  end

  // ---------------------------------------------------------------------------------------------- data of writes
  reg  [7:0] now_left, next_left; reg [3:0] now_id, next_id; reg [SIZE-1:0] now_first, next_first, now_end, next_end;
  assign m_wvalid = now_valid;
  assign m_wlast = (now_left == 8'd0);
  wire passes = m_wvalid & m_wready;
  reg  [WIDTH-1:0] data;
  always @* begin
    data = 0;
    for (c = 0; c < CHANNELS; c = c + 1) if ({28'd0, now_id} == c) data = w_data[WIDTH*c +: WIDTH];
  end
  assign m_wdata = data;
  generate for (i = 0; i < CHANNELS; i = i + 1) begin : beats
    assign w_beat[i] = passes & ({28'd0, now_id} == i);
  end
  for (i = 0; i < BEAT; i = i + 1) begin : strobe
    assign m_wstrb[i] = (i >= now_first) & (~m_wlast | (now_end == 0) | (i < now_end));
  end endgenerate
  wire frees = ~now_valid | (passes & m_wlast);    // the next burst's data may follow
  wire takes = |aw_take;
  always @(posedge clk or negedge rst_n)
    if (!rst_n) begin
      m_arvalid <= 1'b0; m_araddr <= 0; m_arlen <= 8'd0; m_arid <= 4'd0; m_awvalid <= 1'b0; m_awaddr <= 0; m_awlen <= 8'd0; m_awid <= 4'd0;
      read_mask <= 0; write_mask <= 0; now_valid <= 1'b0; next_valid <= 1'b0;
      now_left <= 8'd0; next_left <= 8'd0; now_id <= 4'd0; next_id <= 4'd0; now_first <= 0; next_first <= 0; now_end <= 0; next_end <= 0;
    end else begin
      if (reads) begin
        m_arvalid <= |ar_want;
        if (|ar_want) begin {m_araddr, m_arlen, m_arid} <= {read_addr, read_len, read_id}; read_mask <= ~(read_grant | (read_grant - 1'b1)); end
      end
      if (takes) begin
        m_awvalid <= 1'b1; {m_awaddr, m_awlen, m_awid} <= {write_addr[ADDR-1:SIZE], {SIZE{1'b0}}, write_len, write_id};
        write_mask <= ~(write_grant | (write_grant - 1'b1));
      end else if (m_awready) m_awvalid <= 1'b0;
      if (passes) begin now_left <= now_left - 8'd1; now_first <= 0; end
      if (frees) begin
        now_valid <= next_valid | takes;
        {now_left, now_id, now_first, now_end} <= next_valid ? {next_left, next_id, next_first, next_end}
                                                             : {write_len, write_id, write_addr[SIZE-1:0], write_end};
      end
      next_valid <= (frees ? 1'b0 : next_valid | takes);
      if (takes & ~frees) {next_left, next_id, next_first, next_end} <= {write_len, write_id, write_addr[SIZE-1:0], write_end};
    end
endmodule
`default_nettype wire
