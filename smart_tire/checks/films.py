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
Checks of the films: rest voltage, clipping, dead films, order, crossings, battery of the nodes.

A film is outside the patch for most of a revolution, so the median of its voltage is that at rest.
The order shows in the distance by which the signal of film 2 follows that of film 1.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from smart_tire.arrays import Array
from smart_tire.checks import limits
from smart_tire.checks.recording import CheckedRecording, finding
from smart_tire.findings import Finding, Level
from smart_tire.recording import Stream
from smart_tire.samples import NS_PER_S, WHEELS


def check_voltages(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield films with a wrong rest voltage, and films at the rails of the converter."""
    film = recording.robot.film
    margin = 0.5 * film.code_voltage
    for stream in _streams(recording):
        for where, volts in _films(stream):
            share = float(((volts <= margin) | (volts >= film.voltage_range - margin)).mean())
            rest = float(np.median(volts))
            if share > 0.5:  # most samples of a broken film
                yield finding('film_at_rail', where, share=share, rest=film.rest_voltage)
                continue
            if share > limits.CLIPPED_SHARE:
                yield finding('film_clipped', where,
                              Level.WARNING if share > limits.MOSTLY_CLIPPED else None,
                              share=share, range=film.voltage_range)
            if abs(rest - film.rest_voltage) > limits.REST_TOLERANCE:
                yield finding('film_rest', where, rest=rest, configured=film.rest_voltage)


def _films(stream: Stream) -> Iterator[tuple[str, Array]]:
    """Yield name and voltages of each film, by timestamp."""
    for index, volts in enumerate(stream.ordered.values.T):
        yield f'film {index + 1} of {stream.wheel}', volts


def check_crossings(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield films without a signal, or with too few patch crossings, while the wheel rolls."""
    sigma = recording.robot.film.sample_variance ** 0.5
    for stream in _streams(recording):
        angle = _angles(recording, stream)
        revolutions = float(np.nansum(np.abs(np.diff(angle)))) / (2.0 * np.pi)
        speed = np.gradient(angle, stream.ordered.stamp_ns / NS_PER_S)
        rolling = np.abs(speed) > limits.MIN_SPEED
        if revolutions < limits.MIN_REVOLUTIONS or rolling.sum() < limits.MIN_READINGS:
            continue
        for where, volts in _films(stream):
            spread = float(np.std(volts[rolling]))
            crossings = _crossings(volts, sigma, limits.QUIET_TIME_SHARE / revolutions)
            if spread < limits.DEAD_SIGMAS * sigma:
                yield finding('film_dead', where, revolutions=revolutions, spread=1e3 * spread)
            elif crossings < 0.5 * revolutions:
                yield finding('film_crossings', where, crossings=crossings,
                              revolutions=revolutions)


def _crossings(volts: Array, sigma: float, quiet_share: float) -> int:
    """Return the number of times the signal leaves its rest, apart by a share of all samples."""
    active = np.abs(volts - np.median(volts)) > limits.CROSSING_SIGMAS * sigma
    edges = np.flatnonzero(active)
    return int((np.diff(edges) > int(quiet_share * len(volts))).sum()) + bool(len(edges))


def check_order(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield wheels whose films enter the patch in the opposite order."""
    film, radius = recording.robot.film, recording.robot.wheel_radius
    spacing = film.centers[1] - film.centers[0] if film.count == 2 else 0.0
    for stream in _streams(recording):
        if film.count != 2 or stream.values.shape[1] != 2:
            continue
        shift = _shift(stream.ordered.values, radius * _angles(recording, stream),
                       2.0 * np.pi * radius, 0.1 * film.length)
        if shift is not None and abs(shift - spacing) > 0.5 * spacing:
            swapped = abs(shift + spacing) < 0.5 * spacing
            yield finding('films_swapped' if swapped else 'film_spacing',
                          f'films of {stream.wheel}',
                          shift=1e3 * shift, lead=-1e3 * shift, spacing=1e3 * spacing)


def _shift(volts: Array, distance: Array, circumference: float, step: float) -> float | None:
    """
    Return the rolled distance [m] by which film 2 follows film 1; None if it is not clear.

    ``step`` [m] is its resolution.
    """
    half = int(0.5 * circumference / step)
    shifts = np.arange(-half, half + 1)
    total, power = np.zeros(len(shifts)), np.zeros(2)
    for run in _runs(distance, limits.MIN_RUN * circumference):
        way, films = distance[run], volts[run]
        if way[-1] < way[0]:
            way, films = way[::-1], films[::-1]
        grid = np.arange(way[0], way[-1], step)
        one, two = (np.interp(grid, way, film) for film in films.T)
        one, two = one - np.median(one), two - np.median(two)
        size = len(grid) + half  # with zeros, so that neither end meets the other
        one_spectrum, two_spectrum = np.fft.rfft([one, two], size)
        total += np.fft.irfft(np.conj(one_spectrum) * two_spectrum, size)[shifts]
        power += np.sum(one ** 2), np.sum(two ** 2)
    best = int(np.argmax(total))
    if not power.all() or total[best] < limits.MIN_CORRELATION * np.sqrt(power[0] * power[1]):
        return None
    return (best - half) * step


def _runs(distance: Array, length: float) -> Iterator[slice]:
    """Yield the samples that roll one way, at least ``length`` [m]."""
    state = np.nan_to_num(np.sign(np.diff(distance)))
    edges = np.flatnonzero(np.diff(state)) + 1
    bounds = [0, *edges.tolist(), len(state)]
    for begin, end in zip(bounds, bounds[1:]):
        if state[begin] and abs(distance[end] - distance[begin]) >= length:
            yield slice(begin, end + 1)


def check_battery(recording: CheckedRecording) -> Iterator[Finding]:
    """Yield sensor nodes with a low battery."""
    for stream in recording.of('tire_battery'):
        volts = float(np.median(stream.ordered.values[-10:]))
        if volts < limits.LOW_BATTERY:
            yield finding('battery', stream.name, volts=volts, limit=limits.LOW_BATTERY)


def _streams(recording: CheckedRecording) -> list[Stream]:
    return [stream for stream in recording.of('tire_samples')
            if len(stream.ordered) >= limits.MIN_READINGS]


def _angles(recording: CheckedRecording, stream: Stream) -> Array:
    """Return the angle [rad] of the wheel at each film sample, NaN outside the wheel samples."""
    time = stream.ordered.stamp_ns / NS_PER_S
    wheels, index = recording.wheels.ordered, WHEELS.index(stream.wheel)
    if len(wheels) < 2:
        return np.full(len(time), np.nan)
    stamps, position = wheels.stamp_ns, wheels['position'][:, index]
    if np.isnan(position).any():
        steps = np.diff(stamps) / NS_PER_S
        position = np.concatenate([[0.0], np.cumsum(wheels['velocity'][1:, index] * steps)])
    return np.interp(time, stamps / NS_PER_S, position, left=np.nan, right=np.nan)
