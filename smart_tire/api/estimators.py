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

"""The estimators applied to recordings: the same numbers as live, replayed and ``analyze``."""

from __future__ import annotations

from smart_tire.analysis.pipeline import Pipeline
from smart_tire.api.collecting import Collector
from smart_tire.api.params import Params
from smart_tire.api.recording import Recording
from smart_tire.api.results import Estimates, FrictionEstimate, SlipEstimate


def estimate(recording: Recording, params: Params | None = None) -> Estimates:
    """
    Return all estimates of ``recording``: pose, slip, center of rotation, ground and friction.

    ``params`` describe the robot; by default they are those of the recording, or the robot of
    paper B if it has none. The estimates equal those of
    ``smart_tire analyze``. Estimates whose inputs are missing are empty. All arrays have one row
    per timestamp, ``stamp_ns`` (n,) [ns]; units and shapes are given in the classes.
    """
    pipeline = Pipeline((params or recording.params or Params()).estimators)
    collector = Collector()
    for item in recording.received():
        for one in pipeline.update(item.sample):
            collector.add(one)
    for one in pipeline.finish():
        collector.add(one)
    return collector.estimates()


def estimate_slip(recording: Recording, params: Params | None = None) -> SlipEstimate:
    """
    Return the slip of the four wheels at 125 Hz.

    ``stamp_ns`` (n,) [ns], ``ratio`` and ``sigma`` (n, 4) [-], ``velocity`` (n, 4) [m/s]; wheels
    in the order front left, front right, rear left, rear right. Requires IMU and wheels.
    ``estimate`` returns everything in one run.
    """
    return estimate(recording, params).slip


def estimate_friction(recording: Recording, params: Params | None = None) -> FrictionEstimate:
    """
    Return the friction coefficient and 12 more quantities of each patch crossing.

    ``stamp_ns`` (n,) [ns], ``wheel`` (n,), and per quantity ``value`` and ``sigma`` (n,), NaN and
    infinite if not observable: ``friction_coefficient.value`` [-], ``normal_load.sigma`` [N].
    Requires IMU, wheels and films of ``film.wheels``. ``estimate`` returns everything in one run.
    """
    return estimate(recording, params).friction
