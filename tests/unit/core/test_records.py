"""Records are held against the dataclasses of the standard library: the same class is defined in both ways."""

import ast
import copy
import inspect
import pickle
from dataclasses import FrozenInstanceError, asdict, astuple, dataclass, field, fields, is_dataclass, replace
from functools import partial
from pathlib import Path

import pytest

import halpipe
from halpipe.core.records import record, unchecked

STANDARD = partial(dataclass, frozen=True, slots=True)


def family(form):
    """Define a class with each kind of field, one derived from it, and one that states methods of its own."""

    @form(kw_only=True)
    class Base:
        """The base."""

        at: int = field(default=0, compare=False)

    @form(kw_only=True)
    class Whole(Base):
        """All kinds of fields."""

        name: str
        items: list[int] = field(default_factory=list)
        hidden: str = field(default="", repr=False)
        digest: str = field(default="none", init=False)
        made: tuple[int, ...] = field(default_factory=tuple, init=False)
        checked: bool = field(init=False, default=False, compare=False)

        def __post_init__(self):
            object.__setattr__(self, "checked", True)

    @form
    class Own:
        value: int
        other: tuple["Own", ...] = ()

        def __repr__(self):
            return "own"

        def __hash__(self):
            return 7

    @form
    class Nothing:
        pass

    return Base, Whole, Own, Nothing


def standard(cls=None, **options):
    return STANDARD(**options) if cls is None else STANDARD(cls, **options)


PAIRS = list(zip(family(record), family(standard), strict=True))


@pytest.mark.parametrize(("ours", "theirs"), PAIRS, ids=lambda cls: cls.__name__)
def test_the_class_is_that_of_the_standard_library(ours, theirs):
    assert is_dataclass(ours)
    assert [(f.name, f.init, f.kw_only, f.default) for f in fields(ours)] == [
        (f.name, f.init, f.kw_only, f.default) for f in fields(theirs)
    ]
    assert ours.__slots__ == theirs.__slots__
    assert ours.__match_args__ == theirs.__match_args__
    assert not hasattr(ours, "__dict__") or "__dict__" not in ours.__slots__
    by_ours, by_theirs = inspect.signature(ours), inspect.signature(theirs)
    assert list(by_ours.parameters) == list(by_theirs.parameters)
    assert [p.kind for p in by_ours.parameters.values()] == [p.kind for p in by_theirs.parameters.values()]
    assert [p.annotation for p in by_ours.parameters.values()] == [p.annotation for p in by_theirs.parameters.values()]


CALLS = [
    (0, (), {"at": 3}),
    (1, (), {"name": "a"}),
    (1, (), {"name": "a", "items": [1, 2], "hidden": "h", "at": 9}),
    (2, (4,), {}),
    (2, (4, (1,)), {}),
    (3, (), {}),
]


@pytest.mark.parametrize(("which", "positional", "named"), CALLS)
def test_objects_are_those_of_the_standard_library(which, positional, named):
    ours, theirs = PAIRS[which]
    one, other = ours(*positional, **named), theirs(*positional, **named)
    assert repr(one) == repr(other)
    assert asdict(one) == asdict(other)
    assert one == ours(*positional, **named)
    assert one != other  # of another class, as there
    assert repr(copy.copy(one)) == repr(copy.deepcopy(one)) == repr(one)
    assert copy.deepcopy(one) == one
    with pytest.raises(FrozenInstanceError, match="cannot assign to field 'x'"):
        one.x = 1
    for each in fields(one):
        with pytest.raises(FrozenInstanceError, match=f"cannot assign to field '{each.name}'"):
            setattr(one, each.name, 1)
        with pytest.raises(FrozenInstanceError, match=f"cannot delete field '{each.name}'"):
            delattr(one, each.name)


@pytest.mark.parametrize(("which", "positional", "named"), CALLS)
def test_unchecked_makes_the_same_record_but_for_what_comes_after(which, positional, named):
    ours = PAIRS[which][0]
    one, other = unchecked(ours)(*positional, **named), ours(*positional, **named)
    assert type(one) is ours
    assert one == other
    assert repr(one).replace("checked=False", "checked=True") == repr(other)
    assert getattr(one, "checked", False) is False


@pytest.mark.parametrize(
    ("which", "positional", "named"), [(1, (), {}), (1, (), {"name": 1, "digest": ""}), (2, (), {}), (3, (1,), {})]
)
def test_wrong_arguments_are_refused_alike(which, positional, named):
    ours, theirs = PAIRS[which]
    with pytest.raises(TypeError) as by_ours:
        ours(*positional, **named)
    with pytest.raises(TypeError) as by_theirs:
        theirs(*positional, **named)
    assert str(by_ours.value) == str(by_theirs.value)


def test_equality_goes_by_the_compared_fields():
    for _, whole, _, _ in (family(record), family(standard)):
        one = whole(name="a", at=1)
        assert one == whole(name="a", at=2)
        assert one != whole(name="b", at=1)
        assert one.__eq__(3) is NotImplemented
        assert replace(one, name="c").name == "c"
        with pytest.raises(ValueError, match="init=False"):
            replace(one, digest="x")


def test_each_object_has_a_value_of_its_own_from_a_factory():
    _, whole, _, _ = family(record)
    one, other = whole(name="a"), whole(name="a")
    assert one.items is not other.items


def test_hashes_follow_the_compared_fields():
    @record
    class Point:
        x: int
        y: int = 0
        note: str = field(default="", compare=False)

    assert hash(Point(1, 2)) == hash(Point(1, 2, "other"))
    assert len({Point(1, 2), Point(1, 2), Point(2, 1)}) == 2
    assert hash(PAIRS[2][0](1)) == 7
    assert astuple(Point(1)) == (1, 0, "")


def test_without_eq_an_object_equals_itself_alone():
    @record(eq=False)
    class Key:
        x: int

    one = Key(1)
    assert one == one
    assert one != Key(1)
    assert len({one, Key(1)}) == 2


@record
class Kept:
    """At the top of a module, where pickle finds it."""

    x: int
    y: str = field(default="", compare=False)


@pytest.mark.parametrize("protocol", range(2, pickle.HIGHEST_PROTOCOL + 1))
def test_pickles_come_back(protocol):
    back = pickle.loads(pickle.dumps(Kept(3, "y"), protocol))
    assert (back.x, back.y) == (3, "y")


def test_a_record_is_described_by_its_own_text_or_its_name():
    _, whole, own, _ = family(record)
    assert (whole.__doc__, own.__doc__) == ("All kinds of fields.", "Own")


def test_an_object_that_holds_itself_can_be_printed():
    inner = []
    own = Kept(1, inner)
    inner.append(own)
    assert repr(own) == "Kept(x=1, y=[...])"


def test_match_statements_take_records_apart():
    match Kept(3, "y"):
        case Kept(x, y=text):
            assert (x, text) == (3, "y")


@pytest.mark.parametrize("path", sorted(Path(halpipe.__file__).parent.rglob("*.py")), ids=lambda path: path.stem)
def test_what_could_be_a_record_is_one(path):
    """Each frozen dataclass with slots would cost a start three times as much."""
    for node in ast.walk(ast.parse(path.read_bytes())):
        for decorator in node.decorator_list if isinstance(node, ast.ClassDef) else []:
            stated = {word.arg for word in decorator.keywords} if isinstance(decorator, ast.Call) else set()
            assert not {"frozen", "slots"} <= stated or "order" in stated, node.name
