"""Colours that can be told apart."""

import numpy as np

from web.look import colours


def test_the_ramp_gets_lighter_all_the_way():
    steps = colours.ramp(np.linspace(0.0, 1.0, 50)).astype(float)
    lightness = steps @ (0.2126, 0.7152, 0.0722)  # ITU-R BT.709
    assert (np.diff(lightness) > 0).all()


def test_dimmed_is_half_way_to_the_page():
    assert colours.dimmed((0, 0, 0), dark=False) == (127, 127, 127)
    assert sum(colours.dimmed((255, 255, 255), dark=True)) < 3 * 255


def test_words_can_be_read_on_every_ground():
    """By WCAG 2.1: black on white has 21, #767676 on white 4.54."""
    assert colours.contrast((0, 0, 0), (255, 255, 255)) == 21.0
    assert round(colours.contrast((0x76,) * 3, (255, 255, 255)), 2) == 4.54
    for ground in (
        colours.GOOD,
        colours.WARNING,
        colours.BAD,
        colours.INS,
        colours.KIND["patch"],
        colours.BUTTON,
    ):
        assert colours.contrast(colours.words_on(ground), ground) >= 4.5
    assert colours.words_on(colours.BUTTON) == (255, 255, 255)  # as the library writes on it


def test_linear_light_is_darker_but_at_both_ends():
    light = colours.linear(np.array([0, 10, 128, 255], np.uint8))
    np.testing.assert_array_equal(light, [0, 1, 55, 255])  # IEC 61966-2-1: 10 → 0.77, 128 → 55.04
