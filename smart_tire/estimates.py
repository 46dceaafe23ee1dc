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
from typing import Any, TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from smart_tire.arrays import Array, Instants
from smart_tire.samples import FRICTION_QUANTITIES, GROUND_ESTIMATES, WHEELS

if TYPE_CHECKING:
    import pandas as pd

PLANAR_POSE = ('x', 'y', 'yaw')
PLANAR_TWIST = ('v_x', 'v_y', 'yaw_rate')


class Tabular(ABC):
    """Arrays with one row per timestamp."""

    stamp_ns: Instants

    def __len__(self) -> int:
        return len(self.stamp_ns)

    @abstractmethod
    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""

    def to_pandas(self) -> pd.DataFrame:
        """
        Return a data frame with the index ``stamp_ns`` [ns]; units are those of the arrays.

        Raises ModuleNotFoundError if pandas is not installed.
        """
        return data_frame(self.stamp_ns, self.columns())


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


@dataclass(frozen=True, eq=False)
class PoseEstimate(Tabular):
    """Planar pose of ``base_link`` in ``odom`` and its twist in ``base_link``."""

    stamp_ns: Instants   #: (n,) ns, increasing
    pose: Array          #: (n, 3) m, m, rad: x, y, yaw; yaw is continuous
    twist: Array         #: (n, 3) m/s, m/s, rad/s: v_x, v_y, yaw rate
    covariance: Array    #: (n, 3, 3) of x, y, yaw
    twist_sigma: Array   #: (n, 3) standard deviation of the twist

    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""
        sigma = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        return {**dict(zip(PLANAR_POSE, self.pose.T)), **dict(zip(PLANAR_TWIST, self.twist.T)),
                **{f'{name}_sigma': row for name, row in zip(PLANAR_POSE, sigma.T)},
                **{f'{name}_sigma': row for name, row in zip(PLANAR_TWIST, self.twist_sigma.T)}}


@dataclass(frozen=True, eq=False)
class SlipEstimate(Tabular):
    """Longitudinal slip of the four wheels, positive when driving, in both directions."""

    stamp_ns: Instants  #: (n,) ns, increasing
    ratio: Array        #: (n, 4) -, slip ratio of B(3) in [-1, 1]; NaN at standstill
    sigma: Array        #: (n, 4) -, standard deviation of the slip ratio
    velocity: Array     #: (n, 4) m/s, slip velocity r*omega - v_x, never clipped

    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""
        return {**by_wheel('ratio', self.ratio, WHEELS), **by_wheel('sigma', self.sigma, WHEELS),
                **by_wheel('velocity', self.velocity, WHEELS)}


@dataclass(frozen=True, eq=False)
class RotationCenter(Tabular):
    """Instantaneous center of rotation in ``base_link``, while the robot turns."""

    stamp_ns: Instants  #: (n,) ns, increasing
    position: Array     #: (n, 2) m: x (S of paper B), y

    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""
        return {'x': self.position[:, 0], 'y': self.position[:, 1]}


@dataclass(frozen=True, eq=False)
class Quantity:
    """One estimated quantity of n timestamps."""

    value: Array  #: (n,)
    sigma: Array  #: (n,) standard deviation


@dataclass(frozen=True, eq=False)
class GroundEstimate(Tabular):
    """
    Tire on the present ground, and properties of the robot that show with it.

    Empty if neither films nor motor torques show the ground.
    """

    stamp_ns: Instants                 #: (n,) ns, increasing
    stiffness: Quantity                #: N, C_x per wheel
    friction_coefficient: Quantity     #: -, mu
    rolling_resistance: Quantity       #: -, over the load
    lateral_share: Quantity            #: -, of it: 0 along the heading, 1 along the velocity
    lateral_stiffness_ratio: Quantity  #: -, C_y / C_x
    center_of_mass_x: Quantity         #: m, in ``base_link``
    center_of_mass_y: Quantity         #: m, in ``base_link``
    imu_x: Quantity                    #: m, position of the IMU in ``base_link``
    imu_y: Quantity                    #: m, position of the IMU in ``base_link``
    motor_friction: Quantity           #: -, of gears and axles, over that of the parameters
    torque_scale: Quantity             #: -, true over measured motor torque

    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""
        return quantity_columns(self, GROUND_ESTIMATES)


@dataclass(frozen=True, eq=False)
class FrictionEstimate(Tabular):
    """Estimates of n patch crossings of all instrumented wheels, in order of time."""

    stamp_ns: Instants  #: (n,) ns; the center of the films was at the patch center
    wheel: npt.NDArray[np.str_]            #: (n,) name of the wheel
    friction_coefficient: Quantity         #: -, from this and earlier revolutions
    friction_coefficient_single: Quantity  #: -, from this revolution alone
    adhesion_ratio: Quantity               #: -, L_a / L
    adhesion_length: Quantity              #: m, L_a
    stretch_voltage: Quantity              #: V, q_sm of film 1; NaN when braking
    peak_interval: Quantity                #: s, Delta t_a of film 1; NaN when braking
    slip: Quantity                         #: -, slip ratio that was used
    film_slip: Quantity                    #: -, slip ratio from the films alone
    total_slip: Quantity                   #: -, magnitude of the slip vector
    normal_load: Quantity                  #: N, F_z
    stiffness: Quantity                    #: N, C_x
    critical_slip: Quantity                #: -, 3 mu F_z / C_x
    traction_force: Quantity               #: N, on the robot, positive forward

    def of(self, wheel: str) -> FrictionEstimate:
        """Return the crossings of one wheel."""
        rows = self.wheel == wheel
        chosen = (getattr(self, name) for name in FRICTION_QUANTITIES)
        return FrictionEstimate(self.stamp_ns[rows], self.wheel[rows], *(
            Quantity(one.value[rows], one.sigma[rows]) for one in chosen))

    def columns(self) -> dict[str, Any]:
        """Return name -> array (n,) of all columns, without the timestamps."""
        return {'wheel': self.wheel, **quantity_columns(self, FRICTION_QUANTITIES)}


@dataclass(frozen=True, eq=False)
class Estimates:
    """All estimates of a recording."""

    pose: PoseEstimate         #: 125 Hz
    slip: SlipEstimate         #: 125 Hz
    center: RotationCenter     #: while the yaw rate exceeds 0.05 rad/s
    ground: GroundEstimate     #: 2 Hz
    friction: FrictionEstimate  #: one row per patch crossing


@dataclass(frozen=True, eq=False)
class Truth:
    """Ground truth of a recording, with standard deviations of 0; empty where not recorded."""

    pose: PoseEstimate
    slip: SlipEstimate
    friction: FrictionEstimate


def quantity_columns(record: object, names: tuple[str, ...]) -> dict[str, Any]:
    """Return the columns ``<name>`` and ``<name>_sigma`` of the quantities in ``record``."""
    columns: dict[str, Any] = {}
    for name in names:
        one: Quantity = getattr(record, name)
        columns[name], columns[f'{name}_sigma'] = one.value, one.sigma
    return columns
