# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Images of the overhead camera at a low rate, with the tags that are found in them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from smart_tire.bags import Decoder
from smart_tire.messages import stamp_of
from smart_tire.samples import NS_PER_S
from smart_tire.view.writer import CAMERA, ViewWriter

if TYPE_CHECKING:
    from smart_tire.vision.detection import TagDetector

IMAGE_PERIOD_NS = NS_PER_S // 2  # between two images that are shown


class CameraLayer:
    """The latest image as JPEG, and the outlines of the tags of one ``family`` in it."""

    def __init__(self, writer: ViewWriter, family: str) -> None:
        self._writer, self._family = writer, family
        self._decoders: dict[str, Decoder] = {}
        self._detector: TagDetector | None = None  # its library is loaded with the first image
        self._shown_ns: int | None = None

    def add_image(self, kind: str, data: bytes) -> None:
        """
        Show the message ``data`` (CDR) of the type ``kind``.

        It is left out if another one was shown less than ``IMAGE_PERIOD_NS`` before or after it.
        Raises MessageError for an invalid message, ModuleNotFoundError without opencv.
        """
        from smart_tire.vision.detection import gray_image, jpeg, TagDetector
        msg = self._decoders.setdefault(kind, Decoder(kind))(data)
        stamp_ns = stamp_of(msg)
        if self._shown_ns is not None and abs(stamp_ns - self._shown_ns) < IMAGE_PERIOD_NS:
            return
        image = gray_image(msg)
        self._shown_ns = stamp_ns
        self._writer.begin(stamp_ns)
        if self._detector is None:
            self._detector = TagDetector(self._family)
        tags, _ = self._detector.tags(image)
        self._writer.shape('camera/image', stamp_ns, rr.EncodedImage(
            contents=jpeg(image), media_type='image/jpeg'))
        self._writer.shape('camera/tags', stamp_ns, rr.LineStrips2D(
            [np.vstack([corners, corners[:1]]) for corners in tags.values()], colors=CAMERA,
            labels=[f'tag {tag}' for tag in tags], radii=rr.Radius.ui_points(2.0)))
