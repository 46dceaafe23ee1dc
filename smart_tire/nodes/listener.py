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

"""A node that passes the samples of chosen topics, and all diagnostics, to its owner."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray

from smart_tire.messages import NodeStatus, statuses_from_msg, TOPICS
from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.qos import subscriber_qos
from smart_tire.samples import Sample, WHEELS

__all__ = ['Listener', 'ListenerParams', 'NodeStatus', 'OnSample', 'OnStatus']

WITH_MANY_WHEELS = 'tire_samples', 'tire_friction'  # topics that several wheels share


@dataclass(frozen=True, kw_only=True)
class ListenerParams:
    """No ROS parameters."""


OnSample = Callable[[str, Sample], None]
OnStatus = Callable[[NodeStatus], None]


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
            self.subscribe(topic, self._handler(topic, on_sample),
                           wheels=len(WHEELS) if topic in WITH_MANY_WHEELS else 1)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics,
                                 subscriber_qos('/diagnostics'))

    @staticmethod
    def _handler(topic: str, on_sample: OnSample) -> Callable[[Sample], None]:
        return lambda sample: on_sample(topic, sample)

    def _on_diagnostics(self, msg: Any) -> None:
        for status in statuses_from_msg(msg):
            self._on_status(status)
