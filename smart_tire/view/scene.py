# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The scene: samples and diagnostics in, entities of a rerun recording out."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import math
from typing import Any, TYPE_CHECKING

import numpy as np
import rerun as rr

from smart_tire.bags import Decoder
from smart_tire.errors import MessageError
from smart_tire.messages import NodeStatus, stamp_of
from smart_tire.parameters.overhead import OverheadParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import Friction, NS_PER_S, Sample
from smart_tire.view.contact import CrossingLayer, FilmLayer, ForceLayer
from smart_tire.view.path import PathLayer
from smart_tire.view.series import SeriesLayer
from smart_tire.view.writer import (
    CAMERA, Color, FILM_COLORS, NODE_COLORS, SeriesBuffer, TRUTH, ViewWriter, WARNING)

if TYPE_CHECKING:
    from smart_tire.vision.detection import TagDetector

# Counts of what went wrong; of each the sum over all nodes is always shown.
COUNTS = {'batches_lost': 'radio batches lost', 'batches_late': 'radio batches late',
          'frames_bad': 'frames or messages bad', 'late_messages': 'messages late',
          'messages_lost': 'messages lost by writer or nodes'}
COUNT_COLORS = (*FILM_COLORS, WARNING)
AGE = 'last_message_age'
LEVELS = ('INFO', 'WARN', 'ERROR', 'WARN')  # of events by the level of a status: 3 is stale
CHANGES = 'ground_changes'  # count of friction_estimator
IMAGE_PERIOD_NS = NS_PER_S // 2  # between two images that are shown

Handler = Callable[[Any], None]


class Scene:
    """
    Shows samples by their standard topic name, and diagnostic statuses.

    Feed it in order of reception and call ``flush`` now and then: what was added becomes visible
    then.
    """

    def __init__(self, stream: rr.RecordingStream, robot: RobotParams,
                 tag_family: str = OverheadParams().tag_family) -> None:
        self._camera: CameraLayer | None  # None: cannot be shown
        self._reason = ''  # why the latest of the images that were not shown was not
        self._writer = writer = ViewWriter(stream)
        self._films = FilmLayer(writer, round(NS_PER_S / robot.film.sample_rate))
        self._path, self._links = PathLayer(writer), LinkLayer(writer)
        self._series, self._camera = SeriesLayer(writer), CameraLayer(writer, tag_family)
        crossings, forces, path = (
            CrossingLayer(writer, robot), ForceLayer(writer, robot), self._path)
        self._handlers: dict[str, tuple[Handler, ...]] = {
            'wheel_states': (crossings.add_wheels,),
            'tire_samples': (self._films.add_films, crossings.add_films),
            'odom': (path.add_odometry, forces.add_odometry), 'wheel_slip': (forces.add_slip,),
            'ground_state': (forces.add_ground,),
            'tire_friction': (crossings.add_friction, forces.add_friction,
                              self._links.add_friction),
            'path': (path.add_wanted,), 'goal_pose': (path.add_wanted,),
            'friction_map': (path.add_map,),
            'ground_truth/odom': (partial(path.add_reference, 'truth'),),
            'overhead/odom': (partial(path.add_reference, 'camera'),)}

    @property
    def topics(self) -> tuple[str, ...]:
        """Return the standard names of the topics that are shown."""
        return tuple({**dict.fromkeys(self._series.topics), **self._handlers})

    def add_sample(self, topic: str, sample: Sample) -> None:
        """Show a sample; samples of topics that are not shown are ignored."""
        if sample.stamp_ns:  # a command may have none
            self._writer.begin(sample.stamp_ns)
        self._series.add_sample(topic, sample)
        for handler in self._handlers.get(topic, ()):
            handler(sample)

    def add_image(self, stamp_ns: int, kind: str, data: bytes) -> None:
        """
        Show an image of the overhead camera, a message of the type ``kind`` (CDR).

        At most two in a second are shown. ``stamp_ns`` is when it was received; why it is not
        shown is an event at this time.
        """
        if self._camera is None:
            return
        try:
            self._camera.add_image(kind, data)
            return
        except MessageError as error:
            reason = str(error)
        except ModuleNotFoundError as error:
            self._camera = None
            reason = f'{error.name} is missing: pip install smart_tire[camera]'
        if reason != self._reason:
            self._writer.begin(stamp_ns)
            self._links.event(stamp_ns, f'image not shown: {reason}', 'WARN')
        self._reason = reason

    def add_status(self, stamp_ns: int, status: NodeStatus) -> None:
        """Show the diagnostic status of a node at a time [ns]."""
        self._writer.begin(stamp_ns)
        self._links.add_status(stamp_ns, status)

    def add_delay(self, stamp_ns: int, delay: float) -> None:
        """Show the time [s] from the reception of a sample until it was sent to the viewer."""
        self._links.add_delay(stamp_ns, delay)

    def flush(self) -> None:
        """Send what was added; returns when it has left this process."""
        self._writer.flush()

    def finish(self) -> None:
        """Send everything, at the end of the recording."""
        self._films.finish()
        self._path.finish()
        self.flush()


