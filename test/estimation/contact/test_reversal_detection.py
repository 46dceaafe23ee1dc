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

"""Reversals of a wheel; vibration is not one."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.contact.reversal_detection import ReversalDetector


def test_a_reversal_is_detected_and_vibration_is_not():
    detector = ReversalDetector(0.003)
    time = np.arange(0.0, 4.0, 0.008)
    distance = np.where(time < 2.0, 0.2 * time, 0.8 - 0.2 * time)
    distance = distance + 0.001 * np.sin(40.0 * time)
    reversals = detector.advance((time * 1e9).astype(np.int64), distance)
    assert len(reversals) == 1
    assert reversals[0][0] == pytest.approx(2e9, abs=3e7)
    assert detector.direction == -1
