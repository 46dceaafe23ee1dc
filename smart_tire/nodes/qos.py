# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Quality of service of sensor streams, estimates and commands, as listed in docs/topics.md."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rclpy.qos import (
    DurabilityPolicy, qos_check_compatible, QoSCompatibility, QoSProfile, ReliabilityPolicy)

from smart_tire.messages import ALL_TOPICS, find_topic, TOPICS
from smart_tire.samples import WHEELS

if TYPE_CHECKING:
    from smart_tire.bags import Channel

SENSOR_SPAN = 2.0     # s of a sensor stream in the queue of a publisher
RATE_RESERVE = 5      # own subscriptions queue SENSOR_SPAN at this multiple of the nominal rate
ESTIMATE_DEPTH = 250  # messages, 2 s at 125 Hz
COMMAND_DEPTH = 1     # messages: only the latest command is used
IMAGE_DEPTH = 5       # images, of megabytes each: the camera of the overhead localizer
OTHER_DEPTH = 100     # messages: ground truth, overhead camera, diagnostics
MIN_RECORDED_DEPTH = 100  # messages of any topic: all commands count, not only the latest
FOREIGN_DEPTH = 1000  # messages of a topic that is not in TOPICS, or of a burst in a bag
LATCHED = ('path', 'friction_map', 'tf_static')
READ_BY_ESTIMATORS = (
    'imu/data', 'wheel_states', 'tire_samples', 'wheel_slip', 'odom', 'film_charge')
# in which a kept message is received: two periods of the heartbeats of Fast DDS, with which it
# repeats a lost discovery and a lost message, and some reserve


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
    if '/image_raw' in name:
        return _reliable(IMAGE_DEPTH)
    topic = ALL_TOPICS.get(name)
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


def volatile_qos(name: str) -> QoSProfile:
    """Return the profile of a subscription that also serves publishers that keep nothing."""
    profile = subscriber_qos(name)
    profile.durability = DurabilityPolicy.VOLATILE
    return profile


def replayer_qos(published: str, channel: Channel, messages: int, rate: float) -> QoSProfile:
    """
    Return the profile to replay a topic of ``messages`` as ``published``.

    Its queue is sized for ``rate``, a multiple of the recorded one, and for bursts in the bag.
    """
    ours = find_topic(published)
    if 'transient_local' in channel.qos:
        profile = latched()
        profile.depth = min(max(1, messages), FOREIGN_DEPTH)
        return profile
    profile = (publisher_qos(channel.topic) if ours is None else
               publisher_qos(ours.name, rate=max(1.0, rate) * ours.rate, wheels=len(WHEELS)))
    profile.depth = max(profile.depth, FOREIGN_DEPTH)
    return profile


def matches(offered: QoSProfile, requested: QoSProfile) -> bool:
    """Return whether a publisher and a subscription with these profiles are compatible."""
    verdict, _ = qos_check_compatible(offered, requested)
    return bool(verdict != QoSCompatibility.ERROR)


def matching_qos(name: str, offers: list[QoSProfile]) -> QoSProfile:
    """Return the strictest profile of a subscription that matches all publishers' ``offers``."""
    topic = find_topic(name)
    profile = (QoSProfile(depth=FOREIGN_DEPTH) if topic is None
               else subscriber_qos(topic.name, wheels=len(WHEELS)))
    profile.depth = max(profile.depth, MIN_RECORDED_DEPTH)
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = all(offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers)
    profile.reliability = (
        ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT)
    profile.durability = (
        DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE)
    return profile


def requests_less(new: QoSProfile, old: QoSProfile) -> bool:
    """Return whether ``new`` matches publishers that ``old`` does not."""
    return (old.reliability == ReliabilityPolicy.RELIABLE != new.reliability
            or old.durability == DurabilityPolicy.TRANSIENT_LOCAL != new.durability)
