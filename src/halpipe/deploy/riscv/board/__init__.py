"""The simulated board: harts, memories, devices, DMA engine and bus."""
