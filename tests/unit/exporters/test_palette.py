"""Colours of exports: all different, and dark text is legible on each."""

from halpipe.exporters.common.palette import FILLS, INK, tone


def luminance(colour):
    """WCAG 2.1, relative luminance."""
    channels = (int(colour[n : n + 2], 16) / 255 for n in (1, 3, 5))
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_dark_text_is_legible_on_every_fill():
    assert len({*FILLS}) == len(FILLS) == 24
    assert all(len(fill) == 7 and (luminance(fill) + 0.05) / (luminance(INK) + 0.05) > 4.5 for fill in FILLS)


def test_tints_have_45_percent_of_white_and_shades_30_of_grey():
    assert (FILLS[0], FILLS[8], FILLS[16]) == ("#77aadd", "#b4d0ec", "#6c90b4")


def test_after_the_last_fill_they_start_again():
    assert [tone(n) for n in (0, 23, 24, 49)] == [0, 23, 0, 1]
