# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A short recording of a robot, in memory and as a bag."""

from __future__ import annotations

from pathlib import Path

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from smart_tire.bags import BagWriter
from smart_tire.bags.cdr import empty, Encoder, typestore
from smart_tire.messages import ALL_TOPICS, TYPED
from smart_tire.samples import (
    ImuSample, NS_PER_S, Odometry, TireSample, TireSamples, WheelSample)

START_NS = 1_700_000_000 * NS_PER_S
BATCH = 16  # tire samples per radio batch


def stream(seconds=2.0, wheels=('front_left', 'front_right')):
    """Return (receive_ns, topic, sample) of a run in order of reception."""
    events = []
    for k in range(round(seconds * 100)):
        stamp = START_NS + k * 10_000_000
        events.append((stamp + 1_000_000, 'imu/data',
                       ImuSample(stamp, (0.01 * k, 0.0, 9.81), (0.0, 0.0, -0.001 * k))))
    for k in range(round(seconds * 16)):
        stamp = START_NS + k * 62_500_000
        events.append((stamp + 2_000_000, 'wheel_states', WheelSample(
            stamp, (1.0, 2.0, 3.0, 4.0), (k * 1.0, k * 2.0, k * 3.0, k * 4.0),
            (0.1, 0.2, 0.3, 0.4))))
    for k in range(round(seconds * 400)):
        stamp = START_NS + k * 2_500_000
        batch_ns = START_NS + (k // BATCH + 1) * BATCH * 2_500_000
        events += [(batch_ns + 5_000_000 + k % BATCH, 'tire_samples',
                    TireSample(stamp, wheel, (1.65 + 0.001 * k, 1.65 - 0.001 * k)))
                   for wheel in wheels]
    for k in range(round(seconds * 125)):
        stamp = START_NS + k * 8_000_000
        events.append((stamp + 30_000_000, 'odom', Odometry(
            stamp, (0.01 * k, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.5, 0.0, 0.0), (0.0,) * 3,
            (0.01,) * 36, (0.02,) * 36)))
    events.sort(key=lambda event: event[0])
    return events


def typed(events):
    """
    Return ``events`` as messages of smart_tire_msgs where there are some.

    The samples of a radio batch are received at once, and get equal intervals.
    """
    found, batches = [], {}
    for receive_ns, name, sample in events:
        if name == 'tire_samples':
            batches.setdefault((receive_ns // BATCH, sample.wheel), []).append(sample)
        else:
            found.append((receive_ns, TYPED[name].name if name in TYPED else name, sample))
    for (received, wheel), samples in batches.items():
        span_ns = samples[-1].stamp_ns - samples[0].stamp_ns
        found.append((received * BATCH, TYPED['tire_samples'].name, TireSamples(
            samples[0].stamp_ns, wheel, span_ns // (len(samples) - 1),
            tuple(sample.volts for sample in samples), saturated=False)))
    return sorted(found, key=lambda event: event[0])


def standard(events):
    """Return the events of ``typed`` as samples of the standard topics."""
    return [(receive_ns, name.removesuffix('/typed'), one) for receive_ns, name, sample in events
            for one in (sample.samples if isinstance(sample, TireSamples) else [sample])]


def write_bag(path: Path, events) -> Path:
    """Write ``events`` into a bag; return its path."""
    with BagWriter(path) as writer:
        for event in events:
            writer.write_sample(event[1], event[0], event[2])
    return path


def write_with_rosbags(path, events, version=9, plugin=StoragePlugin.SQLITE3,
                       mode=CompressionMode.NONE):
    """Write ``events`` as rosbags does and return the folder."""
    writer = Writer(path, version=version, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections, encoders = {}, {}
        for receive_ns, name, sample in events:
            topic = ALL_TOPICS[name]
            if name not in connections:
                connections[name] = writer.add_connection(
                    '/' + name, topic.type, typestore=typestore())
                encoders[name] = Encoder(topic.type)
            data = encoders[name](topic.to_msg(empty(topic.type), sample))
            writer.write(connections[name], receive_ns, data)
    return path
