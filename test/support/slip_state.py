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

"""States of the slip EKF for tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from smart_tire.estimation.slip.state import N, State, TORQUE_OFFSETS

SIGMAS = {  # of a plausible state; 0 where not listed
    State.X: 1.0, State.Y: 1.0, State.YAW: 1.0, State.ROLL: 0.01, State.PITCH: 0.01,
    State.V_X: 0.8, State.V_Y: 0.1, State.GYRO_BIAS_Z: 0.01, State.ACCEL_BIAS_X: 0.05,
    State.ACCEL_BIAS_Y: 0.05, State.SLIP_VEL_L: 0.1, State.SLIP_VEL_R: 0.1, State.ICR_X: 0.05,
    State.TRAVEL_L: 0.05, State.TRAVEL_R: 0.05, State.FORCE_X: 0.5, State.FORCE_Y: 0.5,
    State.YAW_RATE: 0.8, State.YAW_ACCEL: 2.0, State.LN_STIFFNESS: 0.4, State.LN_RATIO: 0.4,
    State.DRAG: 0.02, State.TORQUE_SCALE: 0.05}


def random_state(seed: int) -> NDArray[np.float64]:
    """Return a state (N,) of plausible magnitude."""
    sigmas = np.zeros(N)
    sigmas[list(SIGMAS)] = list(SIGMAS.values())
    sigmas[TORQUE_OFFSETS] = 0.03
    return np.random.default_rng(seed).normal(0.0, sigmas)
