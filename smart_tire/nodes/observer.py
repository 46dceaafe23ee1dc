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

"""Nodes that pass what others publish to their owner: chosen samples, or all raw messages."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import QoSProfile

from smart_tire.messages import find_topic, NodeStatus, statuses_from_msg, TOPICS
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.qos import matching_qos, requests_less, subscriber_qos
from smart_tire.samples import Sample, WHEELS

DISCOVERY_PERIOD = 0.3  # s between queries of the published topics
BOOL = 'std_msgs/msg/Bool'
STATES = ('emergency_stop_active', 'motors_enabled')  # of motor_driver, not in TOPICS
WITH_MANY_WHEELS = 'tire_samples', 'tire_friction'  # topics that several wheels share

OnSample = Callable[[str, Sample], None]
OnStatus = Callable[[NodeStatus], None]
OnMessage = Callable[[str, bytes], None]  # fully qualified topic, message in CDR


@dataclass(frozen=True, kw_only=True)
class ListenerParams:
    """No ROS parameters."""


class Listener(SmartTireNode[ListenerParams]):
    """
    Calls ``on_sample`` with the standard topic name and each sample, ``on_status`` per status.

    Subscribes to ``topics``, by default all of ``TOPICS``, and to ``/diagnostics``; publishes
    ``/diagnostics``. ``inputs`` counts the messages of each topic. No parameters.
    """

    def __init__(self, on_sample: OnSample, on_status: OnStatus, *,
                 topics: Iterable[str] = tuple(TOPICS), name: str = 'listener') -> None:
        super().__init__(name, ListenerParams)
        self._on_status = on_status
        for topic in topics:
            self.subscribe(topic, partial(on_sample, topic),
                           wheels=len(WHEELS) if topic in WITH_MANY_WHEELS else 1)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics,
                                 subscriber_qos('/diagnostics'))

    def _on_diagnostics(self, msg: Any) -> None:
        for status in statuses_from_msg(msg):
            self._on_status(status)


class Observer(Listener):
    """
    Calls ``on_message`` for each message of the standard topics of all robots.

    Subscribes to the topics of ``TOPICS`` and ``STATES`` in all namespaces, with profiles that
    match their publishers, as they appear, and to ``/diagnostics``; publishes ``/diagnostics``.
    No parameters.
    """

    def __init__(self, on_message: OnMessage, on_status: OnStatus, *,
                 name: str = 'observer') -> None:
        super().__init__(lambda *_: None, on_status, topics=(), name=name)
        self._on_message = on_message
        self._observed: dict[str, tuple[QoSProfile, Any]] = {}

    def start(self) -> None:
        """Subscribe to the topics that exist, and look for new ones."""
        self._discover()
        self.create_steady_timer(DISCOVERY_PERIOD, self._discover)

    def _discover(self) -> None:
        for name, types in self.get_topic_names_and_types():
            topic = find_topic(name)
            expected = topic.type if topic else BOOL if state_of(name) else ''
            if types == [expected]:
                self._observe(name, expected)

    def _observe(self, name: str, type_name: str) -> None:
        offers = [info.qos_profile for info in self.get_publishers_info_by_topic(name)]
        if not offers:
            return
        requested = matching_qos(name, offers)
        if name in self._observed:
            profile, subscription = self._observed[name]
            if not requests_less(requested, profile):
                return
            self.destroy_subscription(subscription)
        self._observed[name] = requested, self.create_subscription(
            message_class(type_name), name, partial(self._on_message, name), requested, raw=True)


def state_of(name: str) -> str:
    """Return which of ``STATES`` a topic is, in any namespace; '' if none."""
    last = name.rpartition('/')[2]
    return last if last in STATES else ''
