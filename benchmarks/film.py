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
Accuracy of deflections measured with a film, by amplitude and frequency.

A film is identified on one simulated recording. It then measures motions of other amplitudes and
frequencies, each with several seeds of the measurement noise.
"""

from __future__ import annotations

import sys

from benchmarks.harness import main_without_options
import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.film_bench import identify_film
from smart_tire.estimation.film.measure import measure
from smart_tire.models.film.buckling_film import FILMS
from smart_tire.reproduction.film_test_stand import FilmTestStand

SAMPLE_RATE = 500.0                            # Hz
IDENTIFICATION_MOTION = (0.012, 1.0, 60.0)     # m peak to peak, Hz, s
AMPLITUDES = (0.0005, 0.001, 0.002, 0.005, 0.010)   # m, peak to peak
FREQUENCIES = (1.0, 2.0, 5.0, 10.0)            # Hz
DURATION = 10.0                                # s
SEEDS = range(100, 104)


def sine(amplitude: float, frequency: float, duration: float) -> Array:
    """Return sinusoidal deflections between 0 and ``amplitude`` [m], from 0 on."""
    time = np.arange(round(duration * SAMPLE_RATE) + 1) / SAMPLE_RATE
    return 0.5 * amplitude * (1.0 - np.cos(2.0 * np.pi * frequency * time))


def print_accuracy() -> None:
    """Print RMS and normalized error of the deflection by amplitude and frequency."""
    bench = FilmTestStand(rate=SAMPLE_RATE)
    params = identify_film(bench.run(sine(*IDENTIFICATION_MOTION), 1), FILMS['25x3'])[0]
    print(f'film deflection, RMS error in um (over reported sigma), {len(SEEDS)} seeds:')
    print('  peak to peak' + ''.join(f'{frequency:13.0f} Hz' for frequency in FREQUENCIES))
    for amplitude in AMPLITUDES:
        cells = []
        for frequency in FREQUENCIES:
            motion = sine(amplitude, frequency, DURATION)
            errors, normalized = [], []
            for seed in SEEDS:
                recording = bench.run(motion, seed)
                result = measure(recording.time, recording.output, params)
                error = result.value - motion
                errors.append(error)
                normalized.append(error / result.sigma)
            cells.append(f'{1e6 * _rms(errors):8.1f} ({_rms(normalized):.2f}) ')
        print(f'  {1e3 * amplitude:9.1f} mm' + ''.join(f'{cell:>16}' for cell in cells))


def _rms(values: list[Array]) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))


if __name__ == '__main__':
    sys.exit(main_without_options(
        'film', 'measure the accuracy of deflections measured with a film', print_accuracy))
