# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Models of both papers: the buckled film as a sensor (A), the tire and the film in it (B)."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from smart_tire.api.params import Params
from smart_tire.arrays import Array, ArrayLike
from smart_tire.errors import ParameterError
from smart_tire.estimation.film.calibration import FilmParams, read_params
from smart_tire.models import validation
from smart_tire.models.film.buckling_film import BucklingFilm, FILMS
from smart_tire.models.film.hysteresis import respond, TABLE_I, TABLE_I_GAIN
from smart_tire.models.tire import brush_tire
from smart_tire.models.tire.tread_film import crossing_voltage, RELEASES
from smart_tire.papers.film_measurement import FilmMeasurement, measure
from smart_tire.samples import WHEELS

__all__ = ['BrushTire', 'BucklingFilm', 'FilmMeasurement', 'FilmParams', 'FilmSensor', 'TreadFilm']


def table_i() -> FilmParams:
    """Return the film of Table I of paper A, with exact parameters."""
    return FilmParams(
        film=FILMS['25x3'], alpha_gain=TABLE_I.alpha * TABLE_I_GAIN,
        a_gain=TABLE_I.a * TABLE_I_GAIN, b_gain=TABLE_I.b * TABLE_I_GAIN, low_corner=0.0,
        drift=0.0, covariance=np.zeros((5, 5)), span=1.0, noise=0.0, model_error=0.0)


@dataclass(frozen=True, kw_only=True)
class FilmSensor:
    """
    Film with hysteresis, by default that of Table I of paper A; ``load`` reads a calibrated one.

    >>> sensor = FilmSensor()
    >>> print(sensor.charge([0.001, 0.002, 0.001]))
    [-2.05758178e-10 -4.37315277e-10 -2.58238810e-10]
    """

    params: FilmParams = field(default_factory=table_i)

    @classmethod
    def load(cls, path: str | Path) -> FilmSensor:
        """Return the film in a file of ``smart_tire identify film``, or raise ParameterError."""
        return cls(params=read_params(Path(path)))

    def charge(self, deflection: ArrayLike) -> Array:
        """
        Return the charge [C] (n,) for the deflections [m] (n,) of a fresh film, in sequence.

        Raises ParameterError for deflections out of range, or if the film has no geometry.
        """
        if self.params.film is None:
            raise ParameterError('this film was calibrated without its geometry: its deflection '
                                 'is unknown')
        return respond(self.params.film.normalized_charge(deflection), self.params.operator)

    def measure(self, time: ArrayLike, charge: ArrayLike, *, used: bool = False
                ) -> FilmMeasurement:
        """
        Return the deflections ``value`` and ``sigma`` (n,) [m] for a charge (n,) [C].

        ``time`` (n,) [s] increases. The film is flat and at rest at first; ``used`` if it was
        moved before, so that its state of hysteresis is unknown. NaN with an infinite sigma where
        the deflection is not observable. Raises ParameterError for invalid arguments.
        """
        return measure(np.asarray(time, dtype=float), np.asarray(charge, dtype=float),
                       self.params, used=used)


