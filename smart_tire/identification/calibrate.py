# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Calibration of a robot from the bags of the calibration steps."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from smart_tire.analysis.figure import Figure
from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.bags import Bag, STANDARD_NAMES, TopicNames
from smart_tire.calibration.film_gains import identify_gains
from smart_tire.calibration.recording import CalibrationRecording
from smart_tire.calibration.sequence import (
    calibrate, Calibration, CONSTANT, Inputs, REST, STIFFNESS, STIFFNESS_SIGMA, STRAIGHT, TURNS)
from smart_tire.identification.figures import icr_figure, motor_figure, stiffness_figure
from smart_tire.identification.films import gain_parameters, read_crossings
from smart_tire.identification.robot import (
    ANY_REFERENCE, known, NO_REFERENCE, read_recording, TimeRange)
from smart_tire.identification.trial import read_recorded, refusals
from smart_tire.parameters import NODE_PARAMS, RobotParams, specs
from smart_tire.parameters.calibration_file import Identified, identified_text
from smart_tire.parameters.files import value_text
from smart_tire.uncertain import MAX_RELATIVE_SIGMA

MIXED = 'mixed'  # a recording with rest, straight starts and stops, and turns
PARTS = (REST, STRAIGHT, TURNS)  # of a mixed recording
TIRE_SAMPLES = 'tire_samples'
BY_MASS = (STIFFNESS, STIFFNESS_SIGMA, CONSTANT, f'{CONSTANT}_sigma')

Bags = Mapping[str, Sequence[Path]]  # step -> bags; MIXED: of all parts


@dataclass(frozen=True)
class CalibrationFile:
    """A calibration, and the parameter file with its values."""

    calibration: Calibration
    text: str


def calibrate_bags(bags: Bags, params: EstimatorParams, date: str, *, truth: bool = False,
                   names: TopicNames = STANDARD_NAMES, given: Collection[str] = tuple(specs(
                       RobotParams))) -> CalibrationFile:
    """
    Return the parameters identified from ``bags``, and the text of a file with them.

    ``params`` are the present values: the prior, and the value of what cannot be identified.
    ``date`` is written into the file. ``names`` are the topics with other names in the bags;
    pose references in the bags are used with ``truth`` only. Parameters that are not ``given`` are
    those of another robot. What makes the estimates of the recordings worse is refused. Raises
    BagError if a bag cannot be read, EstimatorError if it lacks IMU or wheels.
    """
    robot, reference = known(params.robot, given), ANY_REFERENCE if truth else NO_REFERENCE
    recordings = {path: read_recording(path, robot, TimeRange(), reference, duties=True,
                                       names=names)
                  for paths in bags.values() for path in paths}

    def of(step: str) -> list[CalibrationRecording]:
        return [recordings[path] for path in bags_of(bags, step)]

    # film gains only from turns: in starts and stops, the wheel angle between two samples is less
    # certain
    films = [path for path in bags_of(bags, TURNS) if has_films(path, names)]

    def gains(known: RobotParams) -> list[Identified]:
        found = gain_parameters(identify_gains(
            [read_crossings(film, known, TimeRange(), names) for film in films], known), known)
        return [item for item in found if _determined(item)]

    found = calibrate(Inputs(**{step: of(step) for step in (*PARTS, 'lifted')}), robot,
                      gains if films else None)
    if 'mass' not in given:
        for name in BY_MASS:
            found.refuse(name, 'in proportion to the mass, which is not given')
    moving = dict.fromkeys([*bags_of(bags, STRAIGHT), *bags_of(bags, TURNS)])
    for name, why in refusals(params.slip, found.found, [
            read_recorded(path, params.slip, reference, names) for path in moving]).items():
        found.refuse(name, why)
    return CalibrationFile(found, _text(found, bags, params, date))


def bags_of(bags: Bags, step: str) -> list[Path]:
    """Return the bags of a step, and the mixed ones if they contain it."""
    mixed = bags.get(MIXED, ()) if step in PARTS else ()
    return [*bags.get(step, ()), *mixed]


def has_films(path: Path, names: TopicNames = STANDARD_NAMES) -> bool:
    """Return whether a bag contains film samples."""
    with Bag(path, names) as bag:
        return bool(bag.match([TIRE_SAMPLES]))


def _determined(item: Identified) -> bool:
    """Return whether all values of a film parameter have a useful standard error."""
    if item.sigma is None or not isinstance(item.value, tuple):
        return True
    assert isinstance(item.sigma, tuple)
    return all(sigma <= MAX_RELATIVE_SIGMA * abs(value)
               for value, sigma in zip(item.value, item.sigma))


def _text(found: Calibration, bags: Bags, params: EstimatorParams, date: str) -> str:
    def source(step: str, note: str) -> str:
        recordings = 'from ' + ' and '.join(path.name for path in bags_of(bags, step))
        return ', '.join(filter(None, (date, recordings, note)))

    present = present_values(params)
    kept = [f'kept: {name}: {value_text(present[name])}  ({reason})'
            for name, reason in found.kept.items()]
    return identified_text(
        [f'Calibrated on {date} by smart_tire calibrate.', *kept],
        [replace(one, note=source(one.step, one.note)).rounded()
         for one in found.found.values()])


def present_values(params: EstimatorParams) -> dict[str, Any]:
    """Return all parameters of all nodes: the values in ``params``, otherwise the defaults."""
    values = {name: spec.default for cls in NODE_PARAMS.values()
              for name, spec in specs(cls).items()}
    for given in params.by_node().values():
        values.update(given)
    return values


def figures(found: Calibration) -> list[Figure | None]:
    """Return the figures in the order of ``FIGURES``, None for a fit that is missing."""
    return [None if found.stiffness is None else stiffness_figure(found.stiffness),
            None if found.motor is None else motor_figure(found.motor),
            None if found.icr is None else icr_figure(found.icr)]
