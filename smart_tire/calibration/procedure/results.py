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

"""Result of a calibration: identified values, and why the others keep their value."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from smart_tire.calibration.robot.motor import MotorFit
from smart_tire.calibration.robot.turning import IcrFit
from smart_tire.calibration.tire.stiffness import StiffnessFit
from smart_tire.errors import EstimatorError
from smart_tire.parameters import RobotParams, specs
from smart_tire.parameters.calibration_file import Value

Fit = TypeVar('Fit')


@dataclass(frozen=True)
class Finding:
    """An identified parameter."""

    name: str            # as in the parameter files
    value: Value
    sigma: Value | None  # standard error; None for a value that is one itself
    step: str            # of the sequence, whose recordings it comes from
    note: str = ''


@dataclass
class Calibration:
    """Identified values in the order of identification; reasons of the values that are kept."""

    robot: RobotParams
    findings: list[Finding] = field(default_factory=list)
    kept: dict[str, str] = field(default_factory=dict)  # parameter -> reason
    notes: list[str] = field(default_factory=list)
    stiffness: StiffnessFit | None = None  # the fits, for figures
    motor: MotorFit | None = None
    icr: IcrFit | None = None

    def attempt(self, names: Sequence[str], fit: Callable[[], Fit]) -> Fit | None:
        """Return what ``fit`` returns; if it fails, keep the parameters ``names``."""
        try:
            return fit()
        except EstimatorError as error:
            for name in names:
                self.keep(name, str(error))
            return None

    def keep(self, name: str, reason: str) -> None:
        """Keep the value of a parameter, unless it has been identified."""
        if self.get(name) is None:
            self.kept.setdefault(name, reason)

    def add(self, finding: Finding) -> None:
        """Add a value, in place of an earlier one; all later identifications use it."""
        self.findings = [one for one in self.findings if one.name != finding.name]
        self.findings.append(finding)
        self.kept.pop(finding.name, None)
        if finding.name in specs(RobotParams):
            self.robot = with_value(self.robot, finding.name, finding.value)

    def get(self, name: str) -> Finding | None:
        """Return the identified value of a parameter, None if there is none."""
        return next((one for one in self.findings if one.name == name), None)


def with_value(robot: RobotParams, name: str, value: Any) -> RobotParams:
    """Return ``robot`` with another value of the parameter ``name``."""
    group, _, own = name.rpartition('.')
    if not group:
        return replace(robot, **{own: value})
    return replace(robot, **{group: replace(getattr(robot, group), **{own: value})})
