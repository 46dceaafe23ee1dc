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
Layouts of films, and their accuracy on drives.

A film of another length has the signal chain of the robot's films with another gain: the range of
its converter is reached at the same slip of an adhering tire. The noise of a sample is one of the
charge, which that gain amplifies; the steps of the converter do not change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np

from smart_tire.calibration.film_gains import volts_per_slip
from smart_tire.design.crossing import ExactCrossings
from smart_tire.design.drive import AVERAGED, DriveInformation
from smart_tire.errors import ParameterError
from smart_tire.estimation.ground.measurements import MeasuredCrossing
from smart_tire.estimation.ground.unknowns import HOP, MIN_RADIUS_SIGMA
from smart_tire.models.tire.film_equations import bending_shape
from smart_tire.parameters.robot import RobotParams
from smart_tire.protocol.tire_payload import encode_batch, TireBatch
from smart_tire.samples import WHEELS

WHEEL_ORDER = 'front_right', 'front_left', 'rear_right', 'rear_left'  # that get films, in turn
CLEARANCE = 0.002      # m, between two films on one line; assumed
LENGTH_SIGMA = 0.1     # relative, of the contact length before it is measured; assumed
PRESSURE_TILT = 0.2    # -, standard deviation of the relative pressure at a shoulder of the tread,
#                        by side force and camber; assumed: the load moves by 3 % of the width
START_ANGLES = 3       # of the wheels, over which the accuracy is averaged
# of the payload of a packet: without its only sample
HEADER_BITS = 8 * len(encode_batch(TireBatch(0, 0, 0, 1, ((0,),), 0))) - 16


@dataclass(frozen=True)
class FilmLayout:
    """Films and their sampling: the same on each instrumented wheel."""

    wheels: int      # number of instrumented ones, the first of WHEEL_ORDER
    films: int       # per wheel
    length: float    # m
    spacing: float   # m, between film centers along the circumference
    across: float    # of the half width of the tread, from its middle, on alternating sides
    rate: float      # Hz
    bits: int
    noise: float     # V, standard deviation of a sample of the robot's films

    @classmethod
    def of(cls, robot: RobotParams) -> FilmLayout:
        """Return that of ``robot``, in the middle of the tread."""
        film, centers = robot.film, robot.film.centers
        return cls(len(film.wheels), film.count, film.length, (
            centers[-1] - centers[0]) / max(len(centers) - 1, 1) or film.spacing, 0.0,
            film.sample_rate, film.bits, film.noise)

    def __str__(self) -> str:
        apart = f', {1e3 * self.spacing:.0f} mm apart' if self.films > 1 else ''
        return (f'{self.wheels} x {self.films} x {1e3 * self.length:.0f} mm{apart}, '
                f'{self.across:g} across, {self.rate:.0f} Hz, {self.bits} bits')

    @property
    def names(self) -> tuple[str, ...]:
        """Return the instrumented wheels."""
        return WHEEL_ORDER[:self.wheels]

    def robot(self, base: RobotParams) -> RobotParams:
        """Return ``base`` with these films; raise ParameterError where they do not fit."""
        own, scales = base.film, []
        if self.films > 1 and self.spacing < self.length + CLEARANCE:
            raise ParameterError(f'{self}: the films overlap')
        bent = bending_shape(self.length, own.length, own.bending_alpha)[0]
        gains, peaks = (values[:own.count] for values in (own.stretch_gain, own.bending_peak))
        for gain, peak in zip(gains, peaks):
            before, after = (volts_per_slip(gain, length, base.tire.contact_length)
                             for length in (own.length, self.length))
            full = own.voltage_range - own.rest_voltage  # V
            scales.append(full / (bent * peak + (full - peak) * after / before))
        index = [i % own.count for i in range(self.films)]
        try:
            return replace(base, film=replace(
                own, wheels=self.names, length=self.length, sample_rate=self.rate, bits=self.bits,
                positions=tuple(i * self.spacing for i in range(self.films)),
                stretch_gain=tuple(scales[i] * gains[i] for i in index),
                bending_peak=tuple(scales[i] * bent * peaks[i] for i in index),
                noise=max(scales) * self.noise))
        except ValueError as error:
            raise ParameterError(str(error)) from error

    def radio_load(self, batch: int) -> float:
        """
        Return the load of the radio link [bit/s].

        Samples are packed with their bits; ``batch`` of them share a header, as in the payload.
        """
        return self.wheels * self.rate * (self.films * self.bits + HEADER_BITS / batch)


