# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
JointStates of one topic to wheel samples, each completed by the messages before it.

Many drivers send angles only, or zeros as velocities with them; joints that turn without end
may have angles that wrap; simulators send at 1 kHz. A velocity that is missing, or zero although
the wheel turns, is the difference of two angles over their time. Wrapped angles are continued.
Of messages in quick succession the mean is taken.
"""

from __future__ import annotations

from collections import Counter
import math
from typing import Any

import numpy as np

from smart_tire.arrays import Array
from smart_tire.errors import MessageError
from smart_tire.messages.header import bounded, finite, names_of, stamp_of
from smart_tire.messages.joint_names import wheel_layout
from smart_tire.messages.joint_state import measured_angles, torques, wheel_values
from smart_tire.parameters.robot import JointParams, STANDARD_JOINTS
from smart_tire.samples import Four, four, MAX_WHEEL_SPEED, NS_PER_S, WheelSample

LEAST_PERIOD_NS = 200_000      # 5 kHz; if all are shorter, stamps are of another unit
MERGED_PERIOD_NS = 9_000_000   # messages that follow each other faster are merged ...
MIN_PERIOD_NS = 16_000_000     # ... to this period; the filter works on a grid of half of it
WRAPS = (math.tau, 360.0)      # ranges of angles, ascending: radians, and degrees by mistake
WRAP_TOLERANCE = 0.15          # of the range: a change of the speed within a period
MIN_TURN = 0.02                # rad per message, of a wheel that turns: six counts of 2000
MAX_STEP_CHANGE = 1.0          # rad per message; a larger change is a reset of the encoder
RESET_FACTOR = 2.0             # of the expected step
TOPIC = 'wheel_states'


class WheelReader:
    """
    Converts the messages of a topic with the wheels ``joints``, in the order of their reception.

    ``completed`` counts what differs from the messages: ``missing_velocity``, ``zero_velocity``,
    ``wrapped``, ``merged``, ``other_length``.
    """

    def __init__(self, joints: JointParams = STANDARD_JOINTS, *, recognize: bool = True) -> None:
        self._joints, self._recognize = joints, recognize
        self.completed: Counter[str] = Counter()
        self._merged: list[tuple[int, Four | None, Four]] = []  # gaps, velocities, torques
        self._heard_ns: int | None = None    # newest timestamp
        self._gap_ns = 0                     # from the message before to the newest
        self._last: tuple[int, Array] | None = None  # timestamp and angles of the sample before
        self._step = np.zeros(4)             # rad, latest
        self._rate = np.zeros(4)             # rad/s, by it
        self._offset = np.zeros(4)           # rad, of wrapped angles

    def __call__(self, msg: Any) -> WheelSample | None:
        """
        Return the sample of a message; None if it is merged, or only begins a difference.

        Raises as ``wheels_from_msg`` does, but not for a velocity that the angles replace.
        """
        layout = wheel_layout(names_of(msg, TOPIC), self._joints, TOPIC,
                              recognize=self._recognize)
        stamp_ns, lengths = stamp_of(msg), (0, len(msg.name))
        angles = measured_angles(msg, layout, TOPIC) if len(msg.position) in lengths else None
        effort = torques(msg, layout, TOPIC) if len(msg.effort) in lengths else None
        self.completed['other_length'] += not (
            len(msg.position) in lengths and len(msg.effort) in lengths)
        velocity: Four | None = None
        if angles is None or len(msg.velocity):
            velocity = wheel_values(msg, 'velocity', layout.signs, layout, TOPIC)
            known = [speed for speed, index in zip(velocity, layout.indices) if index is not None]
            if angles is not None and any(map(math.isnan, known)):
                velocity = None
            else:
                finite(TOPIC, 'velocity', known)
                bounded(TOPIC, 'velocity', velocity, MAX_WHEEL_SPEED, 'rad/s')
        return self._add(stamp_ns, velocity, angles, effort)

    def _add(self, stamp_ns: int, velocity: Four | None, angles: Four | None,
             effort: Four | None) -> WheelSample | None:
        gap_ns = 0 if self._heard_ns is None else stamp_ns - self._heard_ns
        quick = (0 < gap_ns < MERGED_PERIOD_NS and max(gap_ns, self._gap_ns) > LEAST_PERIOD_NS
                 and self._last is not None and 0 < stamp_ns - self._last[0] < MIN_PERIOD_NS)
        self._heard_ns, self._gap_ns = stamp_ns, gap_ns
        row = gap_ns, velocity, (math.nan,) * 4 if effort is None else effort
        if quick:
            self._merged.append(row)
            self.completed['merged'] += 1
            return None
        if self._merged:
            gaps, speeds, torques_of = zip(*self._merged, row)
            self._merged = []
            # over time: a message that is repeated a little later adds nothing
            if gap_ns > 0 and all(one is not None for one in speeds):
                velocity = four(np.average(speeds, 0, gaps).tolist())
            if gap_ns > 0 and effort is not None:
                effort = four(np.average(torques_of, 0, gaps).tolist())
        before, self._last = self._last, (
            stamp_ns, np.full(4, math.nan) if angles is None else np.array(angles))
        if angles is not None:
            velocity, angles = self._completed(before, self._last, velocity)
            if velocity is None:
                return None
        assert velocity is not None
        return WheelSample(stamp_ns, velocity, angles, effort)

    def _completed(self, before: tuple[int, Array] | None, now: tuple[int, Array],
                   velocity: Four | None) -> tuple[Four | None, Four]:
        """Return the velocity, None if it is unknown, and the angles without wraps."""
        (stamp_ns, angles), speeds = now, velocity
        gap = 0.0 if before is None else (stamp_ns - before[0]) / NS_PER_S
        if before is None or not gap > 0.0:
            if velocity is None and before is not None:
                raise MessageError(f'{TOPIC}: no velocity, and no time since the angles before')
        else:
            expected = gap * (self._rate if velocity is None else np.array(velocity))
            step = self._continued(before[1], angles, expected)
            if velocity is None:
                self.completed['missing_velocity'] += 1
                reset = np.abs(step - expected) > math.tau + RESET_FACTOR * np.abs(expected)
                step = np.where(reset, expected, step)
            elif 0.0 in velocity:
                idle = (np.array(velocity) == 0.0) & (np.abs(step) > MIN_TURN) & (
                    np.abs(step - self._step) < MAX_STEP_CHANGE) & (self._step != 0.0)
                if idle.any():
                    self.completed['zero_velocity'] += 1
                    speeds = None
            self._step, self._rate = step, step / gap
            if speeds is None:
                speeds = four((step / gap).tolist())
                bounded(TOPIC, 'velocity', speeds, MAX_WHEEL_SPEED, 'rad/s, by the angles')
        return speeds, four((angles + self._offset).tolist())

    def _continued(self, before: Array, now: Array, expected: Array) -> Array:
        """Return the steps [rad] of the angles, those over the end of their range mended."""
        step = now - before
        if np.abs(expected - step).max() < 0.5 * WRAPS[0]:  # most samples
            return step
        for full in WRAPS:
            turns = np.rint((expected - step) / full)
            inside = np.maximum(np.abs(before), np.abs(now)) <= (1.0 + WRAP_TOLERANCE) * full
            wrapped = inside & (np.abs(turns) == 1.0) & (step * expected <= 0.0) & (
                np.abs(step + turns * full - expected) < WRAP_TOLERANCE * full)
            if wrapped.any():
                self.completed['wrapped'] += 1
                shift = np.where(wrapped, turns * full, 0.0)
                self._offset, step = self._offset + shift, step + shift
        return step
