# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recordings of the simulated robot, and estimates of any recording."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import math
from pathlib import Path
from typing import Any, TYPE_CHECKING
import warnings

import numpy as np

from smart_tire.analysis import figure
from smart_tire.analysis.figures import MAX_CROSSING_GAP
from smart_tire.analysis.metrics import compared_poses, measured, SIDES
from smart_tire.analysis.motion_figures import mean_slip
from smart_tire.analysis.pipeline import LOST_WITHOUT, Pipeline
from smart_tire.api.params import Params
from smart_tire.api.recording import as_recording, read_bag, Recording
from smart_tire.arrays import ArrayLike
from smart_tire.errors import EstimatorError, ParameterError
from smart_tire.estimates import Estimates, FrictionEstimate, SlipEstimate, Truth
from smart_tire.recording import SampleArrays, seconds
from smart_tire.simulation import offline

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLORS = dict(zip(('left', 'right'), figure.PAIR))


def estimate(recording: Recording | str | Path, params: Params | None = None) -> Estimates:
    """
    Return all estimates of ``recording``: pose, slip, center of rotation, ground and friction.

    A path is that of a bag, see ``read_bag``.
    ``params`` describe the robot; by default they are those of the recording, or the robot of
    paper B if it has none. The estimates equal those of
    ``smart_tire analyze``. Estimates whose inputs are missing are empty. All arrays have one row
    per timestamp, ``stamp_ns`` (n,) [ns]; units and shapes are given in the classes. A
    UserWarning names the estimates that a recording without IMU or wheels has not.
    """
    if not isinstance(recording, Recording):
        recording = read_bag(recording, params=params)
    for topic, stream in (('imu/data', recording.imu), ('wheel_states', recording.wheels)):
        if not len(stream):
            warnings.warn(f'the recording has no {topic}: no {LOST_WITHOUT[topic]}', stacklevel=2)
    pipeline = Pipeline((params or recording.params or Params()).estimators)
    found = SampleArrays(one for item in recording.received()
                         for one in pipeline.update(item.sample))
    for one in pipeline.finish():
        found.add_sample(one)
    return Estimates(found.poses(), found.slips(), found.centers(), found.grounds(),
                     found.frictions())


def estimate_slip(recording: Recording | str | Path, params: Params | None = None) -> SlipEstimate:
    """
    Return the slip of the four wheels at 125 Hz.

    ``stamp_ns`` (n,) [ns], ``ratio`` and ``sigma`` (n, 4) [-], ``velocity`` (n, 4) [m/s]; wheels
    in the order front left, front right, rear left, rear right. Requires IMU and wheels.
    ``estimate`` returns everything in one run.
    """
    return estimate(recording, params).slip


def estimate_friction(recording: Recording | str | Path,
                      params: Params | None = None) -> FrictionEstimate:
    """
    Return the friction coefficient and 12 more quantities of each patch crossing.

    ``stamp_ns`` (n,) [ns], ``wheel`` (n,), and per quantity ``value`` and ``sigma`` (n,), NaN and
    infinite if not observable: ``friction_coefficient.value`` [-], ``normal_load.sigma`` [N].
    Requires IMU, wheels and films of ``film.wheels``. ``estimate`` returns everything in one run.
    """
    return estimate(recording, params).friction


def simulate(speeds: ArrayLike, duration: float, *, params: Params | None = None,
             seed: int | None = None, wheel_rate: float = 16.0, torque: bool = True,
             ground: Mapping[str, float] | None = None) -> Recording:
    """
    Return the recording of a simulated drive, with ground truth, faster than real time.

    ``speeds`` (n, 3) are the set points of the wheel speeds: rows of start time [s], left and
    right [rad/s]; the wheels are at rest before the first one. ``duration`` is in s.
    ``wheel_rate`` [Hz] is the rate of the wheel readings, which contain motor torques if
    ``torque``. ``ground`` is that everywhere: ``friction`` [-], ``stiffness`` C_x [N] of a tire on
    it, ``drag`` [-], the rolling resistance; what it lacks is that of the first surface of
    ``params``. Surfaces, sensor errors and the radio link are those of ``params``
    (``config/simulation.yaml``); the same ``seed``, by default that of ``params``, gives the same
    recording. Raises ParameterError for arguments out of range.
    """
    params = params or Params()
    if seed is not None:
        params = params.with_seed(seed)
    if ground is not None:
        params = params.with_values(_one_ground(ground, params))
    for name, value in (('duration', duration), ('wheel_rate', wheel_rate)):
        if not 0.0 < value < math.inf:
            raise ParameterError(f'{name} is {value}, expected a positive number')
    return as_recording(offline.simulate(
        params.simulator, _phases(speeds), duration, wheel_rate=wheel_rate, torque=torque),
        params)


