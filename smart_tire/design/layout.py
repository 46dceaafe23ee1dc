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
Layouts of films, their accuracy on drives, and the best one under limits.

A film of another length has the signal chain of the robot's films with another gain: the range
of its converter is reached at the same slip of an adhering tire. Its noise is one of the charge,
which that gain amplifies, or one of the converter, which does not change with the length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np

from smart_tire.calibration.film_gains import volts_per_slip
from smart_tire.design.crossing import ExactCrossings
from smart_tire.design.drive import DriveInformation
from smart_tire.errors import ParameterError
from smart_tire.estimation.friction.waveform_model import Shared
from smart_tire.estimation.ground.measurements import MeasuredCrossing
from smart_tire.models.tire.film_equations import bending_shape
from smart_tire.parameters.robot import RobotParams
from smart_tire.protocol.tire_payload import encode_batch, TireBatch
from smart_tire.samples import WHEELS

WHEEL_ORDER = 'front_right', 'front_left', 'rear_right', 'rear_left'  # that get films, in turn
CLEARANCE = 0.002      # m, between two films on one line; assumed
LENGTH_SIGMA = 0.1     # relative, of the contact length before it is measured; assumed
START_ANGLES = 3       # of the wheels, over which the accuracy is averaged
PRESSURE_TILT = 0.2    # -, standard deviation of the relative pressure at a shoulder of the tread,
#                        by side force and camber; assumed: the load moves by 3 % of the width


@dataclass(frozen=True)
class Layout:
    """Films and their sampling: the same on each instrumented wheel."""

    wheels: int      # number of instrumented ones, the first of WHEEL_ORDER
    films: int       # per wheel
    length: float    # m
    spacing: float   # m, between film centers along the circumference
    across: float    # of the half width of the tread, from its middle, on alternating sides
    rate: float      # Hz
    bits: int
    noise: float     # V, standard deviation of a sample of the robot's films
    charge_noise: bool = True  # the noise is one of the charge

    @classmethod
    def of(cls, robot: RobotParams, charge_noise: bool = True) -> Layout:
        """Return that of ``robot``, in the middle of the tread."""
        film, centers = robot.film, robot.film.centers
        spacing = (centers[-1] - centers[0]) / max(len(centers) - 1, 1) or film.spacing
        return cls(len(film.wheels), film.count, film.length, spacing, 0.0, film.sample_rate,
                   film.bits, film.noise, charge_noise)

    @property
    def names(self) -> tuple[str, ...]:
        """Return the instrumented wheels."""
        return WHEEL_ORDER[:self.wheels]

    def robot(self, base: RobotParams) -> RobotParams:
        """Return ``base`` with these films; raise ParameterError where they do not fit."""
        own, patch = base.film, base.tire.contact_length
        if self.films > 1 and self.spacing < self.length + CLEARANCE:
            raise ParameterError(f'films of {1e3 * self.length:g} mm at a distance of '
                                 f'{1e3 * self.spacing:g} mm overlap')
        bent = bending_shape(self.length, own.length, own.bending_alpha)[0]
        gains, peaks, noise = [], [], 0.0
        for i in range(self.films):
            gain, peak = own.stretch_gain[i % own.count], own.bending_peak[i % own.count]
            full = (own.voltage_range - own.rest_voltage - peak) / volts_per_slip(
                gain, own.length, patch)  # slip
            scale = (peak + full * volts_per_slip(gain, own.length, patch)) / (
                bent * peak + full * volts_per_slip(gain, self.length, patch))
            gains.append(scale * gain)
            peaks.append(scale * bent * peak)
            noise = max(noise, self.noise * (scale if self.charge_noise else 1.0))
        try:
            return replace(base, film=replace(
                own, wheels=self.names, length=self.length, spacing=self.spacing,
                positions=tuple(i * self.spacing for i in range(self.films)),
                stretch_gain=tuple(gains), bending_peak=tuple(peaks), noise=noise,
                bits=self.bits, sample_rate=self.rate))
        except ValueError as error:
            raise ParameterError(str(error)) from error

    def radio_load(self, batch: int) -> float:
        """
        Return the load of the radio link [bit/s].

        Samples are packed with their bits; ``batch`` of them share a header, as in the payload.
        """
        header = 8 * len(encode_batch(TireBatch(0, 0, 0, 1, ((0,),), 0))) - 16
        return self.wheels * self.rate * (self.films * self.bits + header / batch)


