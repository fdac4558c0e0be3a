#!/bin/sh
# Does the reads of a register script, and its writes before the table begins, by devmem; stops at a value out of its range.
# Usage: load.sh setup.txt, then load.sh with the script of a table. Later writes are for an interrupt handler. schedule 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef
set -e
grep -v '^//' "$1" | tr '(,)' '   ' | while read -r what a b c d; do
  case "$what $a" in
  "WRITE -1") devmem $((0x0 + b)) 32 "$c" ;;
  READ*)
    have=$(devmem $((0x0 + a)) 32)
    have=$((have & b))
    [ $((c)) -le "$have" ] && [ "$have" -le $((d)) ] || { echo "$1: register $a is $have, not from $((c)) to $((d))" >&2; exit 1; }
    ;;
  esac
done
