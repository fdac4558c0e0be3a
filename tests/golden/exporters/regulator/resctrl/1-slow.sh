#!/bin/sh
# Bandwidth shares of mode "slow", model switching, platform platform; schedule 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef
# The tasks of a unit belong into its group; resctrl must be mounted on /sys/fs/resctrl. Approximate, no hard bound.
set -e
mkdir -p /sys/fs/resctrl/one
printf 'MB:0=10\n' > /sys/fs/resctrl/one/schemata
mkdir -p /sys/fs/resctrl/two
printf 'MB:0=30\n' > /sys/fs/resctrl/two/schemata
