/* What an emulator or a terminal sees at the end of a run. Nothing here is used while a schedule is played. */
#include "halpipe.h"

#define SEMIHOSTING 1U
#define FINISHER 2U
#define EXIT_EXTENDED 0x20UL
#define APPLICATION_EXIT 0x20026UL

#define LINE_STATUS 5U
#define LINE_EMPTY 0x20U
#if HP_UART_KIND == HP_UART_NS16550X4
typedef uint32_t uart_register;
#else
typedef uint8_t uart_register;
#endif

static void put(char c) {
#if (HP_UART_KIND == HP_UART_NS16550) || (HP_UART_KIND == HP_UART_NS16550X4)
    volatile uart_register *registers = (volatile uart_register *)HP_UART;
    while ((registers[LINE_STATUS] & LINE_EMPTY) == 0U) {
    }
    registers[0] = (uint8_t)c;
#elif HP_UART_KIND == HP_UART_LITEX
    volatile uint32_t *data = (volatile uint32_t *)HP_UART; /* then: whether there is no room */
    while ((data[1] & 1U) != 0U) {
    }
    data[0] = (uint8_t)c;
#else /* SiFive */
    volatile uint32_t *transmit = (volatile uint32_t *)HP_UART;
    while ((*transmit & 0x80000000U) != 0U) {
    }
    *transmit = (uint8_t)c;
#endif
}

static void put_text(const char *text) {
    for (uint32_t i = 0U; text[i] != '\0'; i++) {
        put(text[i]);
    }
}

static void put_number(uint64_t value) {
    static const char digits[] = "0123456789abcdef";
    uint32_t shift = 64U;
    do {
        shift -= 4U;
    } while ((shift > 0U) && ((value >> shift) == 0U));
    for (uint32_t left = (shift / 4U) + 1U; left > 0U; left--) {
        uint32_t digit = (uint32_t)(value >> (((uint64_t)left - 1U) * 4U)) & 15U;
        put(digits[digit]);
    }
}

static void put_words(const char *name, const volatile uint64_t *words, uint64_t count) {
    put_text(name);
    for (uint64_t i = 0U; i < count; i++) {
        put(' ');
        put_number(words[i]);
    }
    put('\n');
}

static uint64_t first_of(uint64_t count, uint64_t capacity) {
    uint64_t first = 0U;
    if (count > capacity) {
        first = count - capacity;
    }
    return first;
}

/* Prints the control block, the trace and the faults that are still in their rings: hexadecimal words, one record a line. */
void print_report(void) {
    put_words("control", (const volatile uint64_t *)HP_CONTROL, sizeof(hp_control) / 8U);
    uint64_t count = CONTROL->traced;
    for (uint64_t i = first_of(count, HP_TRACE_CAPACITY); i < count; i++) {
        put_words("trace", (const volatile uint64_t *)&TRACE[i % HP_TRACE_CAPACITY], sizeof(hp_record) / 8U);
    }
    count = CONTROL->faults;
    for (uint64_t i = first_of(count, HP_FAULT_CAPACITY); i < count; i++) {
        put_words("fault", (const volatile uint64_t *)&FAULTS[i % HP_FAULT_CAPACITY], sizeof(hp_fault) / 8U);
    }
#ifdef HP_CALIBRATE
    for (uint64_t i = 0U; i < CALIBRATION->count; i++) {
        put_words("calibration", (const volatile uint64_t *)&CALIBRATION->entries[i], sizeof(hp_calibration) / 8U);
    }
#endif
    put_text("end\n");
}

/* Ends the emulation where the control block asks for it; otherwise the core sleeps. */
void leave(uint64_t status) {
    if (CONTROL->exit == SEMIHOSTING) {
        volatile uint64_t reason[2] = {APPLICATION_EXIT, status};
        register uint64_t a0 __asm__("a0") = EXIT_EXTENDED;
        register volatile uint64_t *a1 __asm__("a1") = reason;
        __asm__ volatile(".option push\n.option norvc\n.balign 16\n"
                         " slli x0, x0, 0x1f\n ebreak\n srai x0, x0, 7\n.option pop"
                         : "+r"(a0) : "r"(a1) : "memory");
    }
#ifdef HP_FINISHER
    if (CONTROL->exit == FINISHER) {
        *(volatile uint32_t *)HP_FINISHER = (status == 0U) ? 0x5555U : 0x13333U;
    }
#endif
    MTIMECMP(0U) = NEVER;
    for (;;) {
        wait_for_interrupt();
    }
}
