# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Film voltages during one patch crossing, and those of the model for its estimates."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math

import numpy as np

from smart_tire.arrays import Array, Instants
from smart_tire.models.tire import strain_charge, tread_film
from smart_tire.parameters import RobotParams
from smart_tire.recording import seconds
from smart_tire.samples import Friction

WAVEFORM_REACH = 1.5  # patch lengths of travel shown before and after a crossing
MIN_COMPLETE = 0.9    # share of the samples; a lost batch leaves a gap
CURVE_POINTS = 241    # of the model: its minimum is sharp
SHIFTS = np.linspace(-0.15, 0.15, 25)  # patch lengths, of a film from its configured place


@dataclass(frozen=True)
class FilmWaveform:
    """
    Voltages of one film.

    Positions are those of the film's center relative to the center of the patch, positive after
    it in the direction of motion, by the rolled distance.
    """

    film: int              # index of the film on the wheel, 0 for film 1
    delay: float           # s after the crossing at which the centers of film and patch coincide
    rest: float            # V, of the film outside of the patch
    position: Array        # m, (n,), of the samples
    volts: Array           # V, (n,), measured
    model_position: Array  # m, (m,), ascending; empty where slip or adhesion is unknown
    model_volts: Array     # V, (m,)


@dataclass(frozen=True)
class CrossingWaveform:
    """Voltages of the films of a wheel around one crossing."""

    wheel: str
    speed: float  # m/s, of the wheel's circumference, positive in both directions
    reach: float  # m, half the length that a film covers while it overlaps the patch
    films: Sequence[FilmWaveform]
    complete: bool  # no batch of samples is lost

    def time_ms(self, film: FilmWaveform, position: Array) -> Array:
        """Return the times [ms] after the crossing at which a film is at ``position`` [m]."""
        return 1e3 * (film.delay + position / self.speed)


def crossing_waveform(crossing: Friction, stamp_ns: Instants, volts: Array, omega: float,
                      robot: RobotParams) -> CrossingWaveform | None:
    """
    Return the waveform of ``crossing``; None without samples or if the wheel stands.

    ``volts`` (n, films) are samples of its wheel at ``stamp_ns`` (n,), ``omega`` [rad/s] is the
    wheel's speed. The timestamp of a crossing is that of the midpoint between the outer films.
    """
    speed = robot.wheel_radius * omega
    if not abs(speed) > 0.0:
        return None
    reach = WAVEFORM_REACH * robot.tire.contact_length / abs(speed)
    time = seconds(stamp_ns, crossing.stamp_ns)
    shown = np.abs(time) <= reach
    if not shown.any():
        return None
    time, volts = time[shown], volts[shown]
    group = max((films for films in robot.film_groups if films[-1] < volts.shape[1]),
                key=lambda films: float(np.ptp(volts[:, list(films)])), default=())
    places = [robot.film.centers[film] for film in group]
    model = _model(crossing, robot)
    found = []
    for film, place in zip(group, places):
        delay = (place - 0.5 * (places[0] + places[-1])) / speed
        found.append(_film_waveform(film, delay, abs(speed) * (time - delay), volts[:, film],
                                    robot, model))
    share = len(time) / (2.0 * reach * robot.film.sample_rate)
    return CrossingWaveform(crossing.wheel, abs(speed), _half(robot), found,
                            share >= MIN_COMPLETE)


def _half(robot: RobotParams) -> float:
    return 0.5 * (robot.tire.contact_length + robot.film.length)


Model = Callable[[int, Array], tuple[Array, Array]]  # film, position [m] -> stretch [V], shapes


def _model(crossing: Friction, robot: RobotParams) -> Model | None:
    """
    Return the stretch output for the estimates of ``crossing``; None if they are unknown.

    With it, the shapes (3, n) of bending and of the bumps before and after the contact, of which
    the amplitudes vary from cycle to cycle.
    """
    film, patch = robot.film, robot.tire.contact_length
    slip, adhesion = crossing.film_slip.value, crossing.adhesion_ratio.value
    if not math.isfinite(slip + adhesion):
        return None
    gains = film.gains(crossing.wheel)

    def model(which: int, position: Array) -> tuple[Array, Array]:
        x = position + 0.5 * (patch - film.length)
        stretched = gains[which] * strain_charge.overlap_integral(
            x, slip, 1.0 - adhesion, 1.0, film.length, patch)
        bent = tread_film.bending(x, film.length, patch, film.bending_alpha, film.release)
        bumps, after = tread_film.bumps(x, film.length, patch)
        return stretched, np.stack([bent, bumps * ~after, bumps * after])
    return model


def _film_waveform(film: int, delay: float, position: Array, volts: Array, robot: RobotParams,
                   model: Model | None) -> FilmWaveform:
    """Return the waveform of a film; its amplitudes and its place, which vary most, are fitted."""
    outside = np.abs(position) > _half(robot)
    rest = float(np.median(volts[outside])) if outside.any() else robot.film.rest_voltage
    if model is None:
        return FilmWaveform(film, delay, rest, position, volts, np.empty(0), np.empty(0))
    shifts = robot.tire.contact_length * SHIFTS
    stretched, shapes = model(film, (position - shifts[:, np.newaxis]).ravel())
    above = volts - rest - stretched.reshape(len(shifts), -1)
    at_shift = shapes.reshape(-1, *above.shape).swapaxes(0, 1)
    fits = [np.linalg.lstsq(one.T, left, rcond=None)[0] for one, left in zip(at_shift, above)]
    errors = [left - fit @ one for fit, one, left in zip(fits, at_shift, above)]
    best = int(np.argmin(np.sum(np.square(errors), axis=1)))
    places = np.linspace(position[0], position[-1], CURVE_POINTS)
    stretched, shapes = model(film, places - shifts[best])
    return FilmWaveform(film, delay, rest, position, volts, places,
                        rest + stretched + fits[best] @ shapes)
