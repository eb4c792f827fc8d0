"""The user's picture of the ground: where its pixels come to lie, and what is refused in one line."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, TiffImagePlugin

from gcs.contract.frames import Frame
from gcs.contract.messages import InputError
from web.memory.site import KEYS, MODEL, RASTER, SCALE, TIEPOINT, laid, read

FRAME = Frame(-35.3632, 149.1652, 584.0)
STEP_DEG = 2e-5  # of a pixel, about 2 m
WEST, NORTH = 149.1552, -35.3532  # of the middle of the first pixel
COLUMN, ROW = 320, 640  # of the one that is marked
RED, GREEN = (250, 10, 10), (10, 250, 10)


def marked() -> Image.Image:
    pixels = np.full((1000, 800, 3), GREEN, np.uint8)
    pixels[ROW - 1 : ROW + 2, COLUMN - 1 : COLUMN + 2] = RED
    return Image.fromarray(pixels)


def world_file(path: Path, east: tuple[float, float], south: tuple[float, float]) -> None:
    """East and south: degrees of longitude and latitude from a pixel to the next one right, and down."""
    path.write_text("\n".join(map(str, (*east, *south, WEST, NORTH))))


def where_red(picture) -> np.ndarray:
    """(2,) east and north in m of the middle of what is red."""
    rows, columns = np.nonzero((picture.pixels[..., 0] > 150) & (picture.pixels[..., 1] < 100))
    height, width = picture.pixels.shape[:2]
    across, down = (columns.mean() + 0.5) / width - 0.5, (rows.mean() + 0.5) / height - 0.5
    return np.array(picture.middle_m) + np.array((across * picture.size_m[0], -down * picture.size_m[1]))


def expected(lon_deg: float, lat_deg: float) -> np.ndarray:
    return FRAME.to_enu(lat_deg, lon_deg, FRAME.alt_m)[:2]


@pytest.mark.parametrize("name", ["site.pgw", "site.pngw", "site.wld"])
def test_a_pixel_lies_where_the_world_file_has_it(tmp_path, name):
    marked().save(tmp_path / "site.png")
    world_file(tmp_path / name, (STEP_DEG, 0.0), (0.0, -STEP_DEG))
    picture = laid(read(tmp_path / "site.png"), FRAME)
    there = expected(WEST + COLUMN * STEP_DEG, NORTH - ROW * STEP_DEG)
    np.testing.assert_allclose(where_red(picture), there, atol=1.0)  # half a pixel
    assert picture.pixels.shape[2] == 3


def test_a_turned_picture_is_laid_north_up_and_bare_corners_are_clear(tmp_path):
    marked().save(tmp_path / "site.png")
    turn = np.radians(30.0)
    east = (STEP_DEG * np.cos(turn), STEP_DEG * np.sin(turn))
    south = (STEP_DEG * np.sin(turn), -STEP_DEG * np.cos(turn))
    world_file(tmp_path / "site.pgw", east, south)
    picture = laid(read(tmp_path / "site.png"), FRAME)
    lon, lat = np.array([WEST, NORTH]) + COLUMN * np.array(east) + ROW * np.array(south)
    np.testing.assert_allclose(where_red(picture), expected(lon, lat), atol=1.5)
    assert picture.pixels[0, 0, 3] == 0


def test_a_large_picture_is_made_smaller_and_stays_in_place(tmp_path):
    pixels = np.full((6000, 5000, 3), GREEN, np.uint8)
    pixels[3000:3020, 2000:2020] = RED
    Image.fromarray(pixels).save(tmp_path / "site.png")
    world_file(tmp_path / "site.pgw", (STEP_DEG / 10, 0.0), (0.0, -STEP_DEG / 10))
    picture = laid(read(tmp_path / "site.png"), FRAME)
    assert max(picture.pixels.shape) == 2048
    there = expected(WEST + 2009.5 * STEP_DEG / 10, NORTH - 3009.5 * STEP_DEG / 10)
    np.testing.assert_allclose(where_red(picture), there, atol=0.5)


@pytest.mark.parametrize(("raster", "shift"), [(1, 0.5), (2, 0.0)])
def test_a_geotiff_says_itself_where_it_lies(tmp_path, raster, shift):
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    for tag, kind, value in (
        (SCALE, 12, (STEP_DEG, STEP_DEG, 0.0)),
        (TIEPOINT, 12, (0.0, 0.0, 0.0, WEST, NORTH, 0.0)),
        (KEYS, 3, (1, 1, 0, 2, MODEL, 0, 1, 2, RASTER, 0, 1, raster)),
    ):
        tags[tag], tags.tagtype[tag] = value, kind
    marked().save(tmp_path / "site.tif", tiffinfo=tags)
    there = expected(WEST + (COLUMN + shift) * STEP_DEG, NORTH - (ROW + shift) * STEP_DEG)
    np.testing.assert_allclose(where_red(laid(read(tmp_path / "site.tif"), FRAME)), there, atol=1.0)


def test_what_cannot_be_laid_is_refused_in_one_line(tmp_path):
    path = tmp_path / "site.png"
    with pytest.raises(InputError, match="No such file"):
        read(path)
    path.write_text("no picture")
    with pytest.raises(InputError, match="no picture; name a PNG"):
        read(path)
    marked().save(path)
    with pytest.raises(InputError, match=r"put a world file site\.wld beside it"):
        read(path)
    (tmp_path / "site.wld").write_text("1 2 three")
    with pytest.raises(InputError, match=r"site\.wld is not six numbers"):
        read(path)
    (tmp_path / "site.wld").write_text("0.5 0 0 -0.5 512000.0 6086000.0")  # metres of a projection
    with pytest.raises(InputError, match="not in degrees; gdalwarp -t_srs EPSG:4326"):
        read(path)
