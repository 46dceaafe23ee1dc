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

"""Calibration of the motors from bags: torque constant, friction, inertia and feed-forward."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from smart_tire.analysis.calibrate_robot import (
    check_all_measured, NO_REFERENCE, read_recording, TimeRange)
from smart_tire.bags import STANDARD_NAMES, TopicNames
from smart_tire.calibration import motor
from smart_tire.calibration.motor import MotorFit
from smart_tire.parameters import RobotParams


def identify_motor(bags: Sequence[Path], lifted: Sequence[Path], robot: RobotParams,
                   time_range: TimeRange, names: TopicNames = STANDARD_NAMES) -> MotorFit:
    """
    Return the motor constants from ``bags`` on the ground and others with ``lifted`` wheels.

    Raises BagError if a bag cannot be read, EstimatorError if none of them is observable.
    """
    check_all_measured(robot, 'motor')
    grounds, off_ground = ([
        read_recording(bag, robot, time_range, NO_REFERENCE, duties=True, names=names)
        for bag in group] for group in (bags, lifted))
    return motor.identify_motor(grounds, off_ground, robot)
