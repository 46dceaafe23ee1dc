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

"""Methods by the value of the parameter ``method``."""

from __future__ import annotations

from smart_tire.errors import EstimatorError
from smart_tire.estimation.friction.crossing_method import CrossingMethod
from smart_tire.estimation.friction.two_peak_method import TwoPeakMethod
from smart_tire.estimation.friction.waveform_method import WaveformMethod
from smart_tire.parameters import FrictionEstimatorParams


def make_method(wheel: str, params: FrictionEstimatorParams) -> CrossingMethod:
    """Return the method that ``params`` select, for the films of ``wheel``."""
    if params.method == 'waveform':
        return WaveformMethod(wheel, params.robot)
    if params.method == 'two_peaks':
        return TwoPeakMethod(wheel, params.robot, params.map)
    raise EstimatorError(f'method is {params.method!r}, expected waveform or two_peaks')
