"""Check for QoS-400 of the Zynq UltraScale+: model of the device."""
