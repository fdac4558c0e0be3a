#!/bin/sh
# MemGuard limits of mode "fast", model switching, platform platform; schedule 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef
# Events (cache lines) per period for core 0, 1, ...; they apply from the next period on.
set -e
cd /sys/kernel/debug/memguard
echo 25 1 > read_limit
echo 1 1 > write_limit
