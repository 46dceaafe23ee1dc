# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The scene: samples and diagnostics in, entities of a rerun recording out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import rerun as rr

from smart_tire.estimation.streams import FRICTION
from smart_tire.parameters import FrictionEstimatorParams
from smart_tire.samples import Friction, NS_PER_S, Sample
from smart_tire.view.contact import CrossingLayer, FilmLayer
from smart_tire.view.forces import ForceLayer
from smart_tire.view.friction import FrictionLayer
from smart_tire.view.links import LinkLayer, Status
from smart_tire.view.motion import BodyLayer, ImuLayer, ProgressLayer, SlipLayer, WheelLayer
from smart_tire.view.path import PathLayer
from smart_tire.view.recorder import Recorder

Handler = Callable[[Any], None]


class Scene:
    """
    Shows samples by their standard topic name, and diagnostic statuses.

    Feed it in order of reception and call ``flush`` now and then: what was added becomes visible
    then. ``fit`` also runs a friction estimator, for the fits of the waveforms.
    """

    def __init__(self, stream: rr.RecordingStream, params: FrictionEstimatorParams, *,
                 fit: bool = True) -> None:
        self._recorder = recorder = Recorder(stream)
        robot = params.robot
        self._films = FilmLayer(recorder, round(NS_PER_S / robot.film.sample_rate))
        self._path, self._links = PathLayer(recorder), LinkLayer(recorder)
        self._friction = FrictionLayer(recorder)
        self._crossings = CrossingLayer(recorder, params, self._on_change) if fit else None
        slip, body = SlipLayer(recorder), BodyLayer(recorder)
        wheels, imu, forces = WheelLayer(recorder), ImuLayer(recorder), ForceLayer(recorder, robot)
        friction, path = self._friction, self._path
        self._handlers: dict[str, tuple[Handler, ...]] = {
            'imu/data': (imu.add,), 'wheel_states': (wheels.add,),
            'tire_samples': (self._films.add,), 'tire_battery': (imu.add_battery,),
            'odom': (body.add, path.add, forces.add_odometry),
            'wheel_slip': (slip.add, forces.add_slip), 'icr': (body.add_icr,),
            'ground_state': (friction.add_ground, forces.add_ground),
            'tire_friction': (friction.add, forces.add_friction),
            'path': (path.add_wanted,), 'goal_pose': (path.add_wanted,),
            'path_progress': (ProgressLayer(recorder).add,),
            'cmd_vel': (body.add_command,), 'wheel_commands': (wheels.add_set_points,),
            'motor_commands': (wheels.add_duties,),
            'ground_truth/odom': (body.add_truth, path.add_truth),
            'ground_truth/wheel_slip': (slip.add_truth,),
            'ground_truth/tire_friction': (friction.add_truth,),
            'overhead/odom': (body.add_truth, path.add_truth),
            'overhead/wheel_slip': (slip.add_truth,)}
        if self._crossings is not None:
            for topic in FRICTION.inputs.values():
                self._handlers[topic] += (self._crossings.add,)

    @property
    def topics(self) -> tuple[str, ...]:
        """Return the standard names of the topics that are shown."""
        return tuple(self._handlers)

    def add(self, topic: str, sample: Sample) -> None:
        """Show a sample; samples of topics that are not shown are ignored."""
        if sample.stamp_ns:  # a command may have none
            self._recorder.begin(sample.stamp_ns)
        for handler in self._handlers.get(topic, ()):
            handler(sample)

    def add_status(self, stamp_ns: int, status: Status) -> None:
        """Show the diagnostic status of a node at a time [ns]."""
        self._recorder.begin(stamp_ns)
        self._links.add(stamp_ns, status)

    def add_delay(self, stamp_ns: int, delay: float) -> None:
        """Show the time [s] from the reception of a sample until it was sent to the viewer."""
        self._links.add_delay(stamp_ns, delay)

    def flush(self) -> None:
        """Send what was added; returns when it has left this process."""
        self._recorder.flush()

    def finish(self) -> None:
        """Send everything, at the end of the recording."""
        if self._crossings is not None:
            self._crossings.finish()
        self._films.finish()
        self._path.finish()
        self.flush()

    def _on_change(self, friction: Friction) -> None:
        self._friction.add_change(friction)
        self._links.event(friction.stamp_ns, f'change of the ground under {friction.wheel}')
