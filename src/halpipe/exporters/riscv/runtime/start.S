# Every hart enters here, in main memory; a hart 0 with a scratchpad copies the runtime there first.
#include "platform.h"
# Hart 0 is the management core; the others wait to be sent to their monitors.
    .section .text.init, "ax"
    .globl _start
_start:
    csrw mie, zero
    csrci mstatus, 8               # boot ROMs may enter with interrupts enabled
    csrr a0, mhartid
    la t0, trapped
    csrw mtvec, t0
    beqz a0, manage
    li t0, 8                       # wake on the software interrupt, without taking it
    csrw mie, t0
1:  wfi
    csrr t1, mip
    andi t1, t1, 8
    beqz t1, 1b
    fence.i
    la t0, hp_monitors
    slli t1, a0, 3
    add t0, t0, t1
    ld t0, 0(t0)
    jr t0                          # a0 = hart id
manage:
#ifdef HP_SCRATCHPAD
    la t0, __runtime_load
    la t1, __runtime
    la t2, __runtime_end
0:  ld t3, 0(t0)
    sd t3, 0(t1)
    addi t0, t0, 8
    addi t1, t1, 8
    bltu t1, t2, 0b
    fence.i
#endif
    la sp, __stack_top
    la t0, __bss_begin
    la t1, __bss_end
2:  bgeu t0, t1, 3f
    sd zero, 0(t0)
    addi t0, t0, 8
    j 2b
3:  call runtime
4:  wfi
    j 4b

    .balign 4
trapped:                           # a fault of the management core itself: leave its cause where it can be read
    csrw mie, zero                 # sleep from then on
    csrr t0, mhartid
    bnez t0, 5f
    la t1, halpipe_control
    csrr t2, mcause
    sd t2, 128(t1)
    csrr t2, mepc
    sd t2, 136(t1)
    li t2, 4
    sd t2, 72(t1)
5:  wfi
    j 5b
