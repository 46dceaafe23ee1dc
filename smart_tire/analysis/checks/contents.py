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

"""Checks of what a recording contains: topics, types, frames, rejected messages, films."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from smart_tire.analysis.checks.recording import CheckedRecording
from smart_tire.estimation.streams import INPUTS
from smart_tire.findings import Finding, Level
from smart_tire.messages import TOPICS

NEEDED_FOR = {'imu/data': 'odom and wheel_slip', 'wheel_states': 'all estimates',
              'tire_samples': 'tire_friction'}
MAX_REJECTED_SHARE = 0.01  # of the messages of a topic; above, it is an error


def check_topics(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield missing inputs; with films expected, missing films are a warning."""
    for name in INPUTS:
        if recording.of(name) or recording.faults.rejected[name]:
            continue
        films = name == 'tire_samples'
        if films and not recording.robot.film.wheels:
            continue
        yield Finding(
            Level.WARNING if films else Level.ERROR, name, 'no messages',
            f'{TOPICS[name].type} for {NEEDED_FOR[name]}',
            'start its driver' if recording.live else 'record this topic')


def check_problems(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield damage of the bag and topics of another type."""
    for text in recording.problems:
        yield Finding(Level.WARNING, 'bag', text)


def check_rejected(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield topics with invalid messages, and the first reason."""
    for topic, count in recording.faults.rejected.items():
        good = sum(len(stream.stamp_ns) for stream in recording.of(topic))
        level = Level.ERROR if count > MAX_REJECTED_SHARE * (good + count) else Level.WARNING
        yield Finding(level, topic, f'{count} of {good + count} messages are invalid, the first: '
                      f'{recording.faults.reasons[topic].removeprefix(f"{topic}: ")}',
                      action='correct the publisher of this topic')


def check_frames(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield unexpected frames; those of imu/data matter if TF is used, others are ignored."""
    for topic, frames in sorted(recording.faults.frames.items()):
        expected = TOPICS[topic].frame
        for frame, count in frames.items():
            if expected and frame.rpartition('/')[2] != expected:
                yield Finding(
                    Level.INFO, topic, f'header.frame_id is {frame!r} in {count} messages',
                    repr(expected), 'not used by the estimators: imu.position and imu.rotation '
                    'describe the mounting' if topic == 'imu/data' else '')


def check_film_wheels(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield configured wheels without samples, samples of other wheels, other film counts."""
    streams, film = recording.of('tire_samples'), recording.robot.film
    if not streams:
        return
    found = [stream.wheel for stream in streams]
    for wheel in film.wheels:
        if wheel not in found:
            yield Finding(Level.WARNING, f'tire_samples of {wheel}', 'no samples',
                          f'film.wheels lists {wheel}',
                          'check the sensor node, units of tire_receiver and film.wheels')
    for stream in streams:
        if stream.wheel not in film.wheels:
            yield Finding(Level.WARNING, stream.name, 'samples are not used',
                          f'film.wheels is {list(film.wheels)}', f'add {stream.wheel} to '
                          'film.wheels')
        elif stream.values.shape[1] != film.count:
            yield Finding(Level.ERROR, stream.name, f'{stream.values.shape[1]} films',
                          f'{film.count} by film.positions or film.spacing',
                          'correct film.positions')


def check_torques(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield that no torques were recorded: the slip estimate is then less accurate."""
    wheels = recording.wheels
    if wheels is not None and np.isnan(wheels['effort']).all():
        yield Finding(Level.INFO, 'wheel_states', 'effort contains no motor torques',
                      action='slip is estimated from IMU and wheel speeds only')
    if wheels is not None and np.isnan(wheels['position']).any():
        yield Finding(Level.INFO, 'wheel_states', 'position is missing',
                      action='velocities are integrated; lost messages lose distance')
