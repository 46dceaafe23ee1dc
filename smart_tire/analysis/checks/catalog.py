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

"""All checks of a recording, in the order of the report."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from smart_tire.analysis.checks import contents, films, imu, motion, timing, tire, wheels
from smart_tire.analysis.checks.recording import CheckedRecording
from smart_tire.findings import Finding

Check = Callable[[CheckedRecording], Iterable[Finding]]

CHECKS: tuple[Check, ...] = (
    contents.check_problems, contents.check_topics, contents.check_rejected,
    contents.check_frames, contents.check_film_wheels, contents.check_torques,
    timing.check_rates, timing.check_gaps, timing.check_stamps, timing.check_jitter,
    timing.check_delays, timing.check_drift, timing.check_held,
    imu.check_gravity, imu.check_gyro_bias,
    wheels.check_encoders, wheels.check_velocity_unit, wheels.check_torques,
    motion.check_sides, motion.check_yaw_rate, motion.check_radius, motion.check_latency,
    motion.check_imu_position,
    films.check_voltages, films.check_crossings, films.check_order, films.check_battery,
    tire.check_stiffness)


def findings(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield the findings of all checks."""
    for check in CHECKS:
        yield from check(recording)
