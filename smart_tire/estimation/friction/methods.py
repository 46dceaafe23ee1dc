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
