"""Readers: files in, a task model or a schedule out, with diagnostics and an account of every element."""
