"""Whatever is asked of the generator, the schedule that the set was cut from is accepted by verify."""

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.durations import milliseconds
from halpipe.models import Status
from halpipe.pipeline.generate import SetParameters, achieved, generate_with_witness
from halpipe.pipeline.validate import validate
from halpipe.pipeline.verify import verify
from profiles import examples

shares = st.integers(0, 20).map(lambda n: Fraction(n, 20))


@st.composite
def parameters(draw):
    units = draw(st.integers(1, 8))
    types = draw(st.integers(1, units))
    gang = draw(shares) / 2 if units >= 2 * types else Fraction(0)
    periods = () if gang else draw(st.lists(st.sampled_from((5, 8, 10, 12, 30, 40)), max_size=8))
    return SetParameters(
        tasks=draw(st.integers(1, 40)),
        units=units,
        unit_types=types,
        resources=draw(st.integers(1, 4)),
        access_windows=draw(st.none() | st.integers(0, 60)),
        multi_version=draw(shares),
        precedence=draw(shares),
        utilisation=draw(shares.filter(bool)),
        slack=draw(shares),
        fractional=draw(st.booleans()),
        resource_fill=draw(st.none() | shares),
        gang=gang,
        unlike_units=draw(st.booleans()),
        periods=tuple(milliseconds(period) for period in periods),
    )


@examples(120)
@given(parameters(), st.integers(0, 10**9))
def test_the_witness_is_a_valid_schedule(wanted, seed):
    model, schedule = generate_with_witness(wanted, seed)
    assert [finding for finding in validate(model) if finding.is_error] == []
    assert [finding for finding in verify(model, schedule) if finding.is_error] == []
    assert schedule.modes[0].status is Status.VALID
    assert len(model.tasks) == wanted.task_count
    assert len(schedule.modes[0].jobs) == achieved(model).jobs
    assert achieved(model).utilisation <= wanted.utilisation + Fraction(1, 1000)
