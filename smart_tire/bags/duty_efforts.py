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

"""Recordings from before ``wheel_states.effort`` was a torque: it was the duty of the motors."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
import math

from smart_tire.samples import Four, MotorCommand, Sample, WheelSample

MAX_DUTY = 1.0
DUTY_TOLERANCE = 1e-3   # -, a board rounds a duty to 3e-5; torques agree by chance only
RECENT_COMMANDS = 8     # of which one caused the effort
SAMPLES_TO_DECIDE = 50  # wheel samples with an effort
MIN_SAMPLES = 5
MIN_AGREEING = 0.8      # of the wheel samples; the driver limits some commands, e.g. in a stop


def efforts_are_duties(samples: Iterable[Sample]) -> bool:
    """
    Return whether the efforts of wheel samples are duties, by ``motor_commands``.

    They are if no effort exceeds 1 and they agree with the latest commands. ``samples`` are both,
    in order of reception; no more are read than are needed.
    """
    commands: deque[Four] = deque(maxlen=RECENT_COMMANDS)
    agreeing = count = 0
    for sample in samples:
        if isinstance(sample, MotorCommand):
            commands.append(sample.duty)
        elif isinstance(sample, WheelSample) and sample.effort and any(sample.effort):
            if any(math.isnan(one) or abs(one) > MAX_DUTY for one in sample.effort):
                return False
            count += 1
            agreeing += any(_agree(sample.effort, duty) for duty in commands)
            if count == SAMPLES_TO_DECIDE:
                break
    return count >= MIN_SAMPLES and agreeing >= MIN_AGREEING * count


def _agree(effort: Four, duty: Four) -> bool:
    return all(abs(one - other) < DUTY_TOLERANCE for one, other in zip(effort, duty))
