"""The aircraft with its name and attitude, its 3-sigma ellipsoid, and the protection level around it."""

from collections.abc import Sequence

import numpy as np
import viser
import viser.transforms

from gcs.contract.messages import GRAVITY_MPS2, State
from web.look import colours
from web.scene import glyphs

NOW, THEN = "now", "then"
# Nodes, under a flight's, of what moves with the newest state; not seen by who looks back.
OF_NOW = tuple(under + NOW for under in ("", "trust/", "sights/", "wind/"))
SIZE = 0.08  # wing span as a share of the camera's distance
TRUST = 0.02  # least size of what shows trust, as such a share
LEAST_M = 2.0  # wing span from near
FACTORS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)  # how much larger than life the ellipsoid may be
SLOW_MPS = 2.0  # below this the velocity says nothing about where the nose points


class Aircraft:
    """Not seen before the first state. It hangs under the nodes ``moment`` of the flight's and of its trust:
    what all share, of now, and what one viewer looks back upon have nodes of their own."""

    def __init__(self, api: viser.SceneApi, root: str, name: str, moment: str = NOW):
        vertices, faces = glyphs.aircraft()
        path, trust = f"{root}/{moment}", f"{root}/trust/{moment}"
        self._body = api.add_mesh_simple(
            f"{path}/aircraft", vertices, faces, flat_shading=True, side="double", visible=False
        )
        self._label = api.add_label(f"{path}/label", name, visible=False, anchor="bottom-center")
        self._plumb = api.add_line_segments(
            f"{path}/plumb",
            np.zeros((1, 2, 3)),
            colours.GROUND,
            thickness=1.5,
            thickness_units="screen",
            visible=False,
        )
        self._ellipsoid = api.add_icosphere(
            f"{trust}/sigma", color=colours.FILTERED, opacity=0.30, visible=False, cast_shadow=False
        )
        self._protection = api.add_line_segments(
            f"{trust}/protection",
            barrel(),
            colours.PROTECTION,
            thickness=1.3,
            thickness_units="screen",
            visible=False,
        )
        self.factor = 1  # how much larger than life ellipsoid and protection level are drawn

    def set_dark(self, *, dark: bool) -> None:
        self._body.color = colours.INK[dark]

    def say(self, text: str) -> None:
        if self._label.text != text:
            self._label.text = text

    def remove(self) -> None:
        for node in self._nodes():
            node.remove()

    def hide(self) -> None:
        for node in self._nodes():
            node.visible = False

    def _nodes(self) -> tuple[viser.SceneNodeHandle, ...]:
        return self._body, self._label, self._plumb, self._ellipsoid, self._protection

    def move(self, state: State, distance_m: float) -> None:
        """Show ``state``, sized for a camera at that distance."""
        position, span_m = np.array(state.position_enu_m), max(LEAST_M, SIZE * distance_m)
        self._body.position = self._ellipsoid.position = self._protection.position = position
        self._body.scale = span_m
        self._label.position = position + np.array([0, 0, span_m / 2])
        self._plumb.points = np.array([[position, position * (1, 1, 0)]], np.float32)
        if np.linalg.norm(state.velocity_enu_mps) > SLOW_MPS:
            self._body.wxyz = attitude(state.velocity_enu_mps, state.acceleration_enu_mps2)
        radii, axes = ellipsoid(state.covariance)
        across, high = state.protection_h_m, state.protection_v_m
        held = across is not None and high is not None
        largest = max(radii.max(), across or 0.0, high or 0.0) if held else radii.max()
        seen = (factor for factor in FACTORS if factor * largest > TRUST * distance_m)
        self.factor = next(seen, FACTORS[-1])
        self._ellipsoid.scale = tuple(radii * self.factor)
        self._ellipsoid.wxyz = viser.transforms.SO3.from_matrix(axes).wxyz
        self._protection.visible = held
        if across is not None and high is not None:
            self._protection.scale = (self.factor * across, self.factor * across, self.factor * high)
        self._body.visible = self._label.visible = self._plumb.visible = self._ellipsoid.visible = True


def ellipsoid(covariance: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """3-sigma radii (3,) in metres and axes (3, 3) by columns, from the (45,) lower triangle by rows."""
    xx, yx, yy, zx, zy, zz = covariance[:6]
    variances, axes = np.linalg.eigh(np.array([[xx, yx, zx], [yx, yy, zy], [zx, zy, zz]]))
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return 3 * np.sqrt(np.maximum(variances, 1e-6)), axes


def attitude(velocity: Sequence[float], acceleration: Sequence[float]) -> np.ndarray:
    """Unit quaternion wxyz, body (nose, left, up) to ENU, of an aircraft in a coordinated turn.

    The nose points along the velocity, and the lift, acceleration less gravity, has no part to the side.
    """
    nose = np.array(velocity) / np.linalg.norm(velocity)
    lift = np.array([0, 0, GRAVITY_MPS2]) + acceleration
    lift = lift - (lift @ nose) * nose
    up = lift / np.linalg.norm(lift)
    return viser.transforms.SO3.from_matrix(np.column_stack([nose, np.cross(up, nose), up])).wxyz


def barrel() -> np.ndarray:
    """(n, 2, 3) the edges of an upright cylinder of radius and half height 1: three hoops, four staves."""
    angles = np.linspace(0, 2 * np.pi, 33)
    hoop = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(33)])
    up = np.array([0.0, 0.0, 1.0])
    hoops = [np.stack([hoop[:-1], hoop[1:]], axis=1) + height * up for height in (-1, 0, 1)]
    staves = [np.stack([hoop[:-1:8] - up, hoop[:-1:8] + up], axis=1)]
    return np.concatenate([*hoops, *staves])
