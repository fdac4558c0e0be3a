# Loops of known instructions, for the first core and for hart 0; they may lie anywhere. Each turn has 14 of its kind, or 7 and as
# many that use what these compute, and 2 more.
#include "platform.h"
    .section .rodata.loops, "a"
    .balign 8
    .globl hp_loops, hp_loops_end, hp_loop_places
    .option norvc
    .macro turns first, second, once=""
    li t0, CALIBRATE_TURNS
    li t1, -3
    li t2, 0
1:  .rept 7
    \first
    \second
    .endr
    \once
    addi t0, t0, -1
    bnez t0, 1b
    ret
    .endm
    .macro jump
    j 2f
    nop
2:
    .endm
    .macro other /* every second time to another place, which nothing predicts */
    auipc t1, 0
    add t1, t1, t2
    jr 16(t1)
    nop
    nop
    .endm
hp_loops:
adds:     turns "addi t1, t1, 1", "xor t3, t3, t1"
loads:    turns "ld t1, -8(sp)", "add t3, t1, t1"
bytes:    turns "lb t1, -8(sp)", "add t3, t1, t1"
products: turns "mul t3, t1, t1", "add t3, t3, t3"
shorter:  turns "mulw t3, t1, t1", "add t3, t3, t3"
quotients: turns "divu t3, t1, t2", "add t3, t3, t3" /* by zero, which takes longest */
jumps:    turns jump, jump
others:   turns other, "", "xori t2, t2, 4"
    .balign 8
hp_loops_end:
hp_loop_places:
    .dword adds - hp_loops, loads - hp_loops, bytes - hp_loops, products - hp_loops
    .dword shorter - hp_loops, quotients - hp_loops, jumps - hp_loops, others - hp_loops
