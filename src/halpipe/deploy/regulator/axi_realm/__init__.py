"""Check for AXI-REALM: model of the device."""
