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
Connections of the estimators: which streams each of them processes and which it publishes.

Nodes, offline analysis, calibration and tests all use this table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from smart_tire.samples import (
    FilmCharge, FilmDeflection, FilmTemperature, Friction, GroundState, Icr, ImuSample, Odometry,
    TireSample, WheelSample, WheelSlip)

Topics = Mapping[type[Any], str]  # class of the samples -> topic
GROUND_STATE_PERIOD_NS = 500_000_000  # of message time: at multiples of it


@dataclass(frozen=True)
class Streams:
    """Streams of one estimator."""

    inputs: Topics
    outputs: Topics


FRICTION = Streams(
    inputs={ImuSample: 'imu/data', WheelSample: 'wheel_states', TireSample: 'tire_samples',
            Odometry: 'odom'},  # odometry in place of the IMU
    outputs={Friction: 'tire_friction', GroundState: 'ground_state'})
SLIP = Streams(
    inputs={ImuSample: 'imu/data', WheelSample: 'wheel_states', GroundState: 'ground_state'},
    outputs={Odometry: 'odom', WheelSlip: 'wheel_slip', Icr: 'icr'})
FILM = Streams(
    inputs={FilmCharge: 'film_charge', FilmTemperature: 'film_temperature'},
    outputs={FilmDeflection: 'film_deflection'})

# samples of these topics hold until the next one: topic -> period [ns]
HOLDING = {'ground_state': GROUND_STATE_PERIOD_NS}
ESTIMATES = (*SLIP.outputs.values(), *FRICTION.outputs.values())


def sensor_inputs(*estimators: Streams) -> tuple[str, ...]:
    """Return the topics that ``estimators`` process and no estimator publishes."""
    topics = (topic for streams in estimators for topic in streams.inputs.values())
    return tuple(dict.fromkeys(topic for topic in topics if topic not in ESTIMATES))


INPUTS = sensor_inputs(SLIP, FRICTION)
REPLAYED = (*INPUTS, *FILM.inputs.values())  # of a bag, by default
