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

"""Motor torques of wheel samples: removed, or those of wrong torque constants."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
import math

from smart_tire.samples import Sample, WheelSample
from smart_tire.simulation.offline import Event


def has_efforts(samples: Iterable[Sample]) -> bool:
    """Return whether any torque was measured."""
    return any(isinstance(sample, WheelSample) and sample.effort is not None
               and any(map(math.isfinite, sample.effort)) for sample in samples)


def without_efforts(samples: Iterable[Sample]) -> list[Sample]:
    """Return ``samples`` without torques."""
    return [replace(sample, effort=None) if isinstance(sample, WheelSample) else sample
            for sample in samples]


def scaled_efforts(events: Iterable[Event], factor: float) -> list[Event]:
    """Return ``events`` with all torques multiplied by ``factor``."""
    return [(received_ns, topic, _scaled(sample, factor))
            for received_ns, topic, sample in events]


def _scaled(sample: Sample, factor: float) -> Sample:
    if not isinstance(sample, WheelSample) or sample.effort is None:
        return sample
    fl, fr, rl, rr = (factor * torque for torque in sample.effort)
    return replace(sample, effort=(fl, fr, rl, rr))
