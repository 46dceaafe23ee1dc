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

"""
Checks of the films: rest voltage, clipping, dead films, order, crossings, battery of the nodes.

A film is outside the patch for most of a revolution, so the median of its voltage is that at rest.
The order shows in the distance by which the signal of film 2 follows that of film 1.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from smart_tire.analysis.checks.recording import CheckedRecording
from smart_tire.arrays import Array
from smart_tire.findings import Finding, Level
from smart_tire.parameters.robot import FilmParams
from smart_tire.recording import Stream
from smart_tire.samples import NS_PER_S, WHEELS

MIN_SAMPLES = 100
REST_TOLERANCE = 0.1        # V
CLIPPED_SHARE, MOSTLY_CLIPPED = 0.01, 0.1  # of the samples; a crossing is an eighth of them
RAIL_SHARE = 0.5            # of the samples at a rail of a broken film
MIN_REVOLUTIONS = 3.0       # for the checks of crossings
DEAD_SIGMAS = 4.0           # spread of the signal of a rolling wheel, in standard deviations
MIN_CROSSING_SIGMAS, MIN_CROSSING = 10.0, 0.1  # of the noise; V
MIN_CROSSING_SHARE = 0.5    # of the revolutions that a film crosses the patch
QUIET_TIME_SHARE = 0.2      # of a mean revolution, that separates two crossings
MIN_ROLLING = 0.2           # rad/s
DISTANCE_STEP = 0.002       # m, of the signal over rolled distance
MIN_RUN = 1.2               # revolutions in one direction without a gap
MAX_GAP = 0.1               # s between samples of a run
MIN_CORRELATION = 0.5       # of both films, at the best shift
LOW_BATTERY = 3.3           # V; a lithium-ion cell is nearly empty


def check_voltages(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield films with a wrong rest voltage, and films at the rails of the converter."""
    film = recording.robot.film
    for stream in _streams(recording):
        for index, volts in enumerate(stream.values.T):
            where = f'film {index + 1} of {stream.wheel}'
            half_step = 0.5 * film.code_voltage
            clipped = float(((volts <= half_step)
                             | (volts >= film.voltage_range - half_step)).mean())
            rest = float(np.median(volts))
            if clipped > RAIL_SHARE:
                yield Finding(Level.ERROR, where, f'at a rail in {clipped:.0%} of the samples',
                              f'rest voltage {film.rest_voltage:g} V', 'check film and amplifier')
            elif clipped > CLIPPED_SHARE:
                yield Finding(Level.WARNING if clipped > MOSTLY_CLIPPED else Level.INFO, where,
                              f'clipped in {clipped:.1%} of the samples',
                              f'within 0 to {film.voltage_range:g} V', 'lower the amplifier gain')
            if clipped <= RAIL_SHARE and abs(rest - film.rest_voltage) > REST_TOLERANCE:
                yield Finding(Level.WARNING, where, f'rests at {rest:.3f} V',
                              f'film.rest_voltage {film.rest_voltage:g} V',
                              'adjust the amplifier, or set film.rest_voltage')


