# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Film estimator: charge and temperature of a film to its deflection, with standard deviation.

It starts with a zero: the flat film at rest, whose charge is averaged. ``zero`` does it again at
any time. After some strokes it is worth much more than the first one, since the hysteresis has
then forgotten its unknown beginning.

Charge that heat produces (pyroelectricity) is subtracted, with the temperature that is received.
Without it the temperature moves away at ``temperature_rate``, correlated over ``RATE_TIME``. All
inputs pass one reorder buffer, so live, replayed and recorded data give identical results.
"""

from __future__ import annotations

from collections import Counter, deque
import math
from pathlib import Path

import numpy as np

from smart_tire.arrays import Array
from smart_tire.errors import ParameterError
from smart_tire.estimation.film.branch_filter import BranchFilter, DEAD_BAND, FilmSignal
from smart_tire.estimation.film.calibration import FilmParams, read_params
from smart_tire.estimation.reorder_buffer import ReorderBuffer
from smart_tire.estimation.streams import FILM
from smart_tire.numerics.robust import noise_level
from smart_tire.parameters.film import FilmSensorParams
from smart_tire.samples import FilmCharge, FilmDeflection, FilmTemperature, NS_PER_S
from smart_tire.uncertain import Uncertain, UNKNOWN

# value, unit, meaning; origin
RATE_TIME = 60.0        # s, in which the rate of an unknown temperature changes; assumed
AVERAGED_SHARE = 1 / 16  # of the shortest period of the motion; derived: 0.6 % of an amplitude
MIN_ZERO_SAMPLES = 20   # of a zero; assumed
MAX_REST_NOISE = 3.0    # standard deviation of a film at rest, of the white noise; assumed
MAX_REST_STEP = 5.0     # sigmas between the means of the two halves of a rest; assumed
LEAST_NOISE_SHARE = 0.1  # of the calibrated noise, if the converter shows less; assumed

MEASURING = 'measuring'


class FilmEstimator:
    """Deflection of one film; ``update`` takes the samples of ``FILM.inputs``."""

    def __init__(self, params: FilmSensorParams, film: FilmParams | None = None) -> None:
        if film is None:
            if not params.calibration_file:
                raise ParameterError('calibration_file must be given: "smart_tire identify film" '
                                     'writes it')
            film = read_params(Path(params.calibration_file))
        self._params, self._film = params, film
        self._pyro = (0.0 if film.film is None else
                      params.pyroelectric_coefficient * film.film.length * film.film.width)
        self._operator = film.operator  # ParameterError without an inverse
        # limit of a gap in which a reversal of the motion is possible
        self._max_gap = 0.5 / params.bandwidth
        self._buffer = ReorderBuffer(round(params.reorder_window * NS_PER_S))
        self.zeros = self.gaps = self.saturated = self.discharged = self.restarts = 0
        self._start()

    def _start(self) -> None:
        self.state = 'zeroing: the flat film must be at rest'
        self._filter: BranchFilter | None = None
        self._rest: deque[tuple[int, float]] = deque()
        self._window: deque[Array] = deque()
        self._path: deque[tuple[float, float]] = deque(maxlen=3)  # s and C, latest averages
        self._temperature: FilmTemperature | None = None
        self._last: FilmCharge | None = None  # valid
        self._saturated = self._discharged = self._beyond = False
        self._speed = 0.0  # C/s, largest of the charge
        self._averaged_before: Array | None = None

    @property
    def late(self) -> Counter[str]:
        """Return the samples per topic that arrived after their grid instant had closed."""
        return self._buffer.late

    def update(self, sample: FilmCharge | FilmTemperature) -> list[FilmDeflection]:
        """Add a sample of one of the inputs; return the estimates that it completes."""
        closed = self._buffer.push(FILM.inputs[type(sample)], sample.stamp_ns, sample)
        if self._buffer.resets > self.restarts:
            self.restarts = self._buffer.resets
            self._start()
        return [estimate for _, samples in closed for item in samples
                for estimate in self._add(item)]

    def finish(self) -> list[FilmDeflection]:
        """Return the last estimates, at the end of all inputs."""
        return [estimate for _, samples in self._buffer.finish() for item in samples
                for estimate in self._add(item)]

    def _add(self, sample: FilmCharge | FilmTemperature) -> list[FilmDeflection]:
        if isinstance(sample, FilmTemperature):
            self._temperature = sample
            return []
        if sample.saturated or sample.discharged:
            self.saturated += sample.saturated
            self.discharged += sample.discharged
            self._saturated |= sample.saturated
            self._discharged |= sample.discharged
            self._rest.clear()
            return [FilmDeflection(sample.stamp_ns, UNKNOWN)]
        if self._last is not None and sample.stamp_ns <= self._last.stamp_ns:
            return []
        if self._filter is None:
            self._find_zero(sample)
            return [FilmDeflection(sample.stamp_ns, UNKNOWN)]
        return self._measure(sample)

    def zero(self) -> bool:
        """Take the film as flat now; return whether it is measured at present."""
        if self._filter is None or not self._window or self._saturated or self._discharged:
            return False
        signal = self._averaged()
        self._filter.stop_at(signal, zero=True)
        self._flat_time, self._heat_variance = float(signal[FilmSignal.TIME]), 0.0
        self._beyond = False
        self.zeros += 1
        return True

    def _find_zero(self, sample: FilmCharge) -> None:
        """Begin with the latest ``zero_time`` if the film was at rest."""
        self._saturated = self._discharged = False
        self._last = sample
        rest = self._rest
        rest.append((sample.stamp_ns, sample.charge))
        if (sample.stamp_ns - rest[0][0]) / NS_PER_S < self._params.zero_time:
            return
        stamps, charges = (np.array(values) for values in zip(*rest))
        rest.popleft()
        noise, half = float(np.std(charges, ddof=1)), charges.size // 2
        least = LEAST_NOISE_SHARE * self._film.noise
        step = abs(float(charges[half:].mean() - charges[:half].mean()))
        if (charges.size < MIN_ZERO_SAMPLES
                or noise > MAX_REST_NOISE * max(noise_level(charges), self._film.noise)
                or step > MAX_REST_STEP * 2.0 * max(noise, least) / math.sqrt(charges.size)):
            return
        self._begin(sample, float(charges.mean()), max(noise, least),
                    float(np.median(np.diff(stamps))) / NS_PER_S)

    def _begin(self, sample: FilmCharge, zero: float, noise: float, period: float) -> None:
        film, params = self._film, self._params
        self._level = zero
        self._count = max(1, round(AVERAGED_SHARE / params.bandwidth / period))
        self._filter = BranchFilter(
            film, noise / math.sqrt(self._count), fresh=params.fresh,
            pyro=(self._pyro, params.pyroelectric_tolerance * self._pyro))
        self._zero_ns, self._shift = sample.stamp_ns, 0.0
        self._signal = np.zeros(len(FilmSignal))
        self._zero_temperature = self._temperature.value if self._temperature else math.nan
        self._flat_time = 0.0      # s, of the latest zero
        self._heat_variance = 0.0  # K2, of the change from it to the first temperature
        self.state = MEASURING
        self.zeros += 1

    def _measure(self, sample: FilmCharge) -> list[FilmDeflection]:
        assert self._last is not None and self._filter is not None
        gap = (sample.stamp_ns - self._last.stamp_ns) / NS_PER_S
        before, self._signal = self._signal, self._next_signal(sample, gap)
        if self._discharged or self._saturated or gap > self._max_gap:
            self._pass_gap(before, gap)
        self._last = sample
        self._window.append(self._signal)
        if len(self._window) < self._count:
            return []
        signal = self._averaged()
        self._window.popleft()
        estimate = self._filter.add_signal(signal, math.hypot(
            self._charge_sigma(signal), self._curve_error(signal)))
        self._learn_speed(signal)
        return [FilmDeflection(self._zero_ns + round(float(signal[FilmSignal.TIME]) * NS_PER_S),
                               self._deflection(*estimate))]

    def _averaged(self) -> Array:
        mean: Array = np.mean(self._window, axis=0)
        return mean

    def _next_signal(self, sample: FilmCharge, gap: float) -> Array:
        """Return the signal at a valid sample, ``gap`` [s] after the one before."""
        assert self._last is not None
        signal = self._signal.copy()
        output, last = (item.charge - self._level for item in (sample, self._last))
        signal[FilmSignal.TIME] += gap
        if self._discharged:
            self._shift = output - signal[FilmSignal.CHARGE]
        else:
            signal[FilmSignal.INTEGRAL] += 0.5 * (output + last) * gap
        signal[FilmSignal.CHARGE] = output - self._shift
        if self._temperature is not None:
            if math.isnan(self._zero_temperature):
                self._zero_temperature = self._temperature.value
                self._heat_variance = self._temperature_variance(
                    float(signal[FilmSignal.TIME]) - self._flat_time)
            signal[FilmSignal.TEMPERATURE] = self._temperature.value - self._zero_temperature
        return signal

    def _pass_gap(self, before: Array, gap: float) -> None:
        """Continue after ``gap`` [s] without samples, with what may have happened in it."""
        assert self._filter is not None
        self.gaps += 1
        film = self._film
        moved = min(self._speed * gap, film.max_charge)
        lost = moved / 3.0**0.5 if self._discharged else (
            2.0 * math.pi * film.low_corner * gap * moved / 12.0**0.5)
        path = self._speed / film.b_gain * max(gap - self._max_gap, 0.0)
        noise = self._filter.noise * math.sqrt(self._count)  # of one sample
        self._filter.stop_at(before, mixing=-math.expm1(-film.alpha_gain * path),
                             charge_sigma=math.hypot(lost, noise))
        self._window.clear()
        self._path.clear()
        self._saturated = self._discharged = False
        self._averaged_before = None

    def _curve_error(self, signal: Array) -> float:
        """Return how far [C] the charge bends away from a line between the latest averages."""
        self._path.append((float(signal[FilmSignal.TIME]), float(signal[FilmSignal.CHARGE])))
        if len(self._path) < 3:
            return 0.0
        (begin, first), (middle, charge), (end, last) = self._path
        # C/s; of a parabola, over its sampling
        bend = (last - charge) / (end - middle) - (charge - first) / (middle - begin)
        return abs(bend) * (end - begin) / 16.0

    def _learn_speed(self, signal: Array) -> None:
        """Keep the largest speed [C/s] of the charge, beyond noise."""
        assert self._filter is not None
        if self._averaged_before is None:
            self._averaged_before = signal
        step, time = (signal - self._averaged_before)[[FilmSignal.CHARGE, FilmSignal.TIME]]
        if time >= self._max_gap:
            self._averaged_before = signal
            self._speed = max(
                self._speed, (abs(step) - DEAD_BAND * self._filter.noise) / time)

    def _temperature_variance(self, age: float) -> float:
        """Return the variance [K2] of the change of an unknown temperature in ``age`` [s]."""
        return 2.0 * self._params.temperature_rate**2 * RATE_TIME * (
            age + RATE_TIME * math.expm1(-age / RATE_TIME))

    def _charge_sigma(self, signal: Array) -> float:
        """Return the standard deviation [C] of the heat."""
        temperature, variance = self._temperature, self._heat_variance
        age = float(signal[FilmSignal.TIME]) - self._flat_time
        if temperature is not None:
            sigma = temperature.sigma or self._params.temperature_sigma
            variance += 2.0 * sigma**2  # now and at the zero
            age = max(min(age, float(signal[FilmSignal.TIME]) - (
                temperature.stamp_ns - self._zero_ns) / NS_PER_S), 0.0)
        variance += self._temperature_variance(age)
        return abs(self._pyro) * math.sqrt(variance)

    def _deflection(self, value: float, sigma: float) -> Uncertain:
        """Return deflection [m] or, without geometry, the input of the operator."""
        film = self._film
        self._beyond |= abs(value) > film.max_input
        if self._beyond:
            self.state = 'beyond the calibrated range, until the next zero'
            return UNKNOWN
        both = np.array(value), np.array(sigma)
        self.state = (MEASURING if film.is_possible(*both) else
                      'under tension, or the zero is wrong')
        deflection, error = film.deflections(*both)
        return Uncertain(float(deflection), float(error))

    def status(self) -> dict[str, str | int | float]:
        """Return the values for diagnostics."""
        return {'state': self.state, 'zeros': self.zeros, 'gaps': self.gaps,
                'saturated': self.saturated, 'discharged': self.discharged,
                'clock_resets': self.restarts,
                'turning_points': self._filter.turnings if self._filter else 0,
                'noise': self._filter.noise if self._filter else math.nan,
                'temperature': self._temperature.value if self._temperature else math.nan}
