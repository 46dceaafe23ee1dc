# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Series and shapes over time for the viewer: series are sent to a rerun stream in columns."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
import math
from typing import Literal

import numpy as np
import rerun as rr

from smart_tire.analysis.figure import COLORS, SIGMAS
from smart_tire.errors import SmartTireError
from smart_tire.samples import WHEELS
from smart_tire.uncertain import Uncertain

Color = tuple[int, int, int]

TIMELINE = 'time'  # of message stamps, from the first one
# Distinguishable with color vision deficiency.
SKY, ORANGE, GREEN, PURPLE, VERMILLION, BLUE = PALETTE = tuple(
    (int(COLORS[name][1:3], 16), int(COLORS[name][3:5], 16), int(COLORS[name][5:], 16))
    for name in ('sky', 'orange', 'green', 'purple', 'vermillion', 'blue'))
FILM_COLORS = PALETTE[:4]
WHEEL_COLORS: dict[str, Color] = dict(zip(WHEELS, PALETTE))
ESTIMATE, COMMAND, WARNING = SKY, VERMILLION, VERMILLION
TRUTH: Color = (128, 128, 128)  # visible on dark and on light background
CAMERA: Color = (225, 220, 60)
REFERENCES = {'truth': TRUTH, 'camera': CAMERA}  # by their names in entity paths
AXIS: Color = (110, 110, 110)
XYZ_COLORS: tuple[Color, ...] = ((220, 80, 80), (90, 200, 90), (90, 130, 250))
NODE_COLORS: tuple[Color, ...] = (*PALETTE, (150, 150, 255), (190, 190, 190), (160, 110, 60))
LINE_WIDTH, BOUND_WIDTH = 2.0, 0.75  # points of the screen
# Where several samples share a pixel, a peak of one sample remains visible.
AGGREGATION = rr.components.AggregationPolicy.MinMax
Marker = Literal['circle', 'diamond', 'down', 'up']
Style = Callable[[], rr.SeriesLines | rr.SeriesPoints]
STEPS = rr.components.InterpolationMode.StepAfter


class ViewError(SmartTireError, RuntimeError):
    """The viewer does not start, or has ended."""


class SeriesBuffer:
    """Values of the series of one entity since they were last sent."""

    def __init__(self, style: Style, width: int) -> None:
        self.style, self.width = style, width  # values per instant; 0: single points
        self._stamps, self._values = array('q'), array('d')

    def add(self, stamp_ns: int, *values: float) -> None:
        """Add one value per series; infinite values are shown as gaps, like NaN."""
        self._stamps.append(stamp_ns)
        self._values.extend(value if math.isfinite(value) else math.nan for value in values)

    def add_value(self, stamp_ns: int, value: float | Uncertain) -> None:
        """Add a value or an estimate; an unknown sigma leaves the bounds out."""
        mean, sigma = value if isinstance(value, Uncertain) else (value, math.nan)
        if self.width == 3:
            self.add(stamp_ns, mean, mean - SIGMAS * sigma, mean + SIGMAS * sigma)
        elif self.width or math.isfinite(mean):
            self.add(stamp_ns, mean)

    def take(self) -> tuple[array[int], array[float]]:
        """Return timestamps [ns] and values, and forget them."""
        taken = self._stamps, self._values
        self._stamps, self._values = array('q'), array('d')
        return taken


class ViewWriter:
    """
    Writer of what is shown in the viewer to a rerun stream; it records no bag.

    Times in the viewer are those since the instant given to ``begin``. Nothing is sent before
    ``flush``, except shapes and texts, which rerun itself collects.
    """

    def __init__(self, stream: rr.RecordingStream) -> None:
        self.stream = stream
        self._origin_ns: int | None = None
        self._buffers: dict[str, SeriesBuffer] = {}
        self._described: set[str] = set()

    def begin(self, stamp_ns: int) -> None:
        """Set the origin of the times, if it is not set yet."""
        if self._origin_ns is None:
            self._origin_ns = stamp_ns

    def line(self, path: str, name: str, color: Color, *, steps: bool = False,
             width: float = LINE_WIDTH) -> SeriesBuffer:
        """Return the buffer of a line."""
        return self._buffer(path, lambda: rr.SeriesLines(
            names=name, colors=color, widths=width, aggregation_policy=AGGREGATION,
            interpolation_mode=STEPS if steps else None), 1)

    def estimate(self, path: str, name: str, color: Color) -> SeriesBuffer:
        """Return the buffer of an estimate with its lower and upper bound."""
        bound = dimmed(color)
        return self._buffer(path, lambda: rr.SeriesLines(
            names=[name, f'{name} - {SIGMAS:g} σ', f'{name} + {SIGMAS:g} σ'],
            colors=[color, bound, bound], widths=[LINE_WIDTH, BOUND_WIDTH, BOUND_WIDTH],
            aggregation_policy=AGGREGATION), 3)

    def points(self, path: str, name: str, color: Color, *, marker: Marker = 'circle',
               size: float = 3.0, dim: bool = False) -> SeriesBuffer:
        """Return the buffer of single points, to which only finite values are added."""
        return self._buffer(path, lambda: rr.SeriesPoints(
            names=name, colors=dimmed(color) if dim else color, markers=marker,
            marker_sizes=size), 0)

    def _buffer(self, path: str, style: Style, width: int) -> SeriesBuffer:
        if path not in self._buffers:
            self._buffers[path] = SeriesBuffer(style, width)
        return self._buffers[path]

    def shape(self, path: str, stamp_ns: int, *shapes: rr.AsComponents) -> None:
        """Show ``shapes`` from an instant on, until the next ones at the same path."""
        self.stream.set_time(TIMELINE, duration=self._since_origin([stamp_ns])[0])
        self.stream.log(path, *shapes)

    def static(self, path: str, *shapes: rr.AsComponents) -> None:
        """Show ``shapes`` at all times."""
        self.stream.log(path, *shapes, static=True)

    def flush(self) -> None:
        """Send all values; returns when they have left this process. Raises ViewError."""
        for path, buffer in self._buffers.items():
            stamps, values = buffer.take()
            if stamps:
                self._send(path, buffer, stamps, np.array(values))
        try:
            self.stream.flush()
        except RuntimeError as error:
            raise ViewError('the viewer has ended') from error

    def _send(self, path: str, buffer: SeriesBuffer, stamps: Sequence[int],
              values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
        if path not in self._described:
            self._described.add(path)
            self.static(path, buffer.style())
        columns = rr.Scalars.columns(scalars=values)
        if buffer.width > 1:
            columns = columns.partition(np.full(len(stamps), buffer.width))
        times = rr.TimeColumn(TIMELINE, duration=self._since_origin(stamps))
        self.stream.send_columns(path, indexes=[times], columns=columns)

    def _since_origin(self, stamps: Sequence[int]) -> np.ndarray[
            tuple[int], np.dtype[np.timedelta64]]:
        return (np.array(stamps, np.int64) - (self._origin_ns or 0)).astype('timedelta64[ns]')


def dimmed(color: Color) -> Color:
    """Return a darker color, for the bounds around a curve of ``color``."""
    red, green, blue = (round(0.55 * part) for part in color)
    return red, green, blue
