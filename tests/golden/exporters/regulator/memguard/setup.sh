#!/bin/sh
# MemGuard for model switching, platform platform; schedule 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef
# Run it before any task starts: it sets the default limits, in events per period and core.
set -e
insmod memguard.ko g_period_us=1000
cd /sys/kernel/debug/memguard
echo exclusive 0 > control
echo reclaim 0 > control
echo 38 38 > read_limit
echo 1 38 > write_limit
