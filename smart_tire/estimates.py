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
Estimates as arrays, one row per timestamp.

Axes are those of REP-103, wheels are in the order of ``WHEELS``: front left, front right, rear
left, rear right. A value that is not observable is NaN; its standard deviation is infinite (of a
slip ratio at standstill: 1).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any, TYPE_CHECKING, TypeVar

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, Instants
from smart_tire.errors import ParameterError
from smart_tire.samples import FRICTION_QUANTITIES, GROUND_ESTIMATES, NS_PER_S, WHEELS

if TYPE_CHECKING:
    import pandas as pd

SIDES = ('left', 'right')
PLANAR_POSE = ('x', 'y', 'yaw')
PLANAR_TWIST = ('v_x', 'v_y', 'yaw_rate')
Own = TypeVar('Own', bound='Series')


class Tabular(ABC):
    """Arrays with one row per timestamp."""

    stamp_ns: Instants

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @abstractmethod
    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""

    def to_pandas(self, origin_ns: int | None = None) -> pd.DataFrame:
        """
        Return a data frame with the index ``stamp_ns`` [ns]; units are those of the arrays.

        With ``origin_ns`` [ns], the first column is the ``time`` [s] after it. Raises
        ModuleNotFoundError if pandas is not installed.
        """
        time = {} if origin_ns is None else {'time': (self.stamp_ns - origin_ns) / NS_PER_S}
        return data_frame(self.stamp_ns, time | self.columns())

    def __repr__(self) -> str:
        names = ', '.join(name for name in vars(self) if not name.endswith('_ns'))
        span = np.ptp(self.stamp_ns) / NS_PER_S if len(self) else 0.0
        return f'{type(self).__name__}({len(self)} rows in {span:.1f} s: {names})'


class Tables(ABC):
    """Several tables, by name."""

    @abstractmethod
    def tables(self) -> dict[str, Tabular]:
        """Return name -> table."""

    def to_pandas(self, origin_ns: int | None = None) -> dict[str, pd.DataFrame]:
        """
        Return name -> data frame, whose first column is the ``time`` [s] after ``origin_ns`` [ns].

        By default this is the first timestamp of all. Raises ModuleNotFoundError if pandas is not
        installed.
        """
        tables = self.tables()
        if origin_ns is None:
            origin_ns = self.origin_ns
        return {name: table.to_pandas(origin_ns) for name, table in tables.items()}

    @property
    def origin_ns(self) -> int:
        """First timestamp [ns] of all tables; 0 without any row."""
        stamps = [int(one.stamp_ns.min()) for one in self.tables().values() if len(one)]
        return min(stamps, default=0)

    def __repr__(self) -> str:
        counts = ', '.join(f'{name}: {len(one)}' for name, one in self.tables().items())
        return f'{type(self).__name__}(rows of {counts})'


def at(wanted_ns: Instants, stamp_ns: Instants, values: Array, max_gap: float = 0.5) -> Array:
    """
    Return ``values`` (n, ...), linearly interpolated at ``wanted_ns``.

    NaN outside the timestamps, in gaps longer than ``max_gap`` [s], and next to a NaN.
    """
    result = np.full((len(wanted_ns), *values.shape[1:]), math.nan)
    if len(stamp_ns) < 2:
        return result
    right = np.clip(np.searchsorted(stamp_ns, wanted_ns), 1, len(stamp_ns) - 1)
    left = right - 1
    gap = stamp_ns[right] - stamp_ns[left]
    inside = ((stamp_ns[left] <= wanted_ns) & (wanted_ns <= stamp_ns[right])
              & (gap <= max_gap * NS_PER_S))
    share = ((wanted_ns - stamp_ns[left]) / gap).reshape(-1, *(1,) * (values.ndim - 1))
    between = (1.0 - share) * values[left] + share * values[right]
    result[inside] = between[inside]
    return result


class Series(Tabular):
    """Quantities that change continuously between timestamps."""

    def at(self: Own, stamp_ns: Instants) -> Own:
        """
        Return the same at other instants (m,) [ns], linearly interpolated.

        NaN outside the timestamps, in gaps longer than 0.5 s, and next to a NaN.
        """
        make: Any = type(self)
        return make(**{name: stamp_ns if name == 'stamp_ns' else at(
            stamp_ns, self.stamp_ns, values) for name, values in vars(self).items()})


def check_wheel(name: str) -> None:
    """Raise ParameterError if no wheel has this name."""
    if name not in WHEELS:
        raise ParameterError(f'wheel is {name!r}, expected one of {", ".join(WHEELS)}')


