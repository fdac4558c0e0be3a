#!/bin/sh
# MemGuard for model switching, platform platform; schedule 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef
# Run it before any task starts: it sets the default limits, in events per period and core.
set -e
[ "$(nproc --all)" = 2 ] || { echo "there are $(nproc --all) cores, the platform file says 2" >&2; exit 1; }
insmod memguard.ko g_period_us=1000
cd /sys/kernel/debug/memguard
put() {
  core=0
  echo "$2" > "$1"
  for events in $2; do
    grep -q "^CPU$core: $events " "$1" || { echo "$1: core $core did not take $events" >&2; exit 1; }
    core=$((core + 1))
  done
}
echo exclusive 0 > control
echo reclaim 0 > control
put read_limit '41 81'
put write_limit '41 81'
