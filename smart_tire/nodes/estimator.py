# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Base class of the estimator nodes: samples to the estimator, its estimates to topics."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Protocol, TypeVar

from smart_tire.messages import imu_from_msg, resolved_joints, topic_of, TOPICS
from smart_tire.messages.wheel_reader import WheelReader
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.lockstep import Follower
from smart_tire.parameters import JointParams
from smart_tire.samples import Sample, WheelSample

Params = TypeVar('Params')


class Estimator(Protocol):
    """An estimator, independent of ROS."""

    def update(self, sample: Any) -> list[Any]:
        """Process a sample; return the estimates that it completes."""

    @property
    def late(self) -> Mapping[str, int]:
        """Return topic -> number of samples dropped because they were late."""

    def status(self) -> Mapping[str, str | int | float]:
        """Return values for the diagnostics."""


class EstimatorNode(SmartTireNode[Params]):
    """
    Node around an estimator; message timestamps are its only time.

    During a replay it processes its inputs in recorded order (``smart_tire.nodes.lockstep``).
    """

    def __init__(self, name: str, params_class: type[Params],
                 new_estimator: Callable[[Params], Estimator], outputs: tuple[str, ...]) -> None:
        super().__init__(name, params_class)
        self._new_estimator = new_estimator
        self.completed: Counter[str] = Counter()  # of wheel_states
        self._contradictions: Counter[str] = Counter()  # of imu/data
        self._publish = {output: self.make_publisher(output) for output in outputs}
        self._topics = {output: self.resolve_topic_name(output) for output in outputs}
        self._follower = Follower(self, self.restart, self.finish)
        for topic in self._topics.values():
            self._follower.add_output(topic)
        self.restart()

    def restart(self) -> None:
        """Replace the estimator by a new one in its initial state."""
        self.estimator = self._new_estimator(self.params)
        self._has_estimates = False

    def recover(self) -> None:
        """Restart after an unforeseen error, which may have left a half of an update."""
        self.get_logger().warning('restarted from the priors')
        self.restart()

    def wrap_callback(self, name: str,
                      on_message: Callable[[Any], None]) -> Callable[[Any], None]:
        """
        Return a callback that defers messages to their recorded order during a replay.

        In one process with its drivers an estimator follows no replay.
        """
        if self.exchange is not None and self.exchange.live:
            return on_message
        return self._follower.add_input(self.resolve_topic_name(name), on_message)

    def conversion(self, name: str, joints: JointParams) -> Callable[[Any], Sample | None]:
        """
        Return the conversion of messages on the topic ``name`` to samples.

        The wheels are ``joints``; others that are recognized by their names are logged once.
        """
        if name == 'imu/data':
            return partial(imu_from_msg, contradictions=self._contradictions)
        if name != 'wheel_states':
            return TOPICS[name].from_msg
        known, read = {joints.names}, WheelReader(joints)
        self.completed = read.completed

        def convert(msg: Any) -> WheelSample | None:
            sample = read(msg)
            names = resolved_joints(tuple(msg.name), joints).names
            if joints.is_standard and names not in known:
                known.add(names)
                self.get_logger().info('wheel_states: the wheels are the joints '
                                       f'{", ".join(dict.fromkeys(names))}, by their names')
            return sample

        return convert

    def on_sample(self, sample: Sample | None) -> None:
        """Process a sample of any input and publish the estimates that it completes."""
        if sample is not None:
            for estimate in self.estimator.update(sample):
                self.publish_estimate(estimate)

    def finish(self) -> None:
        """Publish the estimates that await further samples, at the end of a replay."""

    def publish_estimate(self, estimate: Sample) -> None:
        """Publish one estimate."""
        name = topic_of(estimate)
        if not self._has_estimates:
            self._has_estimates = True
            self.get_logger().info(f'first estimate: {name}')
        self._publish[name](estimate)
        self._follower.published(self._topics[name], estimate.stamp_ns)

    def fill_status(self, status: Status) -> None:
        """Add late messages, and the state of the estimator and of a replay."""
        late = self.estimator.late
        status.values['late_messages'] = total = sum(late.values())
        status.values.update({f'{name}.late_messages': count for name, count in late.items()})
        status.values.update(self.estimator.status())
        if new := status.new('late', total):
            status.warn(f'{new} messages dropped: older than reorder_window', by_host=True)
        status.values.update({f'wheel_states.{kind}': count
                              for kind, count in self.completed.items() if count})
        if self._contradictions:
            status.warn(f'imu/data: {" and ".join(sorted(self._contradictions))}: covariance -1, '
                        'not measured (REP-145), but values that are not zero: they are used')
        self._fill_replay(status)

    def _fill_replay(self, status: Status) -> None:
        if lost := self._follower.leave_lost_leader():
            self.get_logger().warning(f'{lost} ended during a replay: inputs are processed as '
                                      'they arrive')
        if self._follower.leader:
            status.values['replay'] = self._follower.leader
        if new := status.new('foreign', self._follower.foreign):
            status.warn(f'{new} messages received during a replay that are not part of it')
