# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags of other robots: standard recordings with other topics, joints and timestamps."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from smart_tire.bags import BagWriter, channel_of
from smart_tire.bags.cdr import empty, Encoder
from smart_tire.messages import ALL_TOPICS, TOPICS
from smart_tire.samples import WHEELS, WheelSample

JOINTS = TOPICS['wheel_states'].type
IMU = TOPICS['imu/data'].type


@dataclass
class Foreign:
    """How a robot names its topics and joints."""

    topics: Mapping[str, str] = field(default_factory=dict)  # standard name -> name in the bag
    # joints of ``wheel_states``: name -> wheel whose values it has ('': a joint of an arm)
    joints: Mapping[str, str] = field(default_factory=lambda: dict(zip(WHEELS, WHEELS)))
    inverted: Sequence[str] = ()
    omitted: Sequence[str] = ()      # standard topics that are not recorded
    zero_stamps: Sequence[str] = ()  # standard topics whose header.stamp is zero
    custom_data: Mapping[str, str] = field(default_factory=dict)

    def write(self, path: Path, events: Iterable[tuple[int, str, Any]]) -> Path:
        """Write ``events`` (receive time, standard topic, sample) into a bag."""
        encoders: dict[str, Encoder] = {}
        with BagWriter(path, custom_data=self.custom_data) as writer:
            for receive_ns, topic, sample in events:
                if topic in self.omitted:
                    continue
                standard, name = ALL_TOPICS[topic], '/' + self.topics.get(topic, topic).lstrip('/')
                writer.add_topic(channel_of(name, standard.type))
                encode = encoders.setdefault(standard.type, Encoder(standard.type))
                writer.write(name, receive_ns, encode(self._message(topic, sample)))
        return path

    def _message(self, topic: str, sample: Any) -> Any:
        msg = ALL_TOPICS[topic].to_msg(empty(ALL_TOPICS[topic].type), sample)
        if isinstance(sample, WheelSample):
            msg.name = list(self.joints)
            for name in ('velocity', 'position', 'effort'):
                setattr(msg, name, [] if getattr(sample, name) is None else [
                    self._value(sample, name, joint) for joint in self.joints])
        if topic in self.zero_stamps:
            msg.header.stamp.sec = msg.header.stamp.nanosec = 0
        msg.header.frame_id = 'other_frame' if topic in ('imu/data', 'wheel_states') \
            else msg.header.frame_id
        return msg

    def _value(self, sample: WheelSample, name: str, joint: str) -> float:
        wheel = self.joints[joint]
        if not wheel:
            return 1.0
        value = getattr(sample, name)[WHEELS.index(wheel)]
        return -value if joint in self.inverted else value


def add_messages(writer: BagWriter, name: str, type_name: str, count: int,
                 change: Callable[[Any], None] = lambda msg: None) -> None:
    """Write ``count`` messages of another topic."""
    writer.add_topic(channel_of(name, type_name))
    msg = empty(type_name)
    change(msg)
    for k in range(count):
        writer.write(name, k, Encoder(type_name)(msg))
