#!/bin/sh
# Writes the registers of a script by devmem, reads each back, and stops with a message where it is not there.
# Usage: load.sh setup.txt, then load.sh with the script of a table: its lines with -; the others are for an interrupt handler. schedule 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef
set -e
sed -e '/^#/d' -e 's/^- //' "$1" | while read -r offset value more; do
  [ -z "$more" ] || continue
  at=$((0x0 + offset))
  devmem "$at" 32 "$value"
  [ "$offset" != 0x7fc ] || continue
  have=$(devmem "$at" 32)
  [ $((have)) -eq $((value)) ] || { echo "$1: register $offset is $have, not $value" >&2; exit 1; }
done