@dataclass(frozen=True, kw_only=True)
class BrushTire:
    """
    Brush model of a tire on one surface under constant load; the defaults are those of paper B.

    ``slip`` is the magnitude of the slip vector [-] in all methods. Arguments broadcast. Raises
    ParameterError unless stiffness and load are positive.

    >>> tire = BrushTire()
    >>> print(f'{tire.adhesion_ratio(0.13, 0.47):.3f} {tire.friction(0.818, 0.13):.2f}')
    0.818 0.47

    * ``stiffness``: N per unit slip, C_x
    * ``load``: N, F_z
    """

    stiffness: float = 52.7
    load: float = 26.7

    def __post_init__(self) -> None:
        validation.positive('stiffness', self.stiffness)
        validation.positive('load', self.load)

    def critical_slip(self, friction: ArrayLike) -> Array:
        """Return the slip [-] from which on the whole patch slides: ``3 mu F_z / C_x``, B(22)."""
        return brush_tire.critical_slip(friction, self.load, self.stiffness)

    def adhesion_ratio(self, slip: ArrayLike, friction: ArrayLike) -> Array:
        """Return the adhesion ratio L_a / L [-], 0 where the whole patch slides: B(22)."""
        return brush_tire.adhesion_ratio(slip, friction, self.load, self.stiffness)

    def friction(self, adhesion_ratio: ArrayLike, slip: ArrayLike) -> Array:
        """Return the friction coefficient [-] by the inverse of B(22); NaN where undetermined."""
        return brush_tire.friction_from_adhesion(adhesion_ratio, slip, self.load, self.stiffness)

    def force(self, s_x: ArrayLike, s_y: ArrayLike, friction: ArrayLike) -> tuple[Array, Array]:
        """Return the force of the ground on the robot, F_x and F_y [N], for a slip vector [-]."""
        return brush_tire.brush_force(s_x, s_y, friction, self.load, self.stiffness)


@dataclass(frozen=True, kw_only=True)
class TreadFilm:
    """
    Film in the tread of a rolling tire; the defaults are film 1 of paper B.

    Raises ParameterError if a length or ``bending_alpha`` is not positive, or for an unknown
    release.

    >>> film = TreadFilm()
    >>> print(film.voltage([0.0, 0.02, 0.046], slip=0.1, critical_slip=0.71).round(2))
    [ 0.96  1.23 -0.83]

    * ``length``: m, of the film
    * ``contact_length``: m, L of the patch
    * ``bending_peak``: V, output of the film when flat and without slip
    * ``bending_alpha``: 1/m, shape of entry and exit, B(14)
    * ``stretch_gain``: V/m, output per overlap integral of B(23)
    * ``release``: at the exit: 'fig8' (opposite peak) or 'state' (none)
    * ``recovery``: m of travel in which the opposite peak decays by e
    """

    length: float = 0.020
    contact_length: float = 0.046
    bending_peak: float = 0.83
    bending_alpha: float = 67.0
    stretch_gain: float = 307.5
    release: str = 'fig8'
    recovery: float = 0.005

    def __post_init__(self) -> None:
        for name in 'length', 'contact_length', 'bending_alpha', 'recovery':
            validation.positive(name, getattr(self, name))
        validation.one_of('release', self.release, RELEASES)

    @classmethod
    def of(cls, params: Params, wheel: str, film: int = 0) -> TreadFilm:
        """
        Return the film with index ``film`` (0: film 1) of a wheel, with the values in ``params``.

        Raises ParameterError if there is no such wheel or film.
        """
        robot = params.robot
        validation.one_of('wheel', wheel, WHEELS)
        validation.one_of('film', str(film), tuple(map(str, range(len(robot.film.centers)))))
        return cls(length=robot.film.length, contact_length=robot.tire.contact_length,
                   bending_peak=robot.film.bending(wheel)[film],
                   bending_alpha=robot.film.bending_alpha,
                   stretch_gain=robot.film.gains(wheel)[film], release=robot.film.release)

    def voltage(self, position: ArrayLike, *, slip: ArrayLike, critical_slip: ArrayLike,
                total_slip: ArrayLike | None = None) -> Array:
        """
        Return the output of the amplifier above rest [V] at the positions [m] (n,).

        ``position`` is the travel of the film's trailing edge past the leading edge of the patch:
        the film is fully inside from 0 to ``contact_length - length``. ``slip`` is the slip ratio
        of B(3), positive when driving; ``total_slip`` the magnitude of the slip vector, by
        default ``|slip|``. Arguments broadcast.
        """
        total: ArrayLike = np.abs(np.asarray(slip)) if total_slip is None else total_slip
        return crossing_voltage(
            position, slip=slip, total_slip=total,
            critical_slip=critical_slip, film_length=self.length,
            contact_length=self.contact_length, bending_peak=self.bending_peak,
            bending_alpha=self.bending_alpha, stretch_gain=self.stretch_gain,
            release=self.release, recovery=self.recovery)
