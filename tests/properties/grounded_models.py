"""Arbitrary models with every name made to refer to something, for formats that refer from element to element."""

from dataclasses import replace

from halpipe.models import HealthAction


def first_of_each(elements):
    return tuple({element.name: element for element in elements}.values())


def chosen(name, names):
    """One of `names`, whichever `name` falls on."""
    return names[sum(map(ord, name)) % len(names)]


def grounded_version(version, task, units, resources, tasks):
    others = [name for name in tasks if name != task]
    return replace(
        version,
        units=tuple(dict.fromkeys(chosen(unit, units) for unit in version.units)) if units else (),
        accesses=tuple(replace(a, resource=chosen(a.resource, resources)) for a in version.accesses if resources),
        precedences=tuple(replace(p, task=chosen(p.task, others)) for p in version.precedences if others),
    )


def grounded(model):
    """An arbitrary model with every name made to refer to something, and every element with a name of its own."""
    units, resources, tasks = map(first_of_each, (model.units, model.resources, model.tasks))
    resources = tuple(replace(resource, bandwidth=resource.bandwidth or None) for resource in resources)
    names = [[element.name for element in found] for found in (units, resources, tasks)]
    tasks = tuple(
        replace(
            task,
            period=task.period or None,
            offset=task.offset if task.period else None,
            versions=tuple(grounded_version(v, task.name, *names) for v in first_of_each(task.versions)),
        )
        for task in tasks
    )
    known = {task.name: [version.name for version in task.versions] for task in tasks if task.versions}
    modes = tuple(
        replace(
            mode,
            runs=tuple(
                {
                    (name := chosen(run.task, list(known))): replace(
                        run,
                        task=name,
                        versions=tuple(dict.fromkeys(chosen(v, known[name]) for v in run.versions)),
                    )
                    for run in mode.runs
                }.values()
            )
            if known
            else (),
        )
        for mode in first_of_each(model.modes)
    )
    mode_names = [mode.name for mode in modes]
    return replace(
        model,
        units=units,
        resources=resources,
        tasks=tasks,
        chains=tuple(
            replace(chain, tasks=tuple(dict.fromkeys(chosen(task, names[2]) for task in chain.tasks)))
            for chain in first_of_each(model.chains)
            if names[2]
        ),
        modes=modes,
        transitions=tuple(
            replace(t, source=chosen(t.source, mode_names), target=chosen(t.target, mode_names))
            for t in model.transitions
            if mode_names
        ),
        health=tuple(
            replace(rule, task=chosen(rule.task, names[2]), mode=chosen(rule.mode, mode_names) if switches else "")
            for rule in model.health
            if (switches := rule.action is HealthAction.SWITCH) in (False, bool(mode_names)) and names[2]
        ),
    )
