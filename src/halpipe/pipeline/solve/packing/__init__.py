"""Modes in which every task runs once and waits for nobody: what shares units or a resource is packed, and no more."""
