"""Bags to what is identified of tires, and what is found to parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

from smart_tire.analysis.calibrate_robot import NO_REFERENCE, read_recording, Span
from smart_tire.analysis.pipeline import INPUTS
from smart_tire.analysis.smoothing import SmoothedSlip
from smart_tire.bags import Bag
from smart_tire.calibration.film import gains
from smart_tire.calibration.film.crossing_collector import CrossingCollector, CrossingWithSlip
from smart_tire.calibration.film.results import GainFit
from smart_tire.calibration.tire import stiffness
from smart_tire.calibration.tire.stiffness import StiffnessFit
from smart_tire.errors import EstimatorError
from smart_tire.parameters import FrictionEstimatorParams, RobotParams, SlipEstimatorParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.samples import ImuSample, NS_PER_S, Sample, TireSample, WheelSample, WheelSlip
from smart_tire.uncertain import Uncertain


def identify_stiffness(bags: Sequence[Path], robot: RobotParams,
                       span: Span) -> StiffnessFit:
    """
    Return the stiffness C_x that ``bags`` of one robot on one ground tell together.

    Raises BagError if one can not be read, EstimatorError with the reason where they do not tell.
    """
    return stiffness.identify_stiffness(
        [read_recording(bag, robot, span, NO_REFERENCE) for bag in bags], robot)


def stiffness_parameters(found: StiffnessFit) -> list[Identified]:
    """Return what goes into a parameter file."""
    told = found.stiffness
    return [Identified('tire.longitudinal_stiffness', told.value, told.sigma),
            Identified('tire.longitudinal_stiffness_sigma', told.sigma / told.value,
                       note='of this tire on the ground of the recording')]


def identify_gains(bags: Sequence[Path], robot: RobotParams, span: Span) -> GainFit:
    """
    Return what ``bags`` of one robot tell of its films together.

    Raises BagError if one can not be read, EstimatorError with the reason where they do not tell.
    """
    return gains.identify_gains(
        [read_passages(bag, robot, span) for bag in bags], robot)


def read_passages(path: Path, robot: RobotParams, span: Span) -> list[CrossingWithSlip]:
    """Return the passages in a bag with the slips that the whole of it tells without films."""
    robot = replace(robot, slip=replace(robot.slip, film_aided=False))
    collector = CrossingCollector(robot, FrictionEstimatorParams(robot=robot).reorder_window)
    with closing(SmoothedSlip(SlipEstimatorParams(robot=robot))) as slip:
        for sample in _inputs(path, span):
            if isinstance(sample, (ImuSample, WheelSample)):
                slip.update(sample)
            if isinstance(sample, (TireSample, WheelSample)):
                collector.update(sample)
        known = list(collector.with_slip(
            estimate for estimates in slip.smoothed() for estimate in estimates
            if isinstance(estimate, WheelSlip)))
    if not collector.tire_samples:
        raise EstimatorError(f'{path}: no tire_samples of {", ".join(robot.film.wheels)}')
    if not known:
        raise EstimatorError(f'{path}: no film was seen to pass through the patch: the robot must '
                             'drive for some turns of its wheels')
    return known


def _inputs(path: Path, span: Span) -> Iterator[Sample]:
    """Yield the inputs in a stretch of a bag; EstimatorError where it lacks one."""
    with Bag(path) as bag:
        there = bag.match(INPUTS)
        missing = ', '.join(name for name in INPUTS if name not in there)
        if missing:
            raise EstimatorError(f'{path}: has no {missing}, expected {", ".join(INPUTS)}')
        first_ns: int | None = None
        for _, _, sample in bag.samples(INPUTS):
            first_ns = sample.stamp_ns if first_ns is None else first_ns
            if span.since <= (sample.stamp_ns - first_ns) / NS_PER_S <= span.until:
                yield sample


def gain_parameters(found: GainFit, given: RobotParams) -> list[Identified]:
    """Return what goes into a parameter file; ``given`` stands where a film is not told."""
    items = _film_lists(found, given)
    if found.length is not None:
        items.append(Identified('tire.contact_length', found.length.value, found.length.sigma))
    if found.places.keys() == set(range(1, given.film.count)) and found.places:
        if given.film.positions == (-1.0,):
            items.append(Identified('film.spacing', found.places[1].value, found.places[1].sigma))
        else:
            places = [given.film.places[0] + found.places[i].value for i in sorted(found.places)]
            items.append(Identified(
                'film.positions', (given.film.places[0], *places),
                (0.0, *(found.places[i].sigma for i in sorted(found.places)))))
    return items


def _film_lists(found: GainFit, given: RobotParams) -> list[Identified]:
    """Return gains and bending peaks of all films, in the order of film.wheels."""
    film, told = given.film, {(one.wheel, one.film): one for one in found.films}
    gains, bendings, kept = [], [], []
    for wheel in film.wheels:
        for i, (gain, bending) in enumerate(zip(film.gains(wheel), film.bending(wheel))):
            one = told.get((wheel, i))
            bendings.append(Uncertain(bending, 0.0) if one is None else one.bending)
            if one is None or one.gain is None:
                kept.append(f'film {i + 1} of {wheel} as it was')
                gains.append(Uncertain(gain, film.stretch_gain_tolerance * gain))
            else:
                gains.append(one.gain)
    items = []
    if len(kept) < len(gains):
        worst = max(item.sigma / item.value for item in gains)
        items += [_of_films('film.stretch_gain', gains, ', '.join(kept)),
                  Identified('film.stretch_gain_tolerance', worst, note='the largest of them')]
    if told:
        items.append(_of_films('film.bending_peak', bendings, ''))
    return items


def _of_films(name: str, values: Sequence[Uncertain], note: str) -> Identified:
    return Identified(name, tuple(item.value for item in values),
                      tuple(item.sigma for item in values), note)