def data_frame(stamp_ns: Instants, columns: Mapping[str, Any]) -> pd.DataFrame:
    """Return a data frame of ``columns`` (n,) at ``stamp_ns`` (n,)."""
    try:
        import pandas as pd
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            'to_pandas needs pandas, which is not installed (pip install smart_tire[pandas])',
            name='pandas') from error
    return pd.DataFrame(dict(columns), index=pd.Index(stamp_ns, name='stamp_ns'))


def by_wheel(name: str, values: Any, wheels: tuple[str, ...]) -> dict[str, Any]:
    """Return a column per wheel of ``values`` (n, wheels), named ``<name>.<wheel>``."""
    return {f'{name}.{wheel}': values[:, i] for i, wheel in enumerate(wheels)}


@dataclass(frozen=True, eq=False, repr=False)
class PoseEstimate(Series):
    """
    Planar pose of ``base_link`` in ``odom`` and its twist in ``base_link``.

    * ``stamp_ns``: (n,) ns, increasing
    * ``pose``: (n, 3) m, m, rad: x, y, yaw; yaw is continuous
    * ``twist``: (n, 3) m/s, m/s, rad/s: v_x, v_y, yaw rate
    * ``covariance``: (n, 3, 3) of x, y, yaw
    * ``twist_sigma``: (n, 3) standard deviation of the twist
    """

    stamp_ns: Instants
    pose: Array
    twist: Array
    covariance: Array
    twist_sigma: Array

    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""
        sigma = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        return {**dict(zip(PLANAR_POSE, self.pose.T)), **dict(zip(PLANAR_TWIST, self.twist.T)),
                **{f'{name}_sigma': row for name, row in zip(PLANAR_POSE, sigma.T)},
                **{f'{name}_sigma': row for name, row in zip(PLANAR_TWIST, self.twist_sigma.T)}}


@dataclass(frozen=True, eq=False, repr=False)
class SlipEstimate(Series):
    """
    Longitudinal slip of the four wheels, positive when driving, in both directions.

    * ``stamp_ns``: (n,) ns, increasing
    * ``ratio``: (n, 4) -, slip ratio of B(3) in [-1, 1]; NaN at standstill
    * ``sigma``: (n, 4) -, standard deviation of the slip ratio
    * ``velocity``: (n, 4) m/s, slip velocity r*omega - v_x, never clipped
    """

    stamp_ns: Instants
    ratio: Array
    sigma: Array
    velocity: Array

    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""
        return {**by_wheel('ratio', self.ratio, WHEELS), **by_wheel('sigma', self.sigma, WHEELS),
                **by_wheel('velocity', self.velocity, WHEELS)}


@dataclass(frozen=True, eq=False, repr=False)
class RotationCenter(Series):
    """
    Instantaneous center of rotation in ``base_link``, while the robot turns.

    * ``stamp_ns``: (n,) ns, increasing
    * ``position``: (n, 2) m: x (S of paper B), y
    """

    stamp_ns: Instants
    position: Array

    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""
        return {'x': self.position[:, 0], 'y': self.position[:, 1]}


@dataclass(frozen=True, eq=False, repr=False)
class Quantity:
    """
    One estimated quantity of n timestamps.

    * ``value``: (n,)
    * ``sigma``: (n,) standard deviation
    """

    value: Array
    sigma: Array

    def __repr__(self) -> str:
        return f'Quantity({np.isfinite(self.value).sum()} known of {len(self.value)})'


