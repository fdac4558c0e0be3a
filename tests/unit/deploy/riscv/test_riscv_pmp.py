"""Physical memory protection: areas of every kind, locks, and rights held to the text of the architecture."""

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from halpipe.deploy.riscv.board.registers import ADDRESS, CONFIG, Protection, Right

TOR, NA4, NAPOT, LOCKED = 1 << 3, 2 << 3, 3 << 3, 0x80
R, W, X = Right.READ, Right.WRITE, Right.EXECUTE


def armed(*entries):
    """A protection with (address register, configuration) for each entry, all armed at once."""
    protection = Protection()
    for i, (address, _) in enumerate(entries):
        protection.write(ADDRESS + i, address)
    protection.write(CONFIG, sum(config << 8 * i for i, (_, config) in enumerate(entries)))
    return protection


def test_without_entries_machine_mode_may_do_everything():
    assert Protection().rights(0x1234, 8) is Right.ALL
    assert not Protection().is_locked


def test_entries_that_are_not_locked_do_not_bind_machine_mode():
    assert armed((0x1000 >> 2, NA4 | R)).rights(0x1000, 4) is Right.ALL


def test_the_limits_of_every_kind_of_area():
    protection = armed(
        (0x1000 >> 2, 0),
        (0x2000 >> 2, TOR | R | X | LOCKED),  # 0x1000 to 0x2000
        (0x3000 >> 2, NA4 | W | LOCKED),  # four bytes
        ((0x4000 >> 2) | 0xFF, NAPOT | R | W | LOCKED),  # 0x800 bytes
        ((1 << 54) - 1, NAPOT | LOCKED),  # the rest
    )
    expected = {0xFFF: 0, 0x1000: R | X, 0x1FFF: R | X, 0x2000: 0, 0x3000: W, 0x3003: W, 0x3004: 0}
    expected |= {0x3FFF: 0, 0x4000: R | W, 0x47FF: R | W, 0x4800: 0, 0x80000000: 0}
    assert {address: protection.rights(address) for address in expected} == expected


def test_an_access_that_crosses_the_limit_of_an_area_has_no_right():
    protection = armed((0x1000 >> 2, 0), (0x2000 >> 2, TOR | R | LOCKED), ((1 << 54) - 1, NAPOT | LOCKED))
    assert protection.rights(0x1FF8, 8) == R
    assert protection.rights(0x1FFC, 8) is Right.NONE


def test_a_locked_entry_stays_as_it_is():
    protection = armed((0x1000 >> 2, 0), (0x2000 >> 2, TOR | R | LOCKED))
    protection.write(ADDRESS + 1, 0)
    protection.write(ADDRESS, 0)  # the lower end of a locked TOR entry
    protection.write(CONFIG, 0)
    assert protection.rights(0x1800) == R
    assert protection.read(ADDRESS + 1) == 0x2000 >> 2
    assert protection.read(CONFIG) == (TOR | R | LOCKED) << 8


areas = st.tuples(st.integers(0, 63), st.sampled_from([0, TOR, NA4, NAPOT]), st.integers(0, 7), st.booleans())


@given(st.lists(areas, min_size=1, max_size=6))
def test_pieces_have_the_rights_of_all_their_bytes(entries):
    protection = armed(*((address, kind | rights | LOCKED * locked) for address, kind, rights, locked in entries))
    pieces = protection.pieces(0, 512)
    assert pieces[0][0] == 0
    assert pieces[-1][1] == 512
    for (_, end, right), (start, _, following) in pairwise(pieces):
        assert end == start
        assert right != following
    for low, high, right in pieces:
        assert {protection.rights(address) for address in range(low, high)} == {right}


@given(st.lists(areas, min_size=1, max_size=6), st.integers(0, 127))
def test_the_first_locked_entry_that_matches_rules(entries, word):
    """The rule of the architecture, spelled out once more: address matching in words of four bytes."""
    protection = armed(*((address, kind | rights | LOCKED * locked) for address, kind, rights, locked in entries))
    expected = Right.ALL
    for i, (address, kind, rights, locked) in enumerate(entries):
        below = entries[i - 1][0] if i else 0
        trailing = len(bin(~address & -~address)) - 3  # ones at the end of the address
        size = 2 << trailing
        matches = {
            0: False,
            TOR: below <= word < address,
            NA4: word == address,
            NAPOT: word // size == address // size,
        }[kind]
        if locked and matches:
            expected = Right(rights)
            break
    assert protection.rights(4 * word, 4) == expected
