"""What is proven impossible is: no bound leaves out a system that has a schedule by construction."""

from dataclasses import replace
from fractions import Fraction

import verify_systems as systems
from hypothesis import assume, given
from hypothesis import strategies as st

from halpipe.pipeline.validate import validate
from halpipe.pipeline.whatif.size import fewest_units, largest_factor, lowest_bandwidth
from halpipe.pipeline.whatif.trial import proofs
from profiles import examples


@examples(40)
@given(st.randoms(use_true_random=False))
def test_no_bound_excludes_a_system_that_has_a_schedule(rng):
    """At the size that it has, and at any that is easier."""
    system, _ = systems.valid_system(rng)
    system = replace(system, units=tuple(replace(unit, type="core") for unit in system.units))
    assume(not any(d.is_error for d in validate(system)))
    sizes = ((fewest_units, "core", (3, 4, 6)), (lowest_bandwidth, "r", (1, Fraction(3, 2), 3)))
    for ask, subject, values in sizes:
        question = ask(system, subject)
        for value in values:
            assert proofs(question.relaxed(Fraction(value)), question.ignored) == ()
    factor = largest_factor(system)
    for value in (Fraction(1), Fraction(3, 4)):
        assert proofs(factor.relaxed(value), factor.ignored) == ()
