"""What stands still: the grid, north, the instruments."""

import numpy as np
import viser

from gcs.contract.messages import Instrument
from web.look import colours
from web.look.colours import Colour
from web.memory.site import LaidPicture
from web.scene import glyphs
from web.scene.lines import Lines

NORTH_M = 300.0
BELOW_M = 2.0  # the level plane lies a picture, so that grid and shadows are seen on it


def draw_ground(api: viser.SceneApi, lines: Lines, root: str) -> None:
    """A grid of 100 m and 1 km at the height of the origin, and north."""
    api.add_grid(
        f"{root}/grid",
        infinite_grid=True,
        fade_distance=12_000.0,
        fade_strength=2.0,
        cell_size=100.0,
        cell_color=colours.GROUND,
        cell_thickness=0.5,
        section_size=1000.0,
        section_color=colours.GROUND,
        section_thickness=1.1,
        shadow_opacity=0.0,
    )
    tip = (0, NORTH_M, 0)
    shaft, left, right = (0, 0, 0), (-30, NORTH_M - 60, 0), (30, NORTH_M - 60, 0)
    lines.draw(f"{root}/north", np.array([(shaft, tip), (tip, left), (tip, right)]), colours.GROUND, 4.0)


def draw_site(api: viser.SceneApi, root: str, site: LaidPicture) -> None:
    """The user's picture, below all that is drawn on the ground."""
    api.add_image(
        f"{root}/site/picture",
        site.pixels,
        *site.size_m,
        position=(*site.middle_m, -BELOW_M),
        wxyz=(0.0, 1.0, 0.0, 0.0),  # an image has x to the right and y down
        cast_shadow=False,
        receive_shadow=False,
    )


def draw_instrument(
    api: viser.SceneApi, root: str, instrument: Instrument, colour: Colour
) -> viser.MeshHandle:
    name, position = instrument.name, instrument.position_enu_m
    vertices, faces = glyphs.radar() if instrument.kind == "radar" else glyphs.theodolite()
    api.add_label(f"{root}/instruments/{name}-label", name, position=position, anchor="top-center")
    return api.add_mesh_simple(
        f"{root}/instruments/{name}",
        vertices,
        faces,
        color=colour,
        flat_shading=True,
        side="double",
        position=position,
    )
