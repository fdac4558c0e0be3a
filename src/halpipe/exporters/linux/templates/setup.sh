#!/bin/sh
# Looks at what makes starts late on this machine, and corrects what can be corrected at run time. Written by halpipe.
#   setup.sh --check   only say;   setup.sh --apply   as root: governor, throttling
CPUS="{{ cpus | join(' ') }}"
apply=0
[ "$1" = --apply ] && apply=1
bad=0
say() { echo "setup: $*"; }
lacks() { say "$1"; echo "  remedy: $2"; bad=1; }

online=$(getconf _NPROCESSORS_ONLN)
for cpu in $CPUS; do
  [ "$cpu" -lt "$online" ] || lacks "CPU $cpu is not there: this machine has $online" "map the units to other CPUs: dispatcher --cpus"
  governor=/sys/devices/system/cpu/cpu$cpu/cpufreq/scaling_governor
  if [ -r "$governor" ] && [ "$(cat "$governor")" != performance ]; then
    if [ $apply = 1 ] && echo performance >"$governor" 2>/dev/null; then say "CPU $cpu: governor performance"
    else lacks "CPU $cpu: governor $(cat "$governor")" "setup.sh --apply as root"; fi
  fi
  grep -qw "$cpu" /sys/devices/system/cpu/isolated 2>/dev/null || isolated=no
done
[ "$isolated" = no ] && say "note: not all of these CPUs are isolated; boot with isolcpus=$(echo $CPUS | tr ' ' ,) nohz_full=... rcu_nocbs=... or use a cpuset partition (cpuset.cpus.partition=isolated)"
[ "$(cat /sys/kernel/realtime 2>/dev/null)" = 1 ] || say "note: the kernel is not PREEMPT_RT: starts may be late by more than 100 us under load"
runtime=$(cat /proc/sys/kernel/sched_rt_runtime_us 2>/dev/null || echo -1)
if [ "$runtime" -ge 0 ]; then
  if [ $apply = 1 ] && echo -1 >/proc/sys/kernel/sched_rt_runtime_us 2>/dev/null; then say "real-time throttling is off"
  else say "note: real-time threads get at most $runtime us of each second's 1000000: a table that fills a CPU is stopped"; fi
fi
[ "$(ulimit -r 2>/dev/null || echo 0)" != 0 ] || [ "$(id -u)" = 0 ] || say "note: no right to SCHED_FIFO in this shell; the systemd unit has it"
exit $bad
