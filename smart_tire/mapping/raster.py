# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Friction as a raster, and its files: those of nav2's map_server, in its mode ``raw``.

The image of a map has 100 times the friction coefficient, the image of its standard deviations
100 times these; 255 is unknown. The YAML file has the keys of map_server, and two of its own,
which map_server ignores: ``frame_id`` and ``sigma_image``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from pathlib import Path
import struct
from typing import Any
import zlib

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.errors import ParameterError
from smart_tire.parameters.path_following import FrictionLimitParams
from smart_tire.paths import read_file, write_text
from smart_tire.samples import FrictionGrid, GRAVITY, Vector3
from smart_tire.yaml_text import parse_yaml

SCALE, UNKNOWN_PIXEL = 100, 255  # of mu 1; 255 is -1 in an OccupancyGrid
MAX_FILE_SIZE = 50_000_000  # bytes of a YAML file or an image
MAX_PIXELS = 16_000_000
PNG_SIGNATURE = b'\x89PNG\r\n\x1a\n'
GRAY = 8, 0, 0, 0, 0  # of a PNG: bits, color type, compression, filter, not interlaced
Image = NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Raster:
    """
    Friction of square cells; row 0 has the smallest y, column 0 the smallest x.

    * ``frame``: of the coordinates
    * ``resolution``: m, edge of a cell
    * ``origin``: m, x and y of the corner of the first cell
    * ``friction``, ``sigma``: (rows, columns) -, mu and its standard deviation; NaN: unknown
    """

    frame: str
    resolution: float
    origin: tuple[float, float]
    friction: Array
    sigma: Array

    def lower_bound(self, x: Array, y: Array, sigmas: float,
                    pose: Vector3 = (0.0, 0.0, 0.0)) -> Array:
        """
        Return mu less ``sigmas`` standard deviations at positions [m]; NaN: unknown.

        ``pose`` (x, y [m], yaw [rad]) is that of the map in the frame of the positions.
        """
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        ahead, left = x - pose[0], y - pose[1]
        places = cos * ahead + sin * left, cos * left - sin * ahead
        column, row = (np.floor((values - first) / self.resolution)
                       for values, first in zip(places, self.origin))
        rows, columns = self.friction.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        at = row[inside].astype(np.intp), column[inside].astype(np.intp)
        found = np.full(np.shape(x), math.nan)
        found[inside] = self.friction[at] - sigmas * self.sigma[at]
        return found

    def widened(self, margin: float, sigmas: float) -> Raster:
        """
        Return the map in which unknown cells may be of the ground of known ones near them.

        An unknown cell is as the one that is most certainly slippery, with the least mu plus
        ``sigmas`` standard deviations, of those at most ``margin`` [m] away along x and y. The
        map becomes larger by the margin.
        """
        reach = int(margin / self.resolution + 1e-6)
        friction, sigma = (np.pad(one, reach, constant_values=math.nan)
                           for one in (self.friction, self.sigma))
        near = friction + sigmas * sigma + 1j * sigma  # fmin compares the real parts
        for axis in (0, 1):
            width = 1  # of the window to one side, of which ``near`` is the least
            while (step := min(width, 2 * reach + 1 - width)) > 0:
                # nothing comes around from the other edge: it is unknown
                near, width = np.fmin(near, np.roll(near, step, axis)), width + step
            near = np.roll(near, -reach, axis)
        known, (x, y) = np.isfinite(friction), self.origin
        return replace(
            self, friction=np.where(known, friction, near.real - sigmas * near.imag),
            sigma=np.where(known, sigma, near.imag), origin=(
                x - reach * self.resolution, y - reach * self.resolution))


def pixels(values: Array, *, upwards: bool = False) -> Image:
    """Return 100 times the ``values``, rounded to the nearest or ``upwards``; NaN: 255."""
    scaled = np.clip(np.ceil(SCALE * values) if upwards else np.round(SCALE * values), 0, SCALE)
    return np.where(np.isfinite(values), scaled, UNKNOWN_PIXEL).astype(np.uint8)


def grid_of(raster: Raster, stamp_ns: int) -> FrictionGrid:
    """Return the friction of ``raster`` as a sample of ``friction_map``."""
    image = pixels(raster.friction)
    return FrictionGrid(stamp_ns, raster.frame, raster.resolution, raster.origin, image.shape[1],
                        image.tobytes())


def speed_mask(raster: Raster, params: FrictionLimitParams, distance: float, max_speed: float
               ) -> Image:
    """
    Return the speed limit of each cell in percent of ``max_speed`` [m/s], 1 to 99; 0 is none.

    With it, the robot stops within ``distance`` [m] on the lower bound of the friction. There is
    none in unknown cells.
    """
    lower = np.maximum(raster.friction - params.sigmas * raster.sigma, params.minimum)
    percent = SCALE / max_speed * np.sqrt(2.0 * params.share * GRAVITY * distance * lower)
    limited = percent < SCALE  # not where unknown: NaN
    return np.where(limited, np.maximum(np.floor(percent), 1.0), 0.0).astype(np.uint8)


def write_raster(path: Path, raster: Raster) -> None:
    """Write the YAML file ``path`` and its two images; raise ParameterError if impossible."""
    sigma = path.with_name(f'{path.stem}_sigma.png')
    write_image(path, raster, pixels(raster.friction), f'sigma_image: {sigma.name}\n')
    _write(sigma, png_bytes(pixels(raster.sigma, upwards=True)))