class Accuracy(NamedTuple):
    """Standard deviations by the bound, rms over drives."""

    friction: float        # relative, of mu after the drive
    slip: float            # -, of a wheel at its end
    film_slip: float       # -, of the films alone, in one crossing
    contact_length: float  # relative, in one crossing


class Study:
    """
    Accuracy of layouts on ``drives`` of one robot.

    The tread is ``round``: contact length and pressure fall from its middle as in an elliptic
    contact; or they are the same over the width.
    """

    def __init__(self, drives: Sequence[DriveInformation], round_tread: bool = False) -> None:
        self.drives, self.round_tread, self.robot = drives, round_tread, drives[0].robot
        self._known: dict[Layout, Accuracy] = {}

    def accuracy(self, layout: Layout) -> Accuracy:
        """Return the accuracy with ``layout``; infinite where its films do not fit."""
        if not self.round_tread and layout.films > 1:
            layout = replace(layout, across=0.0)  # of which nothing depends on it
        if layout not in self._known:
            try:
                rows = [self._on(drive, layout) for drive in self.drives]
            except ParameterError:
                rows = [[math.inf] * len(Accuracy._fields)]
            self._known[layout] = Accuracy(*np.sqrt(np.mean(np.square(rows), axis=0)).tolist())
        return self._known[layout]

    def drives_alone(self) -> Accuracy:
        """Return the accuracy without films."""
        rows = [drive.sigmas((), np.zeros(len(WHEELS))) for drive in self.drives]
        return Accuracy(*np.sqrt(np.mean(np.square(rows), axis=0)), math.inf, LENGTH_SIGMA)

    def _on(self, drive: DriveInformation, layout: Layout) -> list[float]:
        """Return the accuracy on one drive."""
        robot, rows, single = layout.robot(self.robot), [], []
        share = math.sqrt(1.0 - layout.across**2) if self.round_tread else 1.0
        robot = replace(robot, tire=replace(
            robot.tire, contact_length=share * robot.tire.contact_length))
        scale = np.diag([1.0, share])  # of the normalized slip, which is that of local pressure
        fitters = {name: [ExactCrossings(robot, name, drive.trajectories[WHEELS.index(name)], sigma)
                          for sigma in (0.0, LENGTH_SIGMA)] for name in layout.names}
        for start in range(START_ANGLES):
            found, products = [], np.zeros(len(WHEELS))
            for name, (exact, free) in fitters.items():
                wheel = WHEELS.index(name)
                for films in robot.film_groups:
                    center = float(np.mean([robot.film.centers[i] for i in films]))
                    for place in drive.places(wheel, center, start / START_ANGLES):
                        local = place._replace(normalized_slip=place.normalized_slip / share)
                        result = exact.measure(films, local)
                        if result is not None:
                            found.append(MeasuredCrossing(
                                place.time, wheel, place.slip, place.normalized_slip,
                                scale @ result.slips.covariance @ scale, result.sliding))
                    last = free.measure(films, local)
                    if result is not None and last is not None and last.waveform is not None:
                        single.append((result.slips.slip_sigma,
                                       last.waveform.shared(Shared.LENGTH).sigma))
                if layout.films == 1:  # others are on both sides of the middle
                    products[wheel] = PRESSURE_TILT * layout.across * abs(
                        place.slip * place.normalized_slip)
            rows.append(drive.sigmas(found, products))
        return [*np.sqrt(np.mean(np.square(rows), axis=0)), *np.sqrt(np.mean(np.square(
            single or [(math.inf, LENGTH_SIGMA)]), axis=0))]
