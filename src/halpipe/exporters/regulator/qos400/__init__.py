"""Export for QoS-400 of the Zynq UltraScale+: writer and templates."""
