/* Bench of Rocket tiles: main memory and devices behind their AXI ports, in C++.
 *
 *     rocket IMAGE MEMORY CYCLES
 *
 * begins with a file in main memory of so many bytes, prints what the serial line sends, and ends with the status that
 * is written to the finisher, or with 101 after so many cycles. */
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

#include "VExampleRocketSystem.h"
#include "verilated.h"

static const uint64_t MAIN = 0x80000000UL, ROM = 0x10000000UL, UART = 0x20000000UL, FINISHER = 0x30000000UL;
static const uint32_t BOOT[] = {0x00100293, 0x01f29293, 0x00028067}; /* li t0, 1; slli t0, t0, 31; jr t0 */
static const int LATENCY = 25, RESET = 40;

static std::vector<uint8_t> memory;
static int status = -1;

static uint64_t load(uint64_t address) {
    uint64_t word = 0;
    if (address >= MAIN && address - MAIN + 8 <= memory.size()) {
        memcpy(&word, &memory[address - MAIN], 8);
    } else if (address >= ROM && address < ROM + sizeof BOOT) {
        memcpy(&word, (const char *)BOOT + (address - ROM), address == ROM ? 8 : 4);
    }
    return word;
}

static void store(uint64_t address, uint64_t word, uint8_t strobe) {
    if (address >= MAIN) {
        for (uint64_t i = 0; i < 8; i++) {
            if ((strobe >> i & 1) && address - MAIN + i < memory.size()) memory[address - MAIN + i] = word >> (8 * i);
        }
    } else if (address == UART && (strobe & 1)) {
        putchar((int)(word & 0xff));
    } else if (address == FINISHER) {
        status = (int)(word >> 16 & 0xffff);
    }
}

/* One burst to read and one to write at a time. */
struct Port {
    int latency;
    bool reads, writes, answers;
    uint64_t from, to;
    int left, wait, size, read_id, write_id;
};

/* What passed a port in this cycle, before the edge of the clock. */
#define TAKE(PORT, p)                                                                                                  \
    do {                                                                                                               \
        if (top->PORT##ar_valid && top->PORT##ar_ready) {                                                              \
            p.reads = true;                                                                                            \
            p.from = top->PORT##ar_bits_addr;                                                                          \
            p.left = top->PORT##ar_bits_len + 1;                                                                       \
            p.size = top->PORT##ar_bits_size;                                                                          \
            p.read_id = top->PORT##ar_bits_id;                                                                         \
            p.wait = p.latency;                                                                                        \
        } else if (top->PORT##r_valid && top->PORT##r_ready) {                                                         \
            p.from += 1UL << p.size;                                                                                   \
            p.reads = --p.left > 0;                                                                                    \
        }                                                                                                              \
        if (top->PORT##b_valid && top->PORT##b_ready) p.answers = false;                                               \
        if (top->PORT##aw_valid && top->PORT##aw_ready) {                                                              \
            p.writes = true;                                                                                           \
            p.to = top->PORT##aw_bits_addr & ~7UL;                                                                     \
            p.write_id = top->PORT##aw_bits_id;                                                                        \
        } else if (top->PORT##w_valid && top->PORT##w_ready) {                                                         \
            store(p.to, top->PORT##w_bits_data, top->PORT##w_bits_strb);                                               \
            p.to += 8;                                                                                                 \
            p.answers = top->PORT##w_bits_last;                                                                        \
            p.writes = !p.answers;                                                                                     \
        }                                                                                                              \
    } while (0)

#define DRIVE(PORT, p)                                                                                                 \
    do {                                                                                                               \
        p.wait -= p.wait > 0;                                                                                          \
        top->PORT##ar_ready = !p.reads;                                                                                \
        top->PORT##r_valid = p.reads && p.wait == 0;                                                                   \
        top->PORT##r_bits_id = p.read_id;                                                                              \
        top->PORT##r_bits_data = p.reads ? load(p.from & ~7UL) : 0;                                                    \
        top->PORT##r_bits_last = p.left == 1;                                                                          \
        top->PORT##aw_ready = !p.writes && !p.answers;                                                                 \
        top->PORT##w_ready = p.writes;                                                                                 \
        top->PORT##b_valid = p.answers;                                                                                \
        top->PORT##b_bits_id = p.write_id;                                                                             \
    } while (0)

int main(int argc, char **argv) {
    if (argc != 4) return 100;
    memory.resize(strtoul(argv[2], nullptr, 0));
    FILE *file = fopen(argv[1], "rb");
    if (file == nullptr || fread(memory.data(), 1, memory.size(), file) == 0) return 100;
    fclose(file);
    Verilated::commandArgs(argc, argv);
    VExampleRocketSystem *top = new VExampleRocketSystem;
    Port shared = {LATENCY}, device = {0};
    top->l2_frontend_bus_axi4_0_b_ready = top->l2_frontend_bus_axi4_0_r_ready = 1;
    top->debug_clockeddmi_dmi_resp_ready = 1;
    for (uint64_t cycle = 0, most = strtoul(argv[3], nullptr, 0); cycle < most && status < 0; cycle++) {
        bool resets = cycle < RESET;
        top->reset = top->debug_reset = top->debug_clockeddmi_dmiReset = resets;
        top->resetctrl_hartIsInReset_0 = top->resetctrl_hartIsInReset_1 = resets;
        top->resetctrl_hartIsInReset_2 = top->resetctrl_hartIsInReset_3 = resets;
        top->debug_dmactiveAck = top->debug_dmactive;
        top->clock = top->debug_clock = top->debug_clockeddmi_dmiClock = 0;
        top->eval();
        if (!resets) {
            TAKE(mem_axi4_0_, shared);
            TAKE(mmio_axi4_0_, device);
        }
        top->clock = top->debug_clock = top->debug_clockeddmi_dmiClock = 1;
        top->eval();
        DRIVE(mem_axi4_0_, shared);
        DRIVE(mmio_axi4_0_, device);
    }
    return status < 0 ? 101 : status;
}
