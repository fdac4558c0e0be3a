"""Reader of Autoware System Design files: nodes with their processes, modules, systems with modes and compute units.

`entities` collects the files and resolves inheritance; `structure` expands a system to node instances and follows the
connections between their ports; `processes` turns their processes into callbacks; `read` does so for every mode;
`modes` makes one model of the models of the modes.
"""
