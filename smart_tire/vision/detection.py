# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Images of messages, and the tags in them, by the detector of opencv."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Collection, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.errors import MessageError, ParameterError

Image = NDArray[np.uint8]

# encoding of sensor_msgs/Image -> channels and conversion to gray; opencv names a Bayer pattern by
# the second row and column, ROS by the first (sensor_msgs/image_encodings.hpp)
ENCODINGS: dict[str, tuple[int, int | None]] = {
    'mono8': (1, None), '8UC1': (1, None),
    'rgb8': (3, cv2.COLOR_RGB2GRAY), 'bgr8': (3, cv2.COLOR_BGR2GRAY),
    '8UC3': (3, cv2.COLOR_BGR2GRAY),
    'rgba8': (4, cv2.COLOR_RGBA2GRAY), 'bgra8': (4, cv2.COLOR_BGRA2GRAY),
    'bayer_rggb8': (1, cv2.COLOR_BayerBG2GRAY), 'bayer_bggr8': (1, cv2.COLOR_BayerRG2GRAY),
    'bayer_gbrg8': (1, cv2.COLOR_BayerGR2GRAY), 'bayer_grbg8': (1, cv2.COLOR_BayerGB2GRAY)}

# in the order of their prevalence; large dictionaries last, as they contain small ones
OTHER_FAMILIES = ('36h11', '25h9', '16h5', '36h10', '4X4_1000', '5X5_1000', '6X6_1000',
                  '7X7_1000', 'ARUCO_ORIGINAL')
ALONG, ACROSS = 32, 25  # samples along and across an edge
EDGE_SHARE = 0.7        # of the length of an edge: blur makes corners round
EDGE_REACH = 0.07       # of the length, to both sides; a cell, of equal gray, has 0.125
MIN_REACH, MAX_REACH = 1.5, 5.0  # pixels
REFINEMENTS = 3         # from corners that are correct to two pixels
ROBUST_ROUNDS = 6       # of weights, with a quarter of an edge hidden or in the edge of a shadow
PREVIEW_QUALITY = 70  # of 100, of images for viewers


def gray_image(msg: Any) -> Image:
    """
    Return an Image or CompressedImage as gray values (height, width).

    Raises MessageError if its encoding is unknown or its data are incomplete.
    """
    data = np.frombuffer(msg.data, np.uint8) if isinstance(msg.data, (bytes, bytearray)) \
        else np.asarray(msg.data, np.uint8)
    if hasattr(msg, 'format'):
        try:
            image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size else None
        except cv2.error:
            image = None
        if image is None:
            raise MessageError(f'image: {data.size} bytes of format {msg.format!r} are no image')
        return np.asarray(image)
    if msg.encoding not in ENCODINGS:
        raise MessageError(f'image: encoding {msg.encoding!r}, expected one of '
                           f'{", ".join(ENCODINGS)}')
    channels, conversion = ENCODINGS[msg.encoding]
    rows, width = msg.height, channels * msg.width
    if not width or not rows or msg.step < width or data.size < rows * msg.step:
        raise MessageError(f'image: {data.size} bytes for {msg.width} x {rows} pixels '
                           f'{msg.encoding} in rows of {msg.step}')
    image = np.ascontiguousarray(data[:rows * msg.step].reshape(rows, msg.step)[:, :width])
    if channels > 1:
        image = image.reshape(rows, msg.width, channels)
    return image if conversion is None else np.asarray(cv2.cvtColor(image, conversion))


def fill_image(msg: Any, image: Image) -> Any:
    """Write gray values (height, width) into an Image, as ``gray_image`` reads them; return it."""
    msg.height, msg.width = image.shape
    msg.encoding, msg.step, msg.data = 'mono8', msg.width, array('B', image.tobytes())
    return msg


def jpeg(image: Image, quality: int = PREVIEW_QUALITY) -> bytes:
    """Return a gray image as a JPEG file of ``quality`` 1 to 100."""
    return bytes(cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1])


def dictionary_of(family: str) -> Any:
    """
    Return the tags of an AprilTag family, such as 36h11, or of a dictionary of opencv.

    Raises ParameterError for a name that opencv does not know.
    """
    name = family.lower().removeprefix('tag')
    for known in (f'DICT_APRILTAG_{name}', family.upper(), f'DICT_{family.upper()}'):
        if hasattr(cv2.aruco, known):
            return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, known))
    names = ', '.join(sorted(one.removeprefix('DICT_') for one in dir(cv2.aruco)
                             if one.startswith('DICT_')))
    raise ParameterError(f'parameter overhead.tag_family: {family!r}, expected one of {names}')


