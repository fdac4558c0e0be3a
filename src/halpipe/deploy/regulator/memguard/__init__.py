"""Check for MemGuard: model of the device."""
