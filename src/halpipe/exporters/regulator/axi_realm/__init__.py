"""Export for AXI-REALM: writer and templates."""
