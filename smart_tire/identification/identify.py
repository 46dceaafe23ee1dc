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
Identification of parameters from bags, by kind: what is printed, written and drawn.

``smart_tire identify KIND`` and ``smart_tire calibrate --only KIND`` both call ``identify``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from smart_tire.analysis.figure import Figure
from smart_tire.bags import STANDARD_NAMES, TopicNames
from smart_tire.calibration import geometry, turning
from smart_tire.calibration.film_gains import identify_gains
from smart_tire.calibration.ground_fit import fit_ground
from smart_tire.calibration.motor import identify_motor
from smart_tire.calibration.recording import CalibrationRecording
from smart_tire.calibration.results import Found
from smart_tire.calibration.stiffness import stiffness_of
from smart_tire.identification.figures import (
    gains_figure, geometry_figure, icr_figure, motor_figure, stiffness_figure)
from smart_tire.identification.films import gain_parameters, gain_report, read_crossings
from smart_tire.identification.robot import (
    check_all_measured, NO_REFERENCE, read_recording, TimeRange)
from smart_tire.parameters import RobotParams
from smart_tire.parameters.calibration_file import Identified


@dataclass(frozen=True)
class Source:
    """Bags of one robot, and how they are read."""

    bags: Sequence[Path]
    robot: RobotParams                   # as it is known
    time_range: TimeRange = TimeRange()  # of each bag
    reference: str = NO_REFERENCE        # topic of reference poses, see ``read_recording``
    names: TopicNames = STANDARD_NAMES   # topics with other names in the bags
    lifted: Sequence[Path] = ()          # bags with all wheels off the ground

    def recordings(self, bags: Sequence[Path] | None = None) -> list[CalibrationRecording]:
        """Return ``bags``, by default those on the ground, as arrays."""
        return [read_recording(bag, self.robot, self.time_range, self.reference, duties=True,
                               names=self.names) for bag in (self.bags if bags is None else bags)]


@dataclass(frozen=True)
class Identification:
    """What a kind has identified, and its figure."""

    found: Found                  # of the report
    parameters: list[Identified]  # of the parameter file
    figure: Figure | None


def identify(kind: str, source: Source) -> Identification:
    """
    Return what the bags show of the parameters of a ``kind``.

    Raises BagError if a bag cannot be read, EstimatorError with the reason if nothing is
    observable.
    """
    return KINDS[kind](source)


def _geometry(source: Source) -> Identification:
    found = geometry.combine([geometry.identify_geometry(one, source.robot)
                              for one in source.recordings()])
    return Identification(found, found.parameters(source.robot), geometry_figure(found))


def _icr(source: Source) -> Identification:
    fit = turning.combine([turning.identify_icr(one, source.robot)
                           for one in source.recordings()])
    return Identification(fit.report(), fit.parameters(source.robot), icr_figure(fit))


def _motor(source: Source) -> Identification:
    check_all_measured(source.robot, 'motor')
    found = identify_motor(source.recordings(), source.recordings(source.lifted), source.robot)
    return Identification(found, found.parameters(), motor_figure(found))


def _stiffness(source: Source) -> Identification:
    check_all_measured(source.robot, 'stiffness')
    fit = stiffness_of(fit_ground(source.recordings(), source.robot, torques=False))
    return Identification(fit.report(), fit.parameters(), stiffness_figure(fit))


def _gains(source: Source) -> Identification:
    fit = identify_gains([read_crossings(bag, source.robot, source.time_range, source.names)
                          for bag in source.bags], source.robot)
    return Identification(gain_report(fit, [bag.name for bag in source.bags]),
                          gain_parameters(fit, source.robot), gains_figure(fit))


KINDS: Mapping[str, Callable[[Source], Identification]] = {
    'geometry': _geometry, 'icr': _icr, 'motor': _motor, 'stiffness': _stiffness,
    'gains': _gains}
