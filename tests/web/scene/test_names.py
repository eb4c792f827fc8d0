"""A name on the ground is shown only where it is whole and in nobody's way."""

import msgspec
import numpy as np

from gcs.contract.messages import State
from tests.web.flight import SCENE, messages
from web.scene.names import Boxes, GroundNames, Lens, drawn, free, hanging, things, together

PICTURE = (900, 700)
NOWHERE, NOTHING = np.zeros((0, 2)), Boxes(np.zeros((0, 2)), np.zeros((0, 2)))
MIDDLE = np.array([(450.0, 350.0)])


def below(places: np.ndarray) -> np.ndarray:
    """(n, 3) as seen from far above, 5 m a pixel; the origin in the middle."""
    return np.array(PICTURE) / 2 + places[:, :2] * (0.2, -0.2)


LENS = Lens(below, PICTURE, 0.001)


def test_what_the_edge_would_cut_is_not_shown():
    places = np.array([(450, 350), (25, 350), (23, 350), (450, 691), (450, np.nan)])
    assert free(places, PICTURE, NOWHERE, NOTHING) == [True, True, False, False, False]


def test_a_name_gives_way_to_the_track_to_things_and_to_a_name_before_it():
    assert free(MIDDLE, PICTURE, MIDDLE + np.array((30, 0)), NOTHING) == [True]
    assert free(MIDDLE, PICTURE, MIDDLE + np.array((20, 5)), NOTHING) == [False]
    assert free(MIDDLE, PICTURE, np.full((1, 2), np.nan), NOTHING) == [True]
    assert free(MIDDLE, PICTURE, NOWHERE, Boxes(MIDDLE + np.array((60, 0)), np.array([(80, 20)]))) == [False]
    assert free(np.repeat(MIDDLE, 2, axis=0), PICTURE, NOWHERE, NOTHING) == [True, False]


def test_instruments_and_the_aircraft_take_room_with_their_names():
    state = next(m for m, source in messages(1.0) if isinstance(m, State) and not source)
    state = msgspec.structs.replace(state, position_enu_m=(0.0, 0.0, 100.0))
    taken = things(SCENE, state, "uav1 then", LENS)
    assert len(taken.middles) == len(taken.sizes) == 2 * len(SCENE.instruments) + 2
    assert taken.sizes[-1].tolist() == [80.0, 20.0]
    foot = below(np.array([SCENE.instruments[0].position_enu_m]))
    for off in ((0, -20), (0, 10)):
        assert free(foot + off, PICTURE, NOWHERE, taken) == [False]
    assert len(things(SCENE, None, "uav1", LENS).middles) == 2 * len(SCENE.instruments)


def test_a_track_is_in_the_way_between_its_places_too_and_so_are_its_outliers():
    track = np.array([(0.0, 0.0, 100.0), (200.0, 0.0, 100.0)])
    seen = drawn(track, [np.array([(0.0, 500.0, 0.0)])], LENS)
    assert (below(np.array([(100.0, 0.0, 0.0)])) == seen).all(axis=1).any()
    assert (below(np.array([(0.0, 500.0, 0.0)])) == seen).all(axis=1).any()
    assert len(drawn(np.zeros((0, 3)), [], LENS)) == 0
    assert len(drawn(np.zeros((100_000, 3)), [], LENS)) < 40_000


def test_the_label_of_a_clicked_outlier_is_in_the_way():
    label = hanging("isolated · radar-1", np.array([0.0, 0.0, 50.0]), LENS)
    taken = together(things(SCENE, None, "uav1", LENS), label)
    assert len(taken.middles) == len(taken.sizes) == 2 * len(SCENE.instruments) + 1
    for right, shown in ((-30, True), (-20, False), (140, False), (180, True)):
        assert free(MIDDLE + np.array((right, 10)), PICTURE, NOWHERE, label) == [shown]


class Labels:
    """A scene that only remembers its labels."""

    def __init__(self):
        self.shown: dict[str, Label] = {}

    def add_label(self, name, text, *, visible, **_):
        label = self.shown[text] = Label(visible)
        return label


class Label:
    def __init__(self, visible: bool):
        self.visible = visible


def test_a_name_comes_back_when_its_place_is_free_again():
    stage = Labels()
    names = GroundNames(stage, "/world/uav1")
    assert not any(label.visible for label in stage.shown.values())
    names.update(LENS, NOWHERE, NOTHING)
    assert all(label.visible for label in stage.shown.values())
    names.update(LENS, below(np.array([(0.0, 980.0, 300.0)])), NOTHING)
    assert [text for text, label in stage.shown.items() if not label.visible] == ["1 km N"]
    names.update(LENS, NOWHERE, NOTHING)
    assert stage.shown["1 km N"].visible