class LinkLayer:
    """
    Health of links and nodes by /diagnostics: counts and ages by node and topic.

    A new state of a node and a change of the ground are events.
    """

    def __init__(self, writer: ViewWriter) -> None:
        self._writer = writer
        self._colors: dict[str, Color] = {}
        self._states: dict[str, tuple[int, str]] = {}
        self._counts: dict[tuple[str, str], float] = {}  # key, node -> count
        self._totals = {key: writer.line(f'links/total/{key}', name, color, steps=True)
                        for (key, name), color in zip(COUNTS.items(), COUNT_COLORS)}
        self._delay = writer.line('links/delay', 'reception to viewer [s]', TRUTH)
        self._changes, self._friction = math.inf, math.nan
        self._change = writer.points('friction/ground_change', 'change of the ground', WARNING,
                                     marker='diamond', size=8.0)

    def add_friction(self, sample: Friction) -> None:
        """Add a friction coefficient, at which a change of the ground is marked."""
        self._friction = sample.friction_coefficient.value

    def add_status(self, stamp_ns: int, status: NodeStatus) -> None:
        """Add the status of a node."""
        node = status.name.strip('/')
        for key, text in status.values.items():
            value = number(text)
            topic, _, quantity = key.rpartition('.')
            if value is None:
                continue
            if key in COUNTS:
                self._add_count(stamp_ns, node, key, value)
            elif key == CHANGES:
                self._add_changes(stamp_ns, value)
            elif quantity == AGE:
                self._line(f'links/ages/{_path(node, topic)}', f'{node} {topic}'.strip() + ' [s]',
                           node).add(stamp_ns, value)
        state = status.level, status.message
        if self._states.get(node) != state:
            self._states[node] = state
            self.event(stamp_ns, f'{node}: {status.message}', LEVELS[min(status.level, 3)])

    def event(self, stamp_ns: int, text: str, level: str = 'INFO') -> None:
        """Add a line of text."""
        self._writer.shape('links/events', stamp_ns, rr.TextLog(text, level=level))

    def add_delay(self, stamp_ns: int, delay: float) -> None:
        """Add the time [s] from the reception of a sample until it was sent to the viewer."""
        self._delay.add(stamp_ns, delay)

    def _add_changes(self, stamp_ns: int, count: float) -> None:
        if count > self._changes:
            self._change.add(stamp_ns, self._friction)
            self.event(stamp_ns, 'change of the ground')
        self._changes = count

    def _add_count(self, stamp_ns: int, node: str, key: str, value: float) -> None:
        self._counts[key, node] = value
        total = sum(count for (name, _), count in self._counts.items() if name == key)
        self._totals[key].add(stamp_ns, total)
        self._line(f'links/counts/{_path(node, key)}', f'{node}: {COUNTS[key]}', node,
                   steps=True).add(stamp_ns, value)

    def _line(self, path: str, name: str, node: str, *, steps: bool = False) -> SeriesBuffer:
        color = self._colors.setdefault(node, NODE_COLORS[len(self._colors) % len(NODE_COLORS)])
        return self._writer.line(path, name, color, steps=steps)


def number(text: str) -> float | None:
    """Return ``text`` as a number, None if it is none; an infinite age is NaN."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else math.nan


def _path(node: str, name: str) -> str:
    return '/'.join(part for part in (*node.split('/'), *name.split('/')) if part)


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
