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
