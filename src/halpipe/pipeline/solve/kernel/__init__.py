"""Simulated annealing over x = [theta | lambda | phi] (paper, section III): the kernel and its driver."""