def _one_ground(ground: Mapping[str, float], params: Params) -> dict[str, Any]:
    """Return the parameters of one surface everywhere; raise ParameterError for other names."""
    surfaces = params.simulator.ground
    first = {name: getattr(surfaces, name)[0] for name in ('friction', 'stiffness', 'drag')}
    if unknown := ground.keys() - first.keys():
        raise ParameterError(f'ground: {", ".join(sorted(unknown))}, expected some of '
                             f'{", ".join(first)}')
    return {'ground.names': ['own'], 'ground.base': 'own', 'ground.patches.names': [],
            **{f'ground.{name}': [float(value)] for name, value in {**first, **ground}.items()}}


def _phases(speeds: ArrayLike) -> list[tuple[float, float, float]]:
    """Return (start time [s], left [rpm], right [rpm]) of each row of ``speeds``."""
    rows = np.array(speeds, dtype=float)
    if rows.ndim != 2 or rows.shape[1] != 3 or not np.isfinite(rows).all():
        raise ParameterError(f'speeds has shape {rows.shape}, expected finite numbers (n, 3): '
                             'start time [s], left and right [rad/s]')
    rows[:, 1:] /= offline.RAD_PER_S_PER_RPM
    return [(start, left, right) for start, left, right in rows.tolist()]


def plot(estimates: Estimates, truth: Truth | None = None) -> Figure:
    """
    Return a figure of matplotlib: path [m], slip of both sides [-], friction coefficient [-].

    Bands and bars are two standard deviations. ``truth``, where it is given and known, is dashed,
    its path so that both start at the same pose. In a notebook the figure shows itself; its
    ``savefig(path)`` writes it. Raises EstimatorError if there is nothing to show.
    """
    from smart_tire.analysis.drawing import render  # loads matplotlib
    pose, slip, friction = estimates.pose, estimates.slip, estimates.friction
    stamps = np.concatenate([one.stamp_ns for one in (pose, slip, friction)])
    if not len(stamps):
        raise EstimatorError('there are no estimates to plot: expected pose, slip or friction')
    known, origin_ns = len(pose) > 0, int(stamps.min())
    paths = [figure.Mark(figure.Curve(*pose.pose[:, :2].T), 'estimate', 'ink')]
    if truth is not None and known and len(truth.pose):
        paths += figure.truth_marks(figure.Curve(
            *compared_poses(pose, truth.pose).true[:, :2].T))
    panels = [figure.Panel(paths, 'x [m]', 'y [m]', 'path', equal=True)] if known else []
    end = float(seconds(stamps, origin_ns).max())
    slips = [*_slips(slip, origin_ns), *(_true_slips(truth.slip, origin_ns) if truth else ())]
    frictions = [*_frictions(friction, origin_ns)]
    bars = [mark.curve.y + sign * mark.curve.reach for mark in frictions for sign in (-1.0, 1.0)]
    if frictions and truth is not None:
        frictions += _true_frictions(truth.friction, origin_ns)
    for title, marks, shown in (
            ('slip ratio [-]', slips, [mark.curve.y for mark in slips]),
            ('friction coefficient [-]', frictions, bars)):
        if marks:
            panels.append(figure.Panel(marks, figure.TIME_LABEL, title, x_limits=(0.0, end),
                                       y_limits=figure.limits(shown, 0.05)))
    return render(figure.Figure('estimates', 'Path, slip and friction', figure.TWO_SIGMA,
                                [[panel] for panel in panels], panel_legends=True))


def _slips(slip: SlipEstimate, origin_ns: int) -> Iterator[figure.Mark]:
    for side, wheels in SIDES.items() if len(slip) else ():
        curve, _ = mean_slip(slip, measured(slip.ratio, wheels), origin_ns)
        yield figure.Mark(curve, f'{side} side ± 2σ', COLORS[side])


def _true_slips(slip: SlipEstimate, origin_ns: int) -> Iterator[figure.Mark]:
    for wheels in SIDES.values():
        yield from figure.truth_marks(figure.interrupted(figure.Curve(
            seconds(slip.stamp_ns, origin_ns), slip.ratio[:, wheels].mean(axis=1))))


def _true_frictions(friction: FrictionEstimate, origin_ns: int) -> Iterator[figure.Mark]:
    for wheel in sorted(set(friction.wheel)):
        own = friction.of(wheel)
        yield from figure.truth_marks(figure.interrupted(figure.Curve(
            seconds(own.stamp_ns, origin_ns), own.friction_coefficient.value),
            MAX_CROSSING_GAP), 'mid')


def _frictions(friction: FrictionEstimate, origin_ns: int) -> Iterator[figure.Mark]:
    mu = friction.friction_coefficient
    for wheel, color in zip(sorted(set(friction.wheel)), figure.COLORS):
        own = (friction.wheel == wheel) & np.isfinite(mu.value)
        yield figure.dots(seconds(friction.stamp_ns[own], origin_ns), mu.value[own],
                          f'{wheel.replace("_", " ")} ± 2σ', color, mu.sigma[own])
