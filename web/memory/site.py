"""The user's own picture of the ground: read with its place on the Earth, and laid into the station's frame.

The place comes from a world file of six lines beside the picture (``site.pgw`` of ``site.png``; ``.wld`` for
any) or, of a GeoTIFF, from its tags (OGC 19-008r4). Both in degrees of longitude and latitude, WGS84: other
coordinates need a library of projections. ``gdalwarp -t_srs EPSG:4326`` makes such a picture of any.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image, UnidentifiedImageError

from gcs.contract.frames import Frame
from gcs.contract.messages import InputError

MOST_PX = 2048  # along a side, on the page: a megabyte or two for each viewer
BARE = 0.02  # share of the page's picture that may be filled from its edge, before it is left transparent
SCALE, TIEPOINT, KEYS, GEOGRAPHIC = 33550, 33922, 34735, 2  # GeoTIFF: tags, and the kind of its coordinates
MODEL, RASTER = 1024, 1025  # keys: kind of coordinates; whether a tie is a pixel's corner (1) or middle (2)


class GroundPicture(NamedTuple):
    """A picture and where it belongs."""

    pixels: np.ndarray  # (h, w, 3) uint8
    place: np.ndarray  # (2, 3): place @ (column, row, 1) = lon, lat in degrees of that pixel's middle


class LaidPicture(NamedTuple):
    """A picture on the station's level plane, north up."""

    pixels: np.ndarray  # (h, w, 3 or 4) uint8
    middle_m: tuple[float, float]  # east, north
    size_m: tuple[float, float]  # width, height


def read(path: Path) -> GroundPicture:
    """The picture. Raises ``InputError``, one line that says which file and what to do."""
    try:
        with Image.open(path) as image:
            place = _beside(path)
            place = _tagged(image) if place is None else place
            whole = np.array(image.size)
            image.thumbnail((2 * MOST_PX, 2 * MOST_PX))
            pixels = np.asarray(image.convert("RGB"))
    except UnidentifiedImageError:
        raise InputError(f"{path}: no picture; name a PNG, JPEG or TIFF") from None
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        raise InputError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
    if place is None:
        raise InputError(
            f"{path}: nothing says where it lies; put a world file {path.stem}.wld beside it, in degrees"
        )
    height, width = pixels.shape[:2]
    shrunk = whole / (width, height)  # old pixels in a new one
    shrink = np.array([[shrunk[0], 0, (shrunk[0] - 1) / 2], [0, shrunk[1], (shrunk[1] - 1) / 2], [0, 0, 1]])
    place = place @ shrink
    lon_deg, lat_deg = place @ (width / 2, height / 2, 1)
    if not (abs(lat_deg) <= 90.0 and abs(lon_deg) <= 360.0 and abs(np.linalg.det(place[:, :2])) > 0.0):
        raise InputError(f"{path}: its place is not in degrees; gdalwarp -t_srs EPSG:4326 makes it so")
    return GroundPicture(pixels, place)


def laid(picture: GroundPicture, frame: Frame) -> LaidPicture:
    """The picture as seen from above, each pixel looked up where it is on the Earth."""
    height, width = picture.pixels.shape[:2]
    across, down = np.meshgrid(np.linspace(0, width, 9) - 0.5, np.linspace(0, height, 9) - 0.5)
    lon_deg, lat_deg = np.tensordot(picture.place, [across, down, np.ones_like(across)], 1)
    east, north, _ = np.moveaxis(frame.to_enu(lat_deg, lon_deg, frame.alt_m), -1, 0)
    size_m = np.array([np.ptp(east), np.ptp(north)])
    n_east, n_north = np.maximum(
        2, np.round(size_m / size_m.max() * min(MOST_PX, max(width, height)))
    ).astype(int)
    back = np.linalg.inv(np.vstack([picture.place, (0, 0, 1)]))
    out = np.zeros((n_north, n_east, 4), np.uint8)
    columns = east.min() + (np.arange(n_east) + 0.5) / n_east * size_m[0]
    for row, there in enumerate(north.max() - (np.arange(n_north) + 0.5) / n_north * size_m[1]):
        level = np.column_stack([columns, np.full(n_east, there), np.zeros(n_east)])
        lat_deg, lon_deg, _ = frame.to_geodetic(level)
        x, y = np.round(back[:2] @ (lon_deg, lat_deg, np.ones(n_east))).astype(int)
        inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
        out[row, :, :3] = picture.pixels[y.clip(0, height - 1), x.clip(0, width - 1)]
        out[row, :, 3] = 255 * inside
    bare = np.mean(out[..., 3] == 0)
    middle_m = (float(east.min() + size_m[0] / 2), float(north.max() - size_m[1] / 2))
    return LaidPicture(out[..., :3] if bare < BARE else out, middle_m, (float(size_m[0]), float(size_m[1])))


def _beside(path: Path) -> np.ndarray | None:
    """(2, 3) of a world file, which has its six numbers column by column; None: there is none."""
    ending = path.suffix
    for name in (ending[:2] + ending[-1:] + "w", ending + "w", ".wld"):
        file = path.with_suffix(name)
        if file.is_file():
            try:
                return np.array([float(word) for word in file.read_text().split()]).reshape(3, 2).T
            except ValueError:
                raise ValueError(f"its world file {file.name} is not six numbers") from None
    return None


def _tagged(image: Image.Image) -> np.ndarray | None:
    """(2, 3) of a GeoTIFF in degrees, north up; None: it says nothing."""
    tags = getattr(image, "tag_v2", {})
    if SCALE not in tags or TIEPOINT not in tags:
        return None
    keys = np.array(tags.get(KEYS, ())).reshape(-1, 4)
    geo = {int(key): int(value) for key, _, _, value in keys[1:]}
    if geo.get(MODEL) != GEOGRAPHIC:
        raise ValueError("its place is not in degrees; gdalwarp -t_srs EPSG:4326 makes it so")
    middle = 0.0 if geo.get(RASTER) == 2 else 0.5  # of a pixel, from what is tied
    right, down = tags[SCALE][:2]
    column, row, _, lon_deg, lat_deg = tags[TIEPOINT][:5]
    return np.array(
        [
            [right, 0.0, lon_deg + (middle - column) * right],
            [0.0, -down, lat_deg - (middle - row) * down],
        ]
    )
