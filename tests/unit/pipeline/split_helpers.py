"""What the tests of split jobs share: jobs from their parts, and interrupts."""

from dataclasses import replace

from halpipe.models import Interrupt, Job, Part, Split
from support import ms


def parted(owner, index, units, *parts, version_name="v"):
    """A job from its parts, each as start, end, from and to in milliseconds."""
    made = tuple(
        Part(start=ms(start), end=ms(end), executed_from=ms(begun), executed_to=ms(done))
        for start, end, begun, done in parts
    )
    return Job(
        task=owner,
        index=index,
        start=made[0].start,
        end=made[-1].end,
        version=version_name,
        units=tuple(units.split()),
        parts=made,
    )


def points(*instants, **more):
    return Split(points=tuple(map(ms, instants)), **more)


def split(chosen, how):
    return replace(chosen, split=how)


def interrupts(system, unit, *rows):
    """The model with the interrupts (distance, wcet) on a unit."""
    served = tuple(Interrupt(name=f"i{n}", distance=ms(d), wcet=ms(c)) for n, (d, c) in enumerate(rows))
    units = tuple(replace(u, interrupts=served) if u.name == unit else u for u in system.units)
    return replace(system, units=units)
