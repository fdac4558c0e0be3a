#!/bin/sh
# Writes the registers of a script by devmem, reads what can be read, and stops where a value is out of its range.
# Usage: load.sh setup.txt, then load.sh with the script of a table: its lines with -; the others are for an interrupt handler. schedule 0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef
set -e
sed '/^#/d' "$1" | while read -r what offset value least most; do
  at=$((0x0 + offset))
  case "$what" in
  -) devmem "$at" 32 "$value" ;;
  \?)
    have=$(devmem "$at" 32)
    have=$((have & value))
    [ $((least)) -le "$have" ] && [ "$have" -le $((most)) ] || { echo "$1: register $offset is $have, not from $((least)) to $((most))" >&2; exit 1; }
    ;;
  esac
done
