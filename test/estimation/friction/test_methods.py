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

"""Choice of the method by its parameter."""

from __future__ import annotations

import pytest

from smart_tire.estimation.friction.methods import make_method
from smart_tire.estimation.friction.two_peak_method import TwoPeakMethod
from smart_tire.estimation.friction.waveform_method import WaveformMethod
from smart_tire.parameters import build, FrictionEstimatorParams


@pytest.mark.parametrize(('name', 'kind'), [
    ('waveform', WaveformMethod), ('two_peaks', TwoPeakMethod)])
def test_the_parameter_selects_the_method(name, kind):
    params = build(FrictionEstimatorParams, {'method': name})
    assert isinstance(make_method('front_right', params), kind)
