"""Export for Linux resctrl: writer and templates."""
