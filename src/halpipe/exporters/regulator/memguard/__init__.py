"""Export for MemGuard: writer and templates."""
