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

"""Listener: samples with their topic, invalid messages, diagnostics of all nodes."""

from __future__ import annotations

import pytest
from rclpy.qos import QoSProfile

from smart_tire.messages import TOPICS
from smart_tire.nodes.compat import message_class
from smart_tire.nodes.observer import Listener, NodeStatus
from smart_tire.nodes.runner import NodeRunner
from smart_tire.samples import Icr, Sample

pytestmark = pytest.mark.processes


def test_a_listener_passes_samples_and_diagnostics(isolated_ros):
    samples: list[tuple[str, Sample]] = []
    statuses: dict[str, NodeStatus] = {}

    def new_listener() -> Listener:
        return Listener(lambda *given: samples.append(given),
                        lambda status: statuses.update({status.name: status}),
                        topics=['icr'], name='ear')

    topic = TOPICS['icr']
    with NodeRunner(new_listener, []) as runner:
        publisher = runner.node.create_publisher(
            message_class(topic.type), 'icr', QoSProfile(depth=10))
        for _ in range(100):
            publisher.publish(topic.to_msg(message_class(topic.type)(), Icr(5, 1.0, -2.0)))
            runner.spin(0.1)
            if samples and statuses:
                break
    assert samples[0] == ('icr', Icr(5, 1.0, -2.0))
    assert (statuses['ear'].level, statuses['ear'].message) == (0, 'ok')
    assert int(statuses['ear'].values['frames_ok']) <= len(samples)
