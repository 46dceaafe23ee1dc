# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Parameters of a buckling film as a sensor, and of its simulation (``config/film.yaml``)."""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.parameters.hardware import DriverParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.spec import inlined, param, reliability


@dataclass(frozen=True, kw_only=True)
class FilmDriverParams(DriverParams):
    """Charge amplifier of a film, with its converter."""

    port: str = param('/dev/ttyUSB2', '-', 'serial port of the charge amplifier')
    latency: float = param(
        0.0, 's', 'constant part of the delay, which is not observable', (-1.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class FilmSensorParams:
    """Deflection of a film from its charge."""

    calibration_file: str = param('', '-', 'file of "smart_tire identify film"; must be given')
    reorder_window: float = param(
        0.06, 's', 'span of message timestamps that are sorted before use', (0.0, 1.0))
    zero_time: float = param(
        0.5, 's', 'rest of the flat film at the start, which is averaged', (0.05, 60.0))
    fresh: bool = param(
        False, '-', 'the film has never been deflected: its state at the start is known')
    bandwidth: float = param(
        20.0, 'Hz', 'highest frequency of the motion; the charge is averaged over 1/16 of its '
        'period', (0.1, 1e4))
    pyroelectric_coefficient: float = param(
        -27e-6, 'C/(m2 K)', 'charge per area and temperature of PVDF, -25e-6 to -30e-6; the sign '
        'is that of the electrodes', (-1e-3, 1e-3))
    pyroelectric_tolerance: float = param(
        0.15, '-', 'relative standard deviation of pyroelectric_coefficient', (0.0, 1.0))
    temperature_rate: float = param(
        0.02, 'K/s', 'standard deviation of the rate of the temperature while film_temperature '
        'is not received', (0.0, 10.0))
    temperature_sigma: float = param(
        0.1, 'K', 'standard deviation of film_temperature if its message has none', (0.0, 100.0))
    reliability: str = reliability()
    robot: RobotParams = inlined(RobotParams)


@dataclass(frozen=True, kw_only=True)
class FilmSimulatorParams:
    """Simulated film with charge amplifier, in motion between flat and ``stroke``."""

    port: str = param('simulated:film', '-', 'name of the simulated port')
    seed: int = param(1, '-', 'of the noise', (0, 2**31 - 1))
    rate: float = param(500.0, 'Hz', 'samples of the charge', (10.0, 2000.0))
    length: float = param(0.025, 'm', 'of the film between its clamps', (1e-3, 1.0))
    stroke: float = param(0.012, 'm', 'largest deflection', (0.0, 0.8))
    frequency: float = param(5.0, 'Hz', 'of the deflection', (0.0, 50.0))
    rest: float = param(2.0, 's', 'at the start, with the film flat', (0.0, 3600.0))
    warming: float = param(
        0.0, 'K', 'steps of the temperature, up and down every 10 s', (-50.0, 50.0))
    pyroelectric_coefficient: float = param(
        -27e-6, 'C/(m2 K)', 'of the simulated film', (-1e-3, 1e-3))
    loss: float = param(0.002, '-', 'share of frames that are lost', (0.0, 1.0))
    robot: RobotParams = inlined(RobotParams)