def check_crossings(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield films without a signal, or with too few patch crossings, while the wheel rolls."""
    film = recording.robot.film
    for stream in _streams(recording):
        angle = _angles(recording, stream)
        revolutions = float(np.nansum(np.abs(np.diff(angle)))) / (2.0 * np.pi)
        rolling = np.abs(np.gradient(angle, stream.ordered.stamp_ns / NS_PER_S)) > MIN_ROLLING
        if revolutions < MIN_REVOLUTIONS or rolling.sum() < MIN_SAMPLES:
            continue
        for index, volts in enumerate(stream.ordered.values.T):
            yield from _signal(f'film {index + 1} of {stream.wheel}', volts, rolling,
                               revolutions, film)


def _signal(where: str, volts: Array, rolling: np.ndarray, revolutions: float,
            film: FilmParams) -> Iterator[Finding]:
    if float(np.std(volts[rolling])) < DEAD_SIGMAS * film.sample_variance ** 0.5:
        yield Finding(Level.ERROR, where, f'no signal while the wheel rolls: {revolutions:.0f} '
                      f'revolutions, spread {1e3 * np.std(volts[rolling]):.2g} mV',
                      'a voltage pulse in each revolution', 'check film, cable and amplifier')
        return
    limit = max(MIN_CROSSING, MIN_CROSSING_SIGMAS * film.sample_variance ** 0.5)
    active = np.abs(volts - np.median(volts)) > limit
    quiet_samples = int(QUIET_TIME_SHARE * len(volts) / revolutions)
    edges = np.flatnonzero(active)
    crossings = 1 + int((np.diff(edges) > quiet_samples).sum()) if len(edges) else 0
    if crossings < MIN_CROSSING_SHARE * revolutions:
        yield Finding(Level.WARNING, where, f'{crossings} patch crossings in {revolutions:.0f} '
                      'revolutions', 'one in each', 'check film and amplifier gain')


def check_order(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield wheels whose films enter the patch in the opposite order."""
    film, radius = recording.robot.film, recording.robot.wheel_radius
    if film.count != 2:
        return
    spacing = film.centers[1] - film.centers[0]
    for stream in _streams(recording):
        if stream.values.shape[1] != 2:
            continue
        shift = _shift(stream.ordered.values, radius * _angles(recording, stream),
                       stream.ordered.stamp_ns / NS_PER_S, 2.0 * np.pi * radius)
        if shift is not None and abs(shift + spacing) < 0.5 * spacing:
            yield Finding(Level.ERROR, f'films of {stream.wheel}', f'film 2 enters the patch '
                          f'{1e3 * -shift:.0f} mm before film 1', f'{1e3 * spacing:.0f} mm after '
                          'it, rolling forward', 'swap the channels, or the wheel is mounted the '
                          'wrong way round')
        elif shift is not None and abs(shift - spacing) > 0.5 * spacing:
            yield Finding(Level.WARNING, f'films of {stream.wheel}', f'film 2 follows film 1 by '
                          f'{1e3 * shift:.0f} mm', f'film.spacing {1e3 * spacing:.0f} mm',
                          'measure film.spacing')


def _shift(volts: Array, distance: Array, time: Array, circumference: float) -> float | None:
    """Return the rolled distance [m] by which film 2 follows film 1; None if it is not clear."""
    half = int(0.5 * circumference / DISTANCE_STEP)
    total, power = np.zeros(2 * half + 1), np.zeros(2)
    for first, last in _runs(distance, time, MIN_RUN * circumference):
        order = slice(first, last) if distance[last - 1] > distance[first] else slice(
            last - 1, first - 1 if first else None, -1)
        grid = np.arange(distance[order][0], distance[order][-1], DISTANCE_STEP)
        one, two = (np.interp(grid, distance[order], film) for film in volts[order].T)
        one, two = one - np.median(one), two - np.median(two)
        size = 1 << (2 * len(grid)).bit_length()
        product = np.fft.irfft(np.conj(np.fft.rfft(one, size)) * np.fft.rfft(two, size), size)
        total += np.concatenate([product[-half:], product[:half + 1]])
        power += np.sum(one ** 2), np.sum(two ** 2)
    best = int(np.argmax(total))
    if not power.all() or total[best] < MIN_CORRELATION * np.sqrt(power[0] * power[1]):
        return None
    return (best - half) * DISTANCE_STEP


def _runs(distance: Array, time: Array, length: float) -> Iterator[tuple[int, int]]:
    """Yield first and last + 1 of samples that roll one way, at least ``length`` [m]."""
    steps = np.diff(distance)
    state = np.where(np.isnan(steps) | (np.diff(time) > MAX_GAP), 0.0, np.sign(steps))
    edges = np.flatnonzero(np.diff(state)) + 1
    bounds = [0, *edges.tolist(), len(state)]
    for begin, end in zip(bounds, bounds[1:]):
        if state[begin] and abs(distance[end] - distance[begin]) >= length:
            yield begin, end + 1


def check_battery(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield sensor nodes with a low battery."""
    for stream in recording.of('tire_battery'):
        volts = float(np.median(stream.ordered.values[-10:]))
        if volts < LOW_BATTERY:
            yield Finding(Level.WARNING, stream.name, f'{volts:.2f} V',
                          f'at least {LOW_BATTERY:g} V', 'charge the battery of the sensor node')


def _streams(recording: CheckedRecording) -> list[Stream]:
    return [stream for stream in recording.of('tire_samples')
            if len(stream.ordered) >= MIN_SAMPLES]


def _angles(recording: CheckedRecording, stream: Stream) -> Array:
    """Return the angle [rad] of the wheel at each film sample, NaN outside the wheel samples."""
    time = stream.ordered.stamp_ns / NS_PER_S
    wheels, index = recording.wheels, WHEELS.index(stream.wheel)
    if wheels is None or len(wheels.ordered) < 2:
        return np.full(len(time), np.nan)
    wheels = wheels.ordered
    stamps, position = wheels.stamp_ns, wheels['position'][:, index]
    if np.isnan(position).any():
        steps = np.diff(stamps) / NS_PER_S
        position = np.concatenate([[0.0], np.cumsum(wheels['velocity'][1:, index] * steps)])
    return np.interp(time, stamps / NS_PER_S, position, left=np.nan, right=np.nan)