# of one wheel, with the standard deviation of the contact length where it is measured
Crossings = list[tuple[MeasuredCrossing, float | None]]


class Accuracy(NamedTuple):
    """Standard deviations by the bound, rms over drives."""

    friction: float        # relative, of mu after the drive
    slip: float            # -, of a wheel at its end
    film_slip: float       # -, of the films alone, in a crossing at its end
    contact_length: float  # relative, in a crossing at its end


class Study:
    """Accuracy of layouts on ``drives`` of one robot; friction and slip are of ``wheels``."""

    def __init__(self, drives: Sequence[DriveInformation], wheels: Sequence[str] = WHEELS) -> None:
        self.drives, self.robot = drives, drives[0].robot
        self._wheels = [WHEELS.index(name) for name in wheels]
        self._known: dict[FilmLayout, Accuracy] = {}
        self._crossings: dict[tuple[DriveInformation, FilmLayout, int], list[Crossings]] = {}

    def accuracy(self, layout: FilmLayout) -> Accuracy:
        """Return the accuracy with ``layout``; infinite where its films do not fit."""
        if layout.films > 1:  # films on both sides of the middle: no effect
            layout = replace(layout, across=0.0)
        if layout not in self._known:
            try:
                rows = [self._on(drive, layout) for drive in self.drives]
            except ParameterError:
                rows = [[math.inf] * 4]
            self._known[layout] = Accuracy(*_rms(rows))
        return self._known[layout]

    def _on(self, drive: DriveInformation, layout: FilmLayout) -> list[float]:
        """Return the accuracy on one drive."""
        rows, single = [], []
        radius_sigma = max(self.robot.wheel_radius_sigma, MIN_RADIUS_SIGMA)
        for start in range(START_ANGLES):
            found = [one for wheel in map(WHEELS.index, layout.names)
                     for one in self._crossings_of(drive, layout, wheel)[start]]
            products = np.zeros(len(WHEELS))
            for crossing, length_sigma in found:
                products[crossing.wheel] = PRESSURE_TILT * layout.across * abs(
                    crossing.slip * crossing.normalized_slip)
                if length_sigma is not None:
                    single.append((math.sqrt(crossing.covariance[0, 0]),
                                   math.hypot(length_sigma, radius_sigma)))
            rows.append(drive.sigmas([one for one, _ in found], products, self._wheels))
        return [*_rms(rows), *_rms(single or [(math.inf, LENGTH_SIGMA)])]

    def _crossings_of(self, drive: DriveInformation, layout: FilmLayout, wheel: int
                      ) -> list[Crossings]:
        """Return the crossings of ``wheel`` for each start angle; ParameterError as ``robot``."""
        layout = replace(layout, wheels=len(WHEELS), across=0.0)  # they do not depend on these
        if (key := (drive, layout, wheel)) not in self._crossings:
            robot = layout.robot(self.robot)
            exact, free = (ExactCrossings(robot, WHEELS[wheel], drive.trajectories[wheel], sigma)
                           for sigma in (0.0, LENGTH_SIGMA))
            late = drive.drive.duration - AVERAGED * HOP  # s
            self._crossings[key] = [
                [(MeasuredCrossing(place.time, wheel, place.slip, place.normalized_slip,
                                   result.slips.covariance, result.sliding),
                  free.length_sigma(films, place) if place.time > late else None)
                 for films in robot.film_groups
                 for place in drive.places(
                     wheel, float(np.mean([robot.film.centers[i] for i in films])),
                     start / START_ANGLES)
                 if (result := exact.measure(films, place)) is not None]
                for start in range(START_ANGLES)]
        return self._crossings[key]


def _rms(rows: Sequence[Sequence[float]]) -> list[float]:
    """Return the root mean square of each column."""
    found: list[float] = np.sqrt(np.mean(np.square(rows), axis=0)).tolist()
    return found
