# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A node in a program that drives the robot, by velocities or along paths, and watches it."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from smart_tire.messages import statuses_from_msg
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.qos import latest_qos, subscriber_qos
from smart_tire.parameters import WheelControllerParams
from smart_tire.samples import (
    Friction, Odometry, PathProgress, PlannedPath, Sample, Vector3, VelocityCommand,
    WheelSample, WheelSlip)
from std_srvs.srv import Trigger

COMMAND_PERIOD = 0.05  # s: several commands within the time-out of wheel_controller
CANCEL_SERVICE = 'cancel_path'
STOPPED = 'motors stopped'  # in the diagnostics of motor_driver


class Pilot(SmartTireNode[WheelControllerParams]):
    """
    Publishes paths or velocity commands; attributes hold the latest samples received.

    Publishes ``path`` from ``enable_path`` or the first ``follow`` on, ``cmd_vel`` from the first
    ``command`` or ``drive`` until ``release``, and ``/diagnostics``; subscribes to ``odom``,
    ``wheel_states``, ``wheel_slip``, ``tire_friction``, ``path_progress``,
    ``emergency_stop_active``, which ends all driving until the next command, and
    ``/diagnostics``; calls ``cancel_path``. ``on_sample`` gets all samples of IMU and wheels.
    Parameters: those of ``wheel_controller``.
    """

    # also if many messages wait: what it receives is never old
    paced_timers, paced_by, pace_lag_ns = True, 'wheel_states', 1_000_000_000

    def __init__(self, name: str = 'pilot',
                 on_sample: Callable[[Sample], None] | None = None) -> None:
        super().__init__(name, WheelControllerParams)
        self._driven: tuple[float, float] | None = None  # command that is repeated
        self.odometry: Odometry | None = None
        self.wheels: WheelSample | None = None
        self.slip: WheelSlip | None = None
        self.friction: dict[str, Friction] = {}      # wheel -> latest estimate
        self.crossings: dict[str, int] = {}           # wheel -> number of patch crossings
        self.health: dict[str, dict[str, str]] = {}  # node -> its diagnostics
        self.stopped = ''  # what motor_driver says while it stops the motors
        self.progress: PathProgress | None = None     # since the latest ``follow``
        self.emergency_stop = False
        self._publish_velocity: Callable[[Any], None] | None = None
        self._publish_path: Callable[[Any], None] | None = None
        self._followed = False
        self._cancel = self.create_client(Trigger, CANCEL_SERVICE)
        latest = {'odom': 'odometry', 'wheel_slip': 'slip'}
        if on_sample is None:
            latest['wheel_states'] = 'wheels'
        else:
            for topic in ('imu/data', 'wheel_states'):
                self.subscribe(topic, on_sample)
        for topic, field in latest.items():  # on a busy machine a queue is always full
            self.subscribe(topic, self._store_in(field), profile=latest_qos(topic))
        self.subscribe('path_progress', self._store_in('progress'))
        self.subscribe('tire_friction', self._on_friction)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics,
                                 subscriber_qos('/diagnostics'))
        self.subscribe_state('emergency_stop_active', self._on_emergency_stop)
        self.call_every(COMMAND_PERIOD, self._repeat)

    def listeners(self, topic: str) -> int:
        """Return how many of the nodes discovered so far listen to ``path`` or ``cmd_vel``."""
        return self.count_subscribers(topic)

    @property
    def has_path(self) -> bool:
        """Return whether this node has published a path."""
        return self._followed

    def follow(self, poses: tuple[Vector3, ...]) -> None:
        """Publish a path through ``poses`` (m, m, rad in ``odom``)."""
        self._followed, self.progress = True, None
        self.enable_path()(PlannedPath(self.now_ns(), self.params.robot.frames['odom'], poses))

    def enable_path(self) -> Callable[[Any], None]:
        """Create the publisher of ``path``, so that the first path finds its subscriber."""
        self._publish_path = self._publish_path or self.make_publisher('path')
        return self._publish_path

    def cancel(self) -> Any:
        """Return the future of the answer of ``cancel_path``; None if nothing offers it."""
        return self._cancel.call_async(Trigger.Request()) if (
            self._cancel.service_is_ready()) else None

    def enable(self) -> Callable[[Any], None]:
        """Create the publisher of ``cmd_vel``, so that the first command finds its subscriber."""
        self._publish_velocity = self._publish_velocity or self.make_publisher('cmd_vel')
        return self._publish_velocity

    def command(self, speed: float, yaw_rate: float) -> None:
        """Publish a velocity command [m/s], [rad/s]."""
        self.enable()(VelocityCommand(self.now_ns(), speed, yaw_rate))

    def drive(self, left_rpm: float, right_rpm: float) -> None:
        """Command the velocity with these wheel speeds [rev/min] of the sides, repeatedly."""
        if self.emergency_stop:
            return
        left, right = (rpm * math.tau / 60.0 * self.params.robot.wheel_radius
                       for rpm in (left_rpm, right_rpm))
        self._driven = 0.5 * (left + right), (right - left) / self.params.effective_track
        self._repeat()

    def halt(self) -> None:
        """Command standstill once, if this node has commanded a velocity, and nothing after."""
        self._driven = None
        if self._publish_velocity is not None:
            self.command(0.0, 0.0)

    def stop(self) -> None:
        """Command standstill."""
        self.halt()

    def _repeat(self) -> None:
        if self._driven is not None:
            self.command(*self._driven)

    def release(self) -> None:
        """Command standstill and end the publisher of ``cmd_vel``, so that others may drive."""
        self.halt()
        self._publish_velocity = None
        name = self.resolve_topic_name('cmd_vel')
        for publisher in list(self.publishers):
            if publisher.topic_name == name:
                self.destroy_publisher(publisher)

    def _store_in(self, field: str) -> Callable[[Any], None]:
        return lambda sample: setattr(self, field, sample)

    def _on_friction(self, friction: Friction) -> None:
        self.friction[friction.wheel] = friction
        self.crossings[friction.wheel] = self.crossings.get(friction.wheel, 0) + 1

    def _on_emergency_stop(self, engaged: bool) -> None:
        self.emergency_stop = engaged
        if engaged and self._driven is not None:
            self.halt()

    def _on_diagnostics(self, msg: Any) -> None:
        for status in statuses_from_msg(msg):
            name = status.name.rpartition('/')[2]
            self.health[name] = status.values
            if name == 'motor_driver':
                self.stopped = status.message if STOPPED in status.message else ''
