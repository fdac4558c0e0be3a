"""Parts of the annealing kernel that the library exports for the tests alone."""

from halpipe.pipeline.solve.kernel.kernel import INTEGER, ask, function


def move(arrays, state, noise):
    ask("move", arrays, state, noise=noise)


def next_temperature(arrays, state):
    ask("next_temperature", arrays, state)


def restart(arrays, state):
    ask("restart", arrays, state)


def gather_cluster(arrays, state, task):
    return ask("gather_cluster", arrays, state, task)


def move_cluster(arrays, state, noise, size):
    ask("move_cluster", arrays, state, size, noise=noise)


def move_swap(arrays, state, noise, entry):
    return ask("move_swap", arrays, state, entry, noise=noise) != 0


def luby(number):
    return int(function("luby")(INTEGER(number)))
