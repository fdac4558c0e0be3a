# Loops of known instructions, for the first core and for hart 0; they may lie anywhere. Each turn has 14 of its kind and 2 more.
#include "platform.h"
    .section .rodata.loops, "a"
    .balign 8
    .globl hp_loops, hp_loops_end, hp_loop_places
    .macro turns first, second
    li t0, CALIBRATE_TURNS
    li t1, -3
    li t2, 7
1:  .rept 7
    \first
    \second
    .endr
    addi t0, t0, -1
    bnez t0, 1b
    ret
    .endm
hp_loops:
first:    turns "addi t1, t1, 1", "xor t2, t2, t1"
second:   turns "mul t1, t1, t2", "mul t1, t1, t2"
third:    turns "divu t2, t1, t2", "divu t2, t1, t2"
fourth:   turns "sd t1, -8(sp)", "ld t1, -8(sp)"
    .balign 8
hp_loops_end:
hp_loop_places:
    .dword 0, second - first, third - first, fourth - first
