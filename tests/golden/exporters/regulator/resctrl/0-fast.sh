#!/bin/sh
# Bandwidth shares of mode "fast", model switching, platform platform; schedule 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef
# Needs Linux 4.12 or later, a processor with MBA, and resctrl mounted without mba_MBps.
# The tasks of a unit belong into its group; all others get the least share. Approximate, no hard bound.
set -e
cd /sys/fs/resctrl
expect() {
  [ "$(cat "$1")" = "$2" ] || { echo "$1 is $(cat "$1"), the platform file says $2" >&2; exit 1; }
}
put() {
  echo "$2" > "$1/schemata" || { echo "$1: $2: $(cat info/last_cmd_status)" >&2; exit 1; }
  [ "$(cat info/last_cmd_status)" = ok ] || { echo "$1: $2: $(cat info/last_cmd_status)" >&2; exit 1; }
}
expect info/MB/min_bandwidth 10
expect info/MB/bandwidth_gran 10
mkdir -p one
mkdir -p two
put . 'MB:0=10'
put one 'MB:0=10'
put two 'MB:0=10'
