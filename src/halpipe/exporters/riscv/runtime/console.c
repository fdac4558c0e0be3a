/* What an emulator or a terminal sees at the end of a run. Nothing here is used while a schedule is played. */
#include "halpipe.h"

static void put(char c) {
#if HP_UART_KIND == HP_UART_NS16550
    *(volatile uint8_t *)HP_UART = (uint8_t)c;
#else /* SiFive */
    volatile uint32_t *transmit = (volatile uint32_t *)HP_UART;
    while (*transmit & 0x80000000u) {
    }
    *transmit = (uint8_t)c;
#endif
}

static void put_text(const char *text) {
    while (*text) put(*text++);
}

static void put_number(uint64_t value) {
    int shift = 60;
    while (shift > 0 && !(value >> shift)) shift -= 4;
    for (; shift >= 0; shift -= 4) put("0123456789abcdef"[value >> shift & 15]);
}

static void put_words(const char *name, const volatile uint64_t *words, unsigned count) {
    put_text(name);
    for (unsigned i = 0; i < count; i++) {
        put(' ');
        put_number(words[i]);
    }
    put('\n');
}

/* Prints the control block, the trace and the faults that are still in their rings: hexadecimal words, one record a line. */
void report(void) {
    put_words("control", (const volatile uint64_t *)CONTROL, sizeof(hp_control) / 8);
    uint64_t count = CONTROL->traced;
    for (uint64_t i = count > HP_TRACE_CAPACITY ? count - HP_TRACE_CAPACITY : 0; i < count; i++) {
        put_words("trace", (const volatile uint64_t *)&TRACE[i % HP_TRACE_CAPACITY], sizeof(hp_record) / 8);
    }
    count = CONTROL->faults;
    for (uint64_t i = count > HP_FAULT_CAPACITY ? count - HP_FAULT_CAPACITY : 0; i < count; i++) {
        put_words("fault", (const volatile uint64_t *)&FAULTS[i % HP_FAULT_CAPACITY], sizeof(hp_fault) / 8);
    }
    put_text("end\n");
}

/* Ends the emulation where the control block asks for it; otherwise the core sleeps. */
void leave(int is_clean) {
    if (CONTROL->exit == 1) { /* semihosting SYS_EXIT_EXTENDED */
        volatile uint64_t reason[2] = {0x20026, is_clean ? 0 : 1};
        register uint64_t a0 __asm__("a0") = 0x20;
        register volatile uint64_t *a1 __asm__("a1") = reason;
        __asm__ volatile(".option push\n.option norvc\n.balign 16\n"
                         " slli x0, x0, 0x1f\n ebreak\n srai x0, x0, 7\n.option pop"
                         : "+r"(a0) : "r"(a1) : "memory");
    }
#ifdef HP_FINISHER
    if (CONTROL->exit == 2) *(volatile uint32_t *)HP_FINISHER = is_clean ? 0x5555 : 1 << 16 | 0x3333;
#endif
    MTIMECMP(0) = ~0ull;
    for (;;) WFI();
}
