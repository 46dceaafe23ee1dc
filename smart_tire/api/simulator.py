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

"""Recordings of the simulated robot."""

from __future__ import annotations

import math

import numpy as np

from smart_tire.analysis.pipeline import INPUTS
from smart_tire.api.params import Params
from smart_tire.api.recording import Recording, RecordingBuilder
from smart_tire.arrays import ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.simulation import offline


def simulate(speeds: ArrayLike, duration: float, *, params: Params | None = None,
             seed: int | None = None, wheel_rate: float = 16.0, torque: bool = True) -> Recording:
    """
    Return the recording of a simulated drive, with ground truth, faster than real time.

    ``speeds`` (n, 3) are the set points of the wheel speeds: rows of start time [s], left and
    right [rad/s]; the wheels are at rest before the first one. ``duration`` is in s.
    ``wheel_rate`` [Hz] is the rate of the wheel readings, which contain motor torques if
    ``torque``. Surfaces, sensor errors and the radio link are those of ``params``
    (``config/simulation.yaml``); the same ``seed``, by default that of ``params``, gives the same
    recording. Raises ParameterError for arguments out of range.
    """
    params = params or Params()
    if seed is not None:
        params = params.with_seed(seed)
    for name, value in (('duration', duration), ('wheel_rate', wheel_rate)):
        if not 0.0 < value < math.inf:
            raise ParameterError(f'{name} is {value}, expected a positive number')
    builder = RecordingBuilder()
    for receive_ns, topic, sample in offline.simulate(
            params.simulator, _phases(speeds), duration, wheel_rate=wheel_rate, torque=torque):
        if topic in INPUTS:
            builder.add(receive_ns, sample)
        else:
            builder.add_truth(sample)
    return builder.recording(params)


def _phases(speeds: ArrayLike) -> list[tuple[float, float, float]]:
    """Return (start time [s], left [rpm], right [rpm]) of each row of ``speeds``."""
    rows = np.array(speeds, dtype=float)
    if rows.ndim != 2 or rows.shape[1] != 3 or not np.isfinite(rows).all():
        raise ParameterError(f'speeds has shape {rows.shape}, expected finite numbers (n, 3): '
                             'start time [s], left and right [rad/s]')
    rows[:, 1:] /= offline.RAD_PER_S_PER_RPM
    return [(start, left, right) for start, left, right in rows.tolist()]
