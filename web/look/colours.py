"""Which colour is what. Okabe and Ito's palette, safe for colour-blind eyes, on white and on near-black.

Source: M. Okabe, K. Ito, "Color Universal Design" (2008), lightened where the original sinks in the dark.
"""

import numpy as np

from gcs.contract.messages import Scene

Colour = tuple[int, int, int]

FILTERED: Colour = (32, 128, 224)
SMOOTHED: Colour = (120, 200, 255)  # lies inside the filtered line and is thinner
OUTLIER: Colour = (228, 60, 20)
KIND: dict[str, Colour] = {"isolated": OUTLIER, "patch": (186, 62, 168), "invalid": (138, 116, 38)}
GROUND: Colour = (128, 132, 140)
GOOD: Colour = (0, 158, 115)
WARNING: Colour = (214, 140, 0)
BAD: Colour = (213, 60, 20)
INS: Colour = (140, 146, 156)
WIND: Colour = (86, 150, 200)
PROTECTION: Colour = (214, 140, 0)
INSTRUMENTS: tuple[Colour, ...] = (
    (230, 159, 0),
    (0, 158, 115),
    (204, 100, 180),
    (160, 120, 80),
    (150, 150, 0),
)
BUTTON: Colour = (92, 98, 106)  # white words on it have a contrast of 6.2; the library's grey has 3.3
# of what can be pressed: the library makes it lighter, 5 to white; its own: 3.6
BRAND: Colour = (14, 76, 134)
BAND = 0.18  # opacity of a band in a plot
LABEL: dict[bool, Colour] = {False: BUTTON, True: (160, 164, 170)}  # by dark page: the library's small words
CHOSEN_DARK: Colour = (96, 165, 230)  # a chosen tab's word on the dark page
INK: dict[bool, Colour] = {False: (25, 28, 36), True: (245, 245, 250)}  # by dark page: the aircraft
OTHER = INK  # another course of the flight: thin, over the newest
PAGE: dict[bool, Colour] = {False: (255, 255, 255), True: (20, 21, 24)}
# From dark blue over green to yellow, of even lightness steps, so that it reads in grey too.
# Source: S. van der Walt, N. Smith, "viridis" (2015), seven of its entries, the ends less extreme.
RAMP = np.array(
    [
        (62, 60, 140),
        (49, 96, 141),
        (38, 130, 142),
        (31, 160, 136),
        (83, 190, 106),
        (160, 210, 60),
        (235, 215, 40),
    ]
)


def of_sensors(scene: Scene) -> dict[str, Colour]:
    """Every sensor's colour, in the order of the station file; beyond five they repeat."""
    named = {
        instrument.name: INSTRUMENTS[i % len(INSTRUMENTS)] for i, instrument in enumerate(scene.instruments)
    }
    return named | {"ins": INS}


def dimmed(colour: Colour, *, dark: bool) -> Colour:
    """The colour half way to the page: there, but behind everything else."""
    red, green, blue = ((one + page) // 2 for one, page in zip(colour, PAGE[dark], strict=True))
    return red, green, blue


def ramp(share: np.ndarray) -> np.ndarray:
    """Share 0 … 1 of any shape (…) → (…, 3) uint8; what is beyond takes the end, NaN the ground's grey."""
    at = np.clip(share, 0.0, 1.0) * (len(RAMP) - 1)
    known = np.isfinite(at)
    red, green, blue = (
        np.interp(np.where(known, at, 0.0), np.arange(len(RAMP)), RAMP[:, k]) for k in range(3)
    )
    colours = np.stack([red, green, blue], axis=-1)
    return np.where(known[..., None], colours, GROUND).astype(np.uint8)


def linear(colour: np.ndarray) -> np.ndarray:
    """(…, 3) uint8 as it is meant → (…, 3) uint8 of linear light, IEC 61966-2-1."""
    share = np.asarray(colour) / 255.0
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.rint(light * 255.0).astype(np.uint8)


def luminance(colour: Colour) -> float:
    """Relative luminance, 0 … 1 (WCAG 2.1)."""
    red, green, blue = (
        share / 12.92 if share <= 0.04045 else ((share + 0.055) / 1.055) ** 2.4
        for share in (one / 255.0 for one in colour)
    )
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one: Colour, other: Colour) -> float:
    """1 … 21 (WCAG 2.1): 4.5 is enough to read small words by."""
    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


def words_on(colour: Colour) -> Colour:
    """White or black, which reads better on it."""
    return max(PAGE[False], INK[False], key=lambda words: contrast(words, colour))


def css(colour: Colour) -> str:
    return "rgb({},{},{})".format(*colour)