@dataclass(frozen=True, eq=False, repr=False)
class GroundEstimate(Tabular):
    """
    Tire on the present ground, and properties of the robot that show with it.

    Empty if neither films nor motor torques show the ground.

    * ``stamp_ns``: (n,) ns, increasing
    * ``stiffness``: N, C_x per wheel
    * ``friction_coefficient``: -, mu
    * ``rolling_resistance``: -, over the load
    * ``lateral_share``: -, of it: 0 along the heading, 1 along the velocity
    * ``lateral_stiffness_ratio``: -, C_y / C_x
    * ``center_of_mass_x``: m, in ``base_link``
    * ``center_of_mass_y``: m, in ``base_link``
    * ``imu_x``: m, position of the IMU in ``base_link``
    * ``imu_y``: m, position of the IMU in ``base_link``
    * ``motor_friction``: -, of gears and axles, over that of the parameters
    * ``torque_scale``: -, true over measured motor torque
    * ``friction_common_sigma``: (n,) -, relative standard deviation of mu by errors that all
      estimates of the robot share; infinite: unknown
    * ``change_age``: (n, 2) s, since the ground under the left and right wheels changed; infinite:
      not in the window
    """

    stamp_ns: Instants
    stiffness: Quantity
    friction_coefficient: Quantity
    rolling_resistance: Quantity
    lateral_share: Quantity
    lateral_stiffness_ratio: Quantity
    center_of_mass_x: Quantity
    center_of_mass_y: Quantity
    imu_x: Quantity
    imu_y: Quantity
    motor_friction: Quantity
    torque_scale: Quantity
    friction_common_sigma: Array
    change_age: Array

    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""
        return {**quantity_columns(self, GROUND_ESTIMATES),
                'friction_common_sigma': self.friction_common_sigma,
                **by_wheel('change_age', self.change_age, SIDES)}


@dataclass(frozen=True, eq=False, repr=False)
class FrictionEstimate(Tabular):
    """
    Estimates of n patch crossings of all instrumented wheels, in order of time.

    * ``stamp_ns``: (n,) ns; the center of the films was at the patch center
    * ``wheel``: (n,) name of the wheel
    * ``friction_coefficient``: -, from this and earlier revolutions
    * ``friction_coefficient_single``: -, from this revolution alone
    * ``adhesion_ratio``: -, L_a / L
    * ``adhesion_length``: m, L_a
    * ``stretch_voltage``: V, q_sm of film 1; NaN when braking
    * ``peak_interval``: s, Delta t_a of film 1; NaN when braking
    * ``slip``: -, slip ratio that was used
    * ``film_slip``: -, slip ratio from the films alone
    * ``total_slip``: -, magnitude of the slip vector
    * ``normal_load``: N, F_z
    * ``stiffness``: N, C_x
    * ``critical_slip``: -, 3 mu F_z / C_x
    * ``traction_force``: N, on the robot, positive forward
    """

    stamp_ns: Instants
    wheel: npt.NDArray[np.str_]
    friction_coefficient: Quantity
    friction_coefficient_single: Quantity
    adhesion_ratio: Quantity
    adhesion_length: Quantity
    stretch_voltage: Quantity
    peak_interval: Quantity
    slip: Quantity
    film_slip: Quantity
    total_slip: Quantity
    normal_load: Quantity
    stiffness: Quantity
    critical_slip: Quantity
    traction_force: Quantity

    def of(self, wheel: str) -> FrictionEstimate:
        """Return the crossings of one wheel; raise ParameterError if no wheel has this name."""
        check_wheel(wheel)
        rows = self.wheel == wheel
        chosen = (getattr(self, name) for name in FRICTION_QUANTITIES)
        return FrictionEstimate(self.stamp_ns[rows], self.wheel[rows], *(
            Quantity(one.value[rows], one.sigma[rows]) for one in chosen))

    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""
        return {'wheel': self.wheel, **quantity_columns(self, FRICTION_QUANTITIES)}


@dataclass(frozen=True, eq=False, repr=False)
class Estimates(Tables):
    """
    All estimates of a recording.

    * ``pose``: 125 Hz
    * ``slip``: 125 Hz
    * ``center``: while the yaw rate exceeds 0.05 rad/s
    * ``ground``: 2 Hz
    * ``friction``: one row per patch crossing
    """

    pose: PoseEstimate
    slip: SlipEstimate
    center: RotationCenter
    ground: GroundEstimate
    friction: FrictionEstimate

    def tables(self) -> dict[str, Tabular]:
        """Return pose, slip, center, ground and friction by name."""
        return dict(vars(self))


@dataclass(frozen=True, eq=False, repr=False)
class Truth(Tables):
    """Ground truth of a recording, with standard deviations of 0; empty where not recorded."""

    pose: PoseEstimate
    slip: SlipEstimate
    friction: FrictionEstimate

    def tables(self) -> dict[str, Tabular]:
        """Return pose, slip and friction by name."""
        return dict(vars(self))


def quantity_columns(record: object, names: tuple[str, ...]) -> dict[str, Any]:
    """Return the columns ``<name>`` and ``<name>_sigma`` of the quantities in ``record``."""
    columns: dict[str, Any] = {}
    for name in names:
        one: Quantity = getattr(record, name)
        columns[name], columns[f'{name}_sigma'] = one.value, one.sigma
    return columns
