# The monitor of one application core: first page of its instruction scratchpad. Entered with a0 = hart id.
    .section .text.init, "ax"
    .globl _monitor
    .globl start_monitor
_monitor:
start_monitor:
    ld sp, hp_site + 40
    call run_monitor

    .balign 4
    .globl monitor_trap
monitor_trap:                      # a job returned, faulted or overran: go on on a fresh stack
    ld sp, hp_site + 40
    call trapped

    .balign 4
    .globl job_return
job_return:                        # where jobs return to, in user mode
    ecall

# void start_job(entry, rank, ranks, stack): into user mode, with nothing in the registers but what is passed on
    .globl start_job
start_job:
    csrw mepc, a0
    li t0, 0x1800                  # mstatus.MPP = user
    csrc mstatus, t0
    li t0, 0x80                    # mstatus.MPIE
    csrs mstatus, t0
    mv sp, a3
    mv a0, a1
    mv a1, a2
    la ra, job_return
    .irp register, gp, tp, t0, t1, t2, s0, s1, a2, a3, a4, a5, a6, a7, s2, s3, s4, s5, s6, s7, s8, s9, s10, s11, t3, t4, t5, t6
    li \register, 0
    .endr
    mret

# Where this core is; the linker script knows. Its order is that of the numbers in monitor.c.
    .balign 8
    .globl hp_site
hp_site:
    .dword hp_hart, hp_ispm, hp_ispm_end, hp_dspm, hp_dspm_end, hp_mailbox, hp_job_stack, hp_job_end
