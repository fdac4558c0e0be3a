"""Check for Linux resctrl: model of the device."""
