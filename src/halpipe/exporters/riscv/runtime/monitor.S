# The monitor of one application core: first page of its instruction scratchpad. Entered with a0 = hart id.
    .section .text.init, "ax"
    .globl _monitor
_monitor:
    ld sp, hp_site + 40
    call monitor

    .balign 4
    .globl monitor_trap
monitor_trap:                      # a job faulted or overran: abandon it on a fresh stack
    ld sp, hp_site + 40
    call abandon

# void call_job(entry, rank, ranks, stack)
    .globl call_job
call_job:
    addi sp, sp, -16
    sd ra, 0(sp)
    sd s0, 8(sp)
    mv s0, sp
    mv t0, a0
    mv a0, a1
    mv a1, a2
    mv sp, a3
    jalr t0
    mv sp, s0
    ld ra, 0(sp)
    ld s0, 8(sp)
    addi sp, sp, 16
    ret

# Where this core is; the linker script knows. Its order is that of the enum in monitor.c.
    .balign 8
    .globl hp_site
hp_site:
    .dword hp_hart, hp_ispm, hp_ispm_end, hp_dspm, hp_dspm_end, hp_mailbox, hp_job_stack
