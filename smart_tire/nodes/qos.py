"""
Quality of service: what INTERFACES calls reliable streams, estimates and commands.

``python -m smart_tire.nodes.qos FILE`` writes the same as a file for ``ros2 bag record``; a test
compares.
"""

from __future__ import annotations

from collections.abc import Iterator
import math
from pathlib import Path
import sys

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from smart_tire.messages import TOPICS
from smart_tire.samples import WHEELS

SENSOR_SPAN = 2.0     # s of a sensor stream that a publisher keeps for slow readers
RESERVE = 5           # own subscribers keep SENSOR_SPAN at this multiple of the nominal rate
ESTIMATE_DEPTH = 250  # 2 s at 125 Hz
COMMAND_DEPTH = 1     # only the newest command counts
OTHER_DEPTH = 100     # ground truth, overhead camera, diagnostics
LATCHED = ('path', 'friction_map', 'tf_static')
READ_BY_ESTIMATORS = ('imu/data', 'wheel_states', 'tire_samples', 'wheel_slip', 'odom')


def _reliable(depth: int) -> QoSProfile:
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.VOLATILE)


def latched() -> QoSProfile:
    """Return the profile of what a late subscriber must still get."""
    return QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                      durability=DurabilityPolicy.TRANSIENT_LOCAL)


def publisher_qos(name: str, *, rate: float = 0.0, wheels: int = 1) -> QoSProfile:
    """
    Return the profile with which this package publishes on the topic ``name``.

    ``rate`` [Hz] counts where it is above the nominal one; ``wheels`` is the number of sources
    that share the topic.
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
    Return the profile with which this package, its recorder too, listens to ``name``.

    What is estimated from is kept two seconds at five times its rate (``tire_samples``: 4000 per
    wheel), for one batch alone overruns the default of 5. ``best_effort`` is for publishers that
    are not ours and offer no more.
    """
    if name in READ_BY_ESTIMATORS:
        profile = _reliable(
            math.ceil(SENSOR_SPAN * RESERVE * TOPICS[name].rate * max(wheels, 1)))
    else:
        profile = publisher_qos(name, wheels=wheels)
    if reliability == 'best_effort':
        profile.reliability = ReliabilityPolicy.BEST_EFFORT
    return profile


def rosbag2_overrides() -> str:
    """
    Return the file for ``ros2 bag record --qos-profile-overrides-path``.

    Topics that latch are left out: rosbag2 adapts to their durability by itself.
    """
    return '\n'.join((*OVERRIDES_HEADER, *_overrides())) + '\n'


OVERRIDES_HEADER = (
    '# For "ros2 bag record --qos-profile-overrides-path FILE": queues deep enough that a busy',
    '# disk costs no message; rosbag2 keeps 10 messages of a topic by default.',
    '# In a namespace, put it in front of each name. Where a publisher offers best effort only,',
    '# change the reliability: a reliable subscription does not connect to it.',
    '# Depths come from smart_tire/nodes/qos.py; "make config" writes this file.')


def _overrides() -> Iterator[str]:
    for name in (*TOPICS, 'tf', 'diagnostics'):
        profile = subscriber_qos(name, wheels=len(WHEELS))
        yield from (
            f'/{name}:', '  history: keep_last', f'  depth: {max(profile.depth, OTHER_DEPTH)}',
            f'  reliability: {profile.reliability.short_key}',
            f'  durability: {profile.durability.short_key}')


if __name__ == '__main__':
    Path(sys.argv[1]).write_text(rosbag2_overrides(), encoding='utf-8')
