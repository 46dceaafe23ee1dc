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

"""
Quality of service of sensor streams, estimates and commands, as listed in docs/topics.md.

``python -m smart_tire.nodes.qos FILE`` writes the profiles as a file for ``ros2 bag record``; a
test checks that the one in ``config/`` is current.
"""

from __future__ import annotations

from collections.abc import Iterator
import math
from pathlib import Path
import sys

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from smart_tire.messages import TOPICS
from smart_tire.samples import WHEELS

SENSOR_SPAN = 2.0     # s of a sensor stream in the queue of a publisher
RATE_RESERVE = 5      # own subscriptions queue SENSOR_SPAN at this multiple of the nominal rate
ESTIMATE_DEPTH = 250  # messages, 2 s at 125 Hz
COMMAND_DEPTH = 1     # messages: only the latest command is used
OTHER_DEPTH = 100     # messages: ground truth, overhead camera, diagnostics
LATCHED = ('path', 'friction_map', 'tf_static')
READ_BY_ESTIMATORS = ('imu/data', 'wheel_states', 'tire_samples', 'wheel_slip', 'odom')


def _reliable(depth: int) -> QoSProfile:
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.VOLATILE)


def latched() -> QoSProfile:
    """Return the profile of topics whose latest message late subscribers need, too."""
    return QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.TRANSIENT_LOCAL)


def publisher_qos(name: str, *, rate: float = 0.0, wheels: int = 1) -> QoSProfile:
    """
    Return the profile with which this package publishes on the topic ``name``.

    ``rate`` [Hz] is used if it exceeds the nominal one; ``wheels`` is the number of sources that
    share the topic.
    """
    if name.strip('/') in LATCHED:
        return latched()
    topic = TOPICS.get(name)
    if topic is None or topic.quality == 'truth':
        return _reliable(OTHER_DEPTH)
    if topic.quality == 'command':
        return _reliable(COMMAND_DEPTH)
    if topic.quality == 'estimate':
        return _reliable(ESTIMATE_DEPTH)
    return _reliable(math.ceil(SENSOR_SPAN * max(rate, topic.rate) * max(wheels, 1)))


def subscriber_qos(name: str, *, wheels: int = 1, reliability: str = 'reliable') -> QoSProfile:
    """
    Return the profile with which this package, including its recorder, subscribes to ``name``.

    Inputs of estimators have queues of two seconds at five times their rate (``tire_samples``:
    4000 per wheel), since one radio batch overflows the default of 5. ``best_effort`` serves
    publishers of other packages that do not offer reliable delivery.
    """
    if name in READ_BY_ESTIMATORS:
        profile = _reliable(
            math.ceil(SENSOR_SPAN * RATE_RESERVE * TOPICS[name].rate * max(wheels, 1)))
    else:
        profile = publisher_qos(name, wheels=wheels)
    if reliability == 'best_effort':
        profile.reliability = ReliabilityPolicy.BEST_EFFORT
    return profile


def latest_qos(name: str) -> QoSProfile:
    """Return the profile of a subscription that needs the latest message only."""
    profile = subscriber_qos(name)
    profile.depth = 1
    return profile


def order_profiles(name: str) -> list[QoSProfile]:
    """
    Return the profiles of two subscriptions to the order ``name``, such as ``path``.

    One receives what was published before, the other also serves publishers that keep nothing.
    """
    volatile = subscriber_qos(name)
    volatile.durability = DurabilityPolicy.VOLATILE
    return [latched(), volatile]


def rosbag2_overrides() -> str:
    """
    Return the file for ``ros2 bag record --qos-profile-overrides-path``.

    Transient-local topics are left out: rosbag2 adapts to their durability itself.
    """
    return '\n'.join((*OVERRIDES_HEADER, *_overrides())) + '\n'


OVERRIDES_HEADER = (
    '# For "ros2 bag record --qos-profile-overrides-path FILE": queues deep enough to lose no',
    '# message while the disk is busy; the default of rosbag2 is 10 messages per topic.',
    '# For a robot in a namespace, prefix each topic with it. For a publisher that offers best',
    '# effort only, change the reliability: a reliable subscription does not connect to it.',
    '# The depths are those of smart_tire/nodes/qos.py; "make config" writes this file.')


def _overrides() -> Iterator[str]:
    for name in (*(name for name in TOPICS if name not in LATCHED), 'tf', 'diagnostics'):
        profile = subscriber_qos(name, wheels=len(WHEELS))
        yield from (
            f'/{name}:', '  history: keep_last', f'  depth: {max(profile.depth, OTHER_DEPTH)}',
            f'  reliability: {profile.reliability.short_key}',
            f'  durability: {profile.durability.short_key}')


if __name__ == '__main__':
    Path(sys.argv[1]).write_text(rosbag2_overrides(), encoding='utf-8')
