#!/bin/sh
# Bandwidth shares of mode "fast", model switching, platform platform; schedule 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef
# Needs Linux 4.12 or later, a processor with MBA, and resctrl mounted without mba_MBps.
# The tasks of a unit belong into its group; all others get the least share. Approximate, no hard bound.
set -e
cd /sys/fs/resctrl
expect() {
  [ "$2" = "$3" ] || { echo "$1 is $2, the platform file says $3" >&2; exit 1; }
}
shown() {
  sed -n 's/^ *MB:/MB:/p' "$1/schemata" | tr -d ' '
}
put() {
  echo "$2" > "$1/schemata" || { echo "$1: $2: $(cat info/last_cmd_status)" >&2; exit 1; }
  [ "$(cat info/last_cmd_status)" = ok ] || { echo "$1: $2: $(cat info/last_cmd_status)" >&2; exit 1; }
  [ "$(shown "$1")" = "$3" ] || { echo "$1: $2 became $(shown "$1"), not $3" >&2; exit 1; }
}
expect mba_MBps "$(grep -c ' /sys/fs/resctrl resctrl [^ ]*mba_MBps' /proc/mounts)" 0
expect min_bandwidth "$(cat info/MB/min_bandwidth)" 10
expect bandwidth_gran "$(cat info/MB/bandwidth_gran)" 10
expect domains "$(shown . | sed 's/MB://; s/=[0-9]*//g')" '0'
[ "$(cat info/MB/num_closids)" -gt 2 ] || { echo "num_closids is $(cat info/MB/num_closids), needed are 3" >&2; exit 1; }
mkdir -p one
mkdir -p two
put . 'MB:0=10' 'MB:0=10'
put one 'MB:0=10' 'MB:0=10'
put two 'MB:0=10' 'MB:0=10'
