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

"""Runs of the path tracking benchmark: paths, grounds, kinematics and localization."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product

from benchmarks.control.robot_stack import StackParams
from benchmarks.grounds import CONCRETE, ground, SAND
from benchmarks.scenarios import Scenario
from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.control import path_library
from smart_tire.parameters import (
    FrictionEstimatorParams, SimulatorParams, SlipEstimatorParams)
from smart_tire.parameters.control import TrajectoryControllerParams, WheelControllerParams
from smart_tire.parameters.robot import FilmParams
from smart_tire.samples import PlannedPath

FILM = FilmParams(wheels=('front_right', 'front_left'))
MAX_DURATION = 90.0      # s, of a run
CALIBRATED_TRACK = 0.57  # m, effective track on concrete

IDEAL, FIXED, OURS, SHORT = 'ideal', 'fixed', 'ours', 'ideal_short'
KINEMATICS = {IDEAL: 'ideal', FIXED: 'fixed effective track', OURS: 'slip-compensated',
              SHORT: 'ideal, short look-ahead'}
# s, m: the look-ahead with which the ideal kinematics track best (seeds 101, 102)
SHORT_LOOK_AHEAD, SHORT_MIN_LOOK_AHEAD = 0.35, 0.18
TRUE, ESTIMATED = 'true', 'estimated'
CHANGE = 'change'
GROUNDS = {CONCRETE: 'concrete', SAND: 'sand', CHANGE: 'concrete with sand'}
PATHS: Mapping[str, tuple[str, PlannedPath]] = {
    'figure_eight': ('figure-eight', path_library.figure_eight(0.7)),
    'square': ('square', path_library.square(2.0)),
    'lane_change': ('lane change', path_library.lane_change(3.0, 1.0))}
SAND_FIELDS = {  # m, begin and end along x, of the run over changes
    'figure_eight': (0.7, 10.0), 'square': (0.8, 10.0), 'lane_change': (1.2, 3.0)}


@dataclass(frozen=True)
class TrackingCase:
    """One run of the benchmark, apart from its seed."""

    path: str
    ground: str
    localization: str
    kinematics: str

    @property
    def name(self) -> str:
        """Return path, ground and localization: what the kinematics are compared on."""
        return f'{self.path}_{self.ground}_{self.localization}'

    def wanted(self) -> PlannedPath:
        """Return the path to follow."""
        return PATHS[self.path][1]

    def simulator(self, seed: int) -> SimulatorParams:
        """Return the parameters of the simulated robot and its ground."""
        return self._scenario().simulator(seed)

    def stack(self) -> StackParams:
        """Return the parameters of the software; gains are the same for all but SHORT."""
        robot = self._scenario().robot
        track = CALIBRATED_TRACK if self.kinematics == FIXED else robot.track_width
        trajectory = TrajectoryControllerParams(
            robot=robot, effective_track=track, slip_compensation=self.kinematics == OURS)
        if self.kinematics == SHORT:
            trajectory = replace(trajectory, follower=replace(
                trajectory.follower, look_ahead_time=SHORT_LOOK_AHEAD,
                min_look_ahead=SHORT_MIN_LOOK_AHEAD))
        return StackParams(
            EstimatorParams(SlipEstimatorParams(robot=robot),
                            FrictionEstimatorParams(robot=robot)), trajectory,
            WheelControllerParams(robot=robot, effective_track=track),
            true_pose=self.localization == TRUE)

    def _scenario(self) -> Scenario:
        begin, end = SAND_FIELDS[self.path]
        surface = (ground(CONCRETE, fields=[(SAND, begin, end)]) if self.ground == CHANGE
                   else ground(self.ground))
        return Scenario(name=self.name, title=self.name, legs=(), duration=MAX_DURATION,
                        ground=surface, film=FILM, gain_error=FILM.stretch_gain_tolerance)


def all_cases() -> Iterator[TrackingCase]:
    """Yield all runs."""
    for path, surface, localization, kinematics in product(
            PATHS, GROUNDS, (TRUE, ESTIMATED), KINEMATICS):
        yield TrackingCase(path, surface, localization, kinematics)


def title(name: str) -> str:
    """Return the title of the cases with this name."""
    case = next(case for case in all_cases() if case.name == name)
    return f'{PATHS[case.path][0]}, {GROUNDS[case.ground]}, {case.localization} pose'
