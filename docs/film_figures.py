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
Figures and numbers of docs/how_to/film_sensor.md: a simulated film, calibrated and measured live.

``python docs/film_figures.py`` sends the bytes of the simulated amplifier through driver and
estimator, draws docs/images/film_sensor.png and film_temperature.png, and prints the errors of the
motions of paper A, Figs. 7 to 9. The calibration is that of docs/simulated_film.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import matplotlib
from matplotlib.figure import Figure
import numpy as np

from smart_tire.arrays import Array
from smart_tire.drivers.sample_stream import FILM_CHARGE, SampleStream
from smart_tire.estimation.film.calibration import FilmParams, read_params
from smart_tire.estimation.film.estimator import FilmEstimator
from smart_tire.parameters.film import FilmSensorParams, FilmSimulatorParams
from smart_tire.samples import FilmTemperature, NS_PER_S
from smart_tire.simulation.film import MOTION, SimulatedFilm

IMAGES = Path(__file__).parent / 'images'
CALIBRATION = Path(__file__).parents[1] / 'config' / 'calibration' / 'simulated_film.yaml'
EPOCH_NS = 1_700_000_000 * NS_PER_S
TEMPERATURE_PERIOD = 50  # samples
AMPLITUDES = np.array([1.25, 2.5, 3.75, 6.0]) * 1e-3  # m: shares of the length as in Fig. 7


def measured(params: FilmSimulatorParams, film: FilmParams, seconds: float, *,
             temperature: bool = True, sensor: FilmSensorParams | None = None) -> Array:
    """Return time [s], truth, deflection, sigma [m] (n, 4); zeroed in each rest but the first."""
    device, stream = SimulatedFilm(params), SampleStream(FILM_CHARGE)
    estimator = FilmEstimator(sensor or FilmSensorParams(), film)
    rest, truth, found = params.rest + MOTION, [], []
    next_zero = rest + 0.5 * params.rest

    def inputs() -> Iterator[object]:
        for k in range(round(seconds * params.rate)):
            now = device.next_instant()
            truth.append((now.time_ns / NS_PER_S, now.deflection))
            if temperature and k % TEMPERATURE_PERIOD == 0:
                yield FilmTemperature(EPOCH_NS + now.time_ns, now.temperature, 0.02)
            yield from stream.receive(now.frame, EPOCH_NS + now.time_ns)

    for sample in inputs():
        if truth[-1][0] >= next_zero:
            estimator.zero()
            next_zero += rest
        found += estimator.update(sample)
    rows = np.array([((one.stamp_ns - EPOCH_NS) / NS_PER_S, *one.deflection) for one in found])
    time, path = np.array(truth).T
    return np.column_stack([rows[:, 0], np.interp(rows[:, 0], time, path), rows[:, 1:]])


def draw(figure: Figure, rows: list[tuple[str, Array]], begin: float, end: float) -> None:
    """Draw deflection, truth and band of each recording below one another."""
    for ax, (title, found) in zip(np.ravel(figure.subplots(
            len(rows), 1, sharex=True, squeeze=False)), rows):
        time, truth, value, sigma = found[(found[:, 0] >= begin) & (found[:, 0] < end)].T
        ax.fill_between(time, 1e3 * (value - 2.0 * sigma), 1e3 * (value + 2.0 * sigma), lw=0.0,
                        color='tab:blue', alpha=0.3, label='± 2 standard deviations')
        ax.plot(time, 1e3 * value, color='tab:blue', lw=1.0, label='film_deflection')
        ax.plot(time, 1e3 * truth, color='black', lw=0.8, ls='--', label='truth')
        ax.set(ylabel='deflection [mm]', title=title, ylim=(-4.0, 18.0), xlim=(begin, end))
    ax.legend(loc='upper right', ncols=3, fontsize=8)
    ax.set_xlabel('time [s]')


def rms(found: Array, begin: float, end: float) -> tuple[float, float, float]:
    """Return rms error, mean sigma [m] and mean normalized squared error in a time."""
    part = found[(found[:, 0] >= begin) & (found[:, 0] < end) & np.isfinite(found[:, 2])]
    error = part[:, 2] - part[:, 1]
    return (float(np.sqrt(np.mean(error**2))), float(np.mean(part[:, 3])),
            float(np.mean((error / part[:, 3])**2)))


def save(name: str, rows: list[tuple[str, Array]], begin: float, end: float) -> None:
    """Write a figure into docs/images."""
    figure = Figure(figsize=(8.0, 2.3 * len(rows) + 0.4), layout='constrained')
    draw(figure, rows, begin, end)
    figure.savefig(IMAGES / name, dpi=90)


def main() -> None:
    """Draw and print."""
    matplotlib.use('agg')
    film = read_params(CALIBRATION)
    slow = FilmSimulatorParams(frequency=0.5, stroke=0.012)
    recording = measured(slow, film, 24.0)
    save('film_sensor.png', [
        ('zeroed at the start, and again after strokes, at 13 s', recording)], 0.0, 24.0)
    print('recording, 0.5 Hz: rms, sigma [mm], NEES before', *rms(recording, 2.0, 12.0),
          'after the second zero', *rms(recording, 14.0, 24.0))
    warm = FilmSimulatorParams(frequency=0.5, stroke=0.012, warming=1.5)
    blind = FilmSensorParams(temperature_rate=0.0)
    steps = [(title, measured(warm, film, 24.0, temperature=given, sensor=sensor))
             for title, given, sensor in (
                 ('film_temperature received', True, FilmSensorParams()),
                 ('not received, temperature_rate 0.1 K/s', False,
                  FilmSensorParams(temperature_rate=0.1)),
                 ('not received, and taken for constant', False, blind))]
    save('film_temperature.png', steps, 8.0, 24.0)
    for title, found in steps:
        print(f'1.5 K: {title}: rms, sigma [mm], NEES', *rms(found, 14.0, 24.0))
    loop = measured(FilmSimulatorParams(), film, 24.0)
    print('Figs. 8 and 9, 5 Hz, 12 mm: rms, sigma [mm], NEES', *rms(loop, 14.0, 24.0))
    for top in AMPLITUDES:
        found = measured(FilmSimulatorParams(
            stroke=2.0 * float(top), frequency=2.0), film, 18.0)
        part = found[(found[:, 0] > 14.0) & (found[:, 0] < 18.0)]
        slope = float(np.polyfit(part[:, 1], part[:, 2], 1)[0])
        print(f'Fig. 7, 2 Hz, amplitude {1e3 * top:.2f} mm: measured {1e3 * slope * top:.3f} mm,',
              'rms, sigma [mm], NEES', *rms(found, 14.0, 18.0))


if __name__ == '__main__':
    main()
