"""Parts that all exporters share: options, the choice of modes, the drawn line of time, priorities, CPUs, colours."""
