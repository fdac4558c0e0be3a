#!/bin/sh
# MemGuard limits of transition "fast->slow", model switching, platform platform; schedule 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef
# Events (cache lines) per period for core 0, 1, ...; they apply from the next period on. Limits fall before others rise.
set -e
cd /sys/kernel/debug/memguard
put() {
  core=0
  echo "$2" > "$1"
  for events in $2; do
    grep -q "^CPU$core: $events " "$1" || { echo "$1: core $core did not take $events" >&2; exit 1; }
    core=$((core + 1))
  done
}
put read_limit '25 1'
put write_limit '25 1'
put read_limit '25 40'
put write_limit '25 40'
