"""Which colour is what. Okabe and Ito's palette, safe for colour-blind eyes, on white and on near-black.

Source: M. Okabe, K. Ito, "Color Universal Design" (2008), lightened where the original sinks in the dark.
"""

from gcs.contract.messages import Scene

Colour = tuple[int, int, int]

FILTERED: Colour = (32, 128, 224)
SMOOTHED: Colour = (120, 200, 255)  # lies inside the filtered line and is thinner
OUTLIER: Colour = (228, 60, 20)
GROUND: Colour = (128, 132, 140)
GOOD: Colour = (0, 158, 115)
WARNING: Colour = (214, 140, 0)
BAD: Colour = (213, 60, 20)
INS: Colour = (140, 146, 156)
INSTRUMENTS: tuple[Colour, ...] = (
    (230, 159, 0),
    (0, 158, 115),
    (204, 100, 180),
    (160, 120, 80),
    (150, 150, 0),
)
INK: dict[bool, Colour] = {False: (25, 28, 36), True: (245, 245, 250)}  # by dark page: the aircraft


def of_sensors(scene: Scene) -> dict[str, Colour]:
    """Every sensor's colour, in the order of the station file; beyond five they repeat."""
    named = {
        instrument.name: INSTRUMENTS[i % len(INSTRUMENTS)] for i, instrument in enumerate(scene.instruments)
    }
    return named | {"ins": INS}


def css(colour: Colour) -> str:
    return "rgb({},{},{})".format(*colour)