class TagDetector:
    """
    Finds tags of one family.

    Its edges are those of ``refined``, from corners of opencv, fitted to pixels of the contour,
    which alone turn single tags by up to 0.7 degrees.
    """

    def __init__(self, family: str) -> None:
        settings = cv2.aruco.DetectorParameters()
        settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR
        # the middles of the cells, of small tags too: edges of shadows and blur confuse the others
        settings.perspectiveRemovePixelPerCell = 8
        settings.perspectiveRemoveIgnoredMarginPerCell = 0.3
        tags = dictionary_of(family)
        self._detector = cv2.aruco.ArucoDetector(tags, settings)
        # one of its three windows finds all but the smallest tags
        settings.adaptiveThreshWinSizeMin = settings.adaptiveThreshWinSizeMax
        self._quick_detector = cv2.aruco.ArucoDetector(tags, settings)

    def tags(self, image: Image, enough: Collection[int] = ()) -> tuple[
            dict[int, Array], list[int]]:
        """
        Return corners (4, 2) [pixels] by id, and the ids that are in the image more than once.

        The corners are those of the black square, clockwise from the upright tag's upper left. If
        the tags ``enough`` are found at half the resolution, small other ones may be missing.
        """
        quads: list[tuple[int, Array]] = []
        if enough:
            half = cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
            quads = [(one, 2.0 * quad + 0.5) for one, quad in _quads(self._quick_detector, half)]
        if not enough or not {*enough} <= {one for one, _ in quads}:
            quads = _quads(self._detector, image)
        counts = Counter(one for one, _ in quads)
        return ({one: refined(image, quad) for one, quad in quads if counts[one] == 1},
                [one for one, count in counts.items() if count > 1])


def _quads(detector: Any, image: Image) -> list[tuple[int, Array]]:
    """Return ids and corners (4, 2), to a pixel."""
    corners, ids, _ = detector.detectMarkers(image)
    return [] if ids is None else [(one, np.asarray(quad, dtype=float).reshape(4, 2))
                                   for one, quad in zip(np.ravel(ids).tolist(), corners)]


def refined(image: Image, corners: Array) -> Array:
    """
    Return the corners (4, 2) [pixels] of a dark square: where lines along its four edges meet.

    The contour of a tag consists of whole pixels. An edge is where the gray values across it have
    the mean of both sides: blur and motion, which are symmetrical, do not move it. A side of which
    a part is hidden has the edges that agree with the most of it.
    """
    for _ in range(REFINEMENTS):
        normal, offset = _edges(image, corners)
        corners = np.linalg.solve(np.stack([np.roll(normal, 1, 0), normal], 1),
                                  np.stack([np.roll(offset, 1), offset], 1)[..., None])[..., 0]
    return corners


def _edges(image: Image, corners: Array) -> tuple[Array, Array]:
    """Return normals (4, 2) and offsets (4,) [pixels] of the lines from corner to corner."""
    ends = np.roll(corners, -1, axis=0)
    length = np.linalg.norm(ends - corners, axis=1, keepdims=True)
    along = (ends - corners) / length
    normal = np.stack([along[:, 1], -along[:, 0]], -1)  # corners are clockwise: out of the square
    reach = np.clip(EDGE_REACH * length, MIN_REACH, MAX_REACH)
    places = EDGE_SHARE * length * np.linspace(-0.5, 0.5, ALONG)  # (4, ALONG), from the middle
    across = reach * np.linspace(-1.0, 1.0, ACROSS)
    points = 0.5 * (corners + ends)[:, None, None] + (
        places[..., None, None] * along[:, None, None]
        + across[:, None, :, None] * normal[:, None, None])
    gray = cv2.remap(image, points.astype(np.float32).reshape(-1, ACROSS, 2), None,
                     cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
                     ).astype(float).reshape(4, ALONG, ACROSS)
    # of each place: a shadow may lie across the edge
    inside, outside = gray[..., :4].mean(-1), gray[..., -4:].mean(-1)
    dark = ((outside[..., None] - gray) / np.maximum(outside - inside, 1.0)[..., None]).sum(-1)
    edge = np.clip(2.0 * reach / (ACROSS - 1) * (dark - 0.5) - reach, -reach, reach)
    basis, used = np.stack([places, np.ones_like(places)], -1), np.ones_like(places)
    for _ in range(ROBUST_ROUNDS):  # with weights of a Cauchy distribution
        weighted = (used[..., None] * basis).transpose(0, 2, 1)
        line = np.linalg.solve(weighted @ basis, weighted @ edge[..., None])  # slope, mean
        rest = np.abs(edge - (basis @ line)[..., 0])
        used = 1.0 / (1.0 + (rest / np.maximum(
            1.5 * np.median(rest, axis=1, keepdims=True), 0.01)) ** 2)
    slope, mean = line[:, 0], line[:, 1]
    turned = (normal - slope * along) / np.hypot(1.0, slope)
    return turned, np.sum(turned * (0.5 * (corners + ends) + mean * normal), axis=1)


def other_families(family: str, images: Sequence[Image]) -> list[str]:
    """Return a text with the first other family of which there are tags in all ``images``."""
    for name in OTHER_FAMILIES:
        if images and name != family and all(TagDetector(name).tags(one)[0] for one in images):
            return [f'there are tags of {name}, overhead.tag_family is {family}']
    return []
