"""Readers: files in, a task model or a schedule out, with diagnostics and the coverage of every element."""
