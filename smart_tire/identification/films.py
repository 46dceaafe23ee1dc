# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Crossings of films from bags, and the film calibration as report and as parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from smart_tire.analysis.pipeline import estimates_of, forwarded, SmoothedSlip
from smart_tire.bags import Bag, STANDARD_NAMES, TopicNames
from smart_tire.calibration.film_crossings import CrossingCollector, CrossingWithSlip
from smart_tire.calibration.film_gains import GainFit
from smart_tire.calibration.results import Found
from smart_tire.errors import EstimatorError
from smart_tire.estimation.friction.estimator import FrictionEstimator
from smart_tire.estimation.streams import INPUTS
from smart_tire.identification.robot import TimeRange
from smart_tire.parameters import FrictionEstimatorParams, RobotParams, SlipEstimatorParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.samples import ImuSample, NS_PER_S, Sample, TireSample, WheelSample, WheelSlip
from smart_tire.uncertain import Uncertain


def read_crossings(path: Path, robot: RobotParams, time_range: TimeRange,
                   names: TopicNames = STANDARD_NAMES) -> list[CrossingWithSlip]:
    """Return the crossings in a bag with their smoothed slip, estimated without the films."""
    plain = replace(robot, film=replace(robot.film, wheels=()))
    ground = FrictionEstimator(FrictionEstimatorParams(robot=plain))  # from motor torques
    collector = CrossingCollector(robot, FrictionEstimatorParams(robot=robot).reorder_window)
    with closing(SmoothedSlip(SlipEstimatorParams(robot=plain))) as slip:
        for sample in _inputs(Bag(path, names, robot.joints), time_range):
            if isinstance(sample, (ImuSample, WheelSample)):
                for item in forwarded(ground, sample):
                    estimates_of(slip, item)
            if isinstance(sample, (TireSample, WheelSample)):
                collector.update(sample)
        collector.finish()
        known = list(collector.with_slip(
            estimate for estimates in slip.smoothed() for estimate in estimates
            if isinstance(estimate, WheelSlip)))
    if not collector.tire_samples:
        raise EstimatorError(f'{path}: no tire_samples of {", ".join(robot.film.wheels)}')
    if not known:
        raise EstimatorError(f'{path}: no film crossing was detected: the wheels must turn for '
                             'several revolutions')
    return known


def _inputs(opened: Bag, time_range: TimeRange) -> Iterator[Sample]:
    """Yield the inputs within ``time_range``; EstimatorError if the bag lacks an input."""
    with opened as bag:
        available = bag.match(INPUTS)
        missing = ', '.join(name for name in INPUTS if name not in available)
        if missing:
            raise EstimatorError(f'{bag.path}: has no {missing}, expected {", ".join(INPUTS)}')
        first_ns: int | None = None
        for _, _, sample in bag.samples(INPUTS):
            first_ns = sample.stamp_ns if first_ns is None else first_ns
            if time_range.since <= (sample.stamp_ns - first_ns) / NS_PER_S <= time_range.until:
                yield sample


def gain_report(fit: GainFit, bags: Sequence[str]) -> Found:
    """Return what is printed of the calibration from ``bags``."""
    found = Found(refused=fit.refused, notes=[
        f'gains from {fit.informative} of {fit.crossings} crossings in {fit.segments} '
        f'constant-slip segments; residual scatter {fit.excess ** 0.5:.2g} times the expected'])
    for film in fit.films:
        name = f'film {film.film + 1}, {film.wheel}'
        if film.gain is not None and film.per_slip is not None:
            found.add(f'gain of {name}', film.gain, 'V/m', f'{len(film.slip)} crossings')
            found.add('', film.per_slip, 'V', 'per unit slip, patch fully adhering')
        found.add(f'bending of {name}', film.bending, 'V', 'peak')
    if fit.length is not None:
        found.add('contact length', fit.length, 'm', 'for the given wheel_radius')
    for number, spacing in sorted(fit.places.items()):
        found.add(f'spacing, film 1 to {number + 1}', spacing, 'm', 'between film centers')
    for (run, wheel), angle in fit.angles.items():
        found.add(f'angle of film 1, {wheel}', angle, 'rad', 'wheel_states.position at the patch '
                  'center' + (f', {bags[run]}' if len(bags) > 1 else ''))
    return found


def gain_parameters(found: GainFit, given: RobotParams) -> list[Identified]:
    """Return the entries of a parameter file; films without result keep the ``given`` values."""
    items = _film_lists(found, given)
    if found.length is not None:
        items.append(Identified('tire.contact_length', found.length.value, found.length.sigma))
    if found.places.keys() == set(range(1, given.film.count)) and found.places:
        if not given.film.positions:
            items.append(Identified('film.spacing', found.places[1].value, found.places[1].sigma))
        else:
            positions = [given.film.centers[0] + found.places[i].value
                         for i in sorted(found.places)]
            items.append(Identified(
                'film.positions', (given.film.centers[0], *positions),
                (0.0, *(found.places[i].sigma for i in sorted(found.places)))))
    return items


def _film_lists(found: GainFit, given: RobotParams) -> list[Identified]:
    """Return gains and bending peaks of all films in the order of ``film.wheels``."""
    film, results = given.film, {(one.wheel, one.film): one for one in found.films}
    gains, bendings, kept = [], [], []
    for wheel in film.wheels:
        for i, (gain, bending) in enumerate(zip(film.gains(wheel), film.bending(wheel))):
            one = results.get((wheel, i))
            bendings.append(Uncertain(bending, 0.0) if one is None else one.bending)
            if one is None or one.gain is None:
                kept.append(f'film {i + 1} of {wheel} unchanged')
                gains.append(Uncertain(gain, film.stretch_gain_tolerance * gain))
            else:
                gains.append(one.gain)
    items = []
    if len(kept) < len(gains):
        worst = max(item.sigma / item.value for item in gains)
        items += [_per_film('film.stretch_gain', gains, ', '.join(kept)),
                  Identified('film.stretch_gain_tolerance', worst, note='largest of all films')]
    if results:
        items.append(_per_film('film.bending_peak', bendings, ''))
    return items


def _per_film(name: str, values: Sequence[Uncertain], note: str) -> Identified:
    return Identified(name, tuple(item.value for item in values),
                      tuple(item.sigma for item in values), note)