def write_image(path: Path, raster: Raster, image: Image, more: str = '') -> None:
    """Write ``image``, as the cells of ``raster``, with the YAML file ``path``, for map_server."""
    x, y = raster.origin
    write_text(path, f'image: {path.stem}.png\nmode: raw\nresolution: {raster.resolution!r}\n'
                     f'origin: [{x!r}, {y!r}, 0.0]\nnegate: 0\noccupied_thresh: 1.0\n'
                     f'free_thresh: 0.0\nframe_id: {raster.frame}\n{more}')
    _write(path.with_suffix('.png'), png_bytes(image))


def _write(path: Path, data: bytes) -> None:
    try:
        path.write_bytes(data)
    except OSError as error:
        raise ParameterError(f'{path}: cannot be written ({error.strerror})') from error


def read_raster(path: Path) -> Raster:
    """Return the map in a YAML file and its images; raise ParameterError if it is damaged."""
    try:
        given = parse_yaml(read_file(path, MAX_FILE_SIZE))
        if given['mode'] != 'raw':
            raise ValueError(f'mode is {given["mode"]}, expected raw')
        x, y, yaw = map(float, given['origin'])
        resolution = float(given['resolution'])
        if yaw != 0.0 or not 0.0 < resolution < math.inf or not math.isfinite(x + y):
            raise ValueError('resolution or origin is not valid, expected a yaw of 0')
        friction, sigma = (_values(path.parent / str(given[name]))
                           for name in ('image', 'sigma_image'))
        if friction.shape != sigma.shape:
            raise ValueError('its images have different sizes')
        return Raster(str(given['frame_id']), resolution, (x, y), friction, sigma)
    except KeyError as error:
        raise ParameterError(f'{path}: {error.args[0]} is missing, expected a map of "smart_tire '
                             'map"') from error
    except OSError as error:
        raise ParameterError(f'{error.filename or path}: cannot be read '
                             f'({error.strerror})') from error
    except (ValueError, TypeError) as error:
        raise ParameterError(f'{path}: no friction map ({error})') from error


def _values(path: Path) -> Array:
    """Return the numbers in an image, NaN where they are unknown."""
    try:
        image = png_image(read_file(path, MAX_FILE_SIZE))
    except (ValueError, struct.error, zlib.error) as error:
        raise ValueError(f'{path.name}: {error}') from error
    return np.where(image <= SCALE, image / SCALE, math.nan)[::-1]


def png_bytes(image: Image) -> bytes:
    """Return a gray image, whose last row is drawn at the top, as a PNG file."""
    rows, columns = image.shape
    lines = np.column_stack([np.zeros(rows, np.uint8), image[::-1]])  # without filter
    return PNG_SIGNATURE + b''.join(_chunk(kind, data) for kind, data in (
        (b'IHDR', struct.pack('>II5B', columns, rows, *GRAY)),
        (b'IDAT', zlib.compress(lines.tobytes(), 9)), (b'IEND', b'')))


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack('>I', len(data)) + kind + data + struct.pack('>I', zlib.crc32(kind + data))


def png_image(data: bytes) -> Image:
    """Return the pixels of a gray PNG file of 8 bits, its top first; raise ValueError if other."""
    if not data.startswith(PNG_SIGNATURE):
        raise ValueError('not a PNG file')
    chunks: dict[bytes, bytes] = {}
    at = len(PNG_SIGNATURE)
    while b'IEND' not in chunks:
        size, kind = struct.unpack_from('>I4s', data, at)
        end = at + 8 + size
        content, (check,) = data[at + 8:end], struct.unpack_from('>I', data, end)
        if zlib.crc32(kind + content) != check:
            raise ValueError('damaged')
        chunks[kind] = chunks.get(kind, b'') + content
        at = end + 4
    columns, rows, *kinds = struct.unpack('>II5B', chunks.get(b'IHDR', b''))
    if tuple(kinds) != GRAY or not 0 < rows * columns <= MAX_PIXELS:
        raise ValueError('not a gray image of 8 bits')
    size = rows * (columns + 1)
    lines = zlib.decompressobj().decompress(chunks.get(b'IDAT', b''), size)
    if len(lines) != size:
        raise ValueError('damaged')
    return _unfiltered(np.frombuffer(lines, np.uint8).reshape(rows, columns + 1))


def _unfiltered(lines: Image) -> Image:
    """Return the rows of a PNG (section 9 of its specification), which begin with a filter."""
    found = np.zeros((len(lines), lines.shape[1] - 1), np.uint8)
    above: Any = found[0].copy()
    for row, (kind, *line) in enumerate(lines.tolist()):
        if kind == 0:
            found[row] = line
        elif kind == 1:
            found[row] = np.cumsum(line, dtype=np.uint8)
        elif kind == 2:
            found[row] = np.array(line, np.uint8) + above
        elif kind in (3, 4):
            left = corner = 0
            for column, value in enumerate(line):
                up = int(above[column])
                add = (left + up) // 2 if kind == 3 else _paeth(left, up, corner)
                left, corner = (value + add) % 256, up
                found[row, column] = left
        else:
            raise ValueError('damaged')
        above = found[row]
    return found


def _paeth(left: int, up: int, corner: int) -> int:
    guess = left + up - corner
    return min((left, up, corner), key=lambda one: abs(guess - one))
