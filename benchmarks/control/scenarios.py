# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Cases of the path tracking benchmark: paths, grounds, kinematics and localization."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product

from benchmarks.control import paths
from benchmarks.control.icr_kinematics import IcrControl
from benchmarks.control.other_plant import other_robot
from benchmarks.control.robot_stack import StackParams
from benchmarks.grounds import CONCRETE, ground, SAND
from benchmarks.scenarios import Scenario
from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.control import path_library
from smart_tire.control.trajectory_control import TrajectoryControl
from smart_tire.parameters import FrictionEstimatorParams, SimulatorParams, SlipEstimatorParams
from smart_tire.parameters.control import TrajectoryControllerParams, WheelControllerParams
from smart_tire.parameters.robot import TreadFilmParams
from smart_tire.samples import PlannedPath

FILM = TreadFilmParams(wheels=('front_right', 'front_left'))
MAX_DURATION = 90.0      # s, of a run

SHORT, BEST, ICR, OURS = KINEMATICS = 'ideal', 'best', 'icr', 'ours'
SHORT_LOOK_AHEAD = 0.35, 0.18  # s, m: the same for all paths
TRUE, ESTIMATED = 'true', 'estimated'
CHANGE = 'change'
GROUNDS = {CONCRETE: 'concrete', SAND: 'sand', CHANGE: 'concrete with sand'}
OWN, OTHER = 'own', 'other'    # plant, see other_plant.py
PLANTS = {OWN: '', OTHER: ', other plant'}
PATHS: Mapping[str, tuple[str, PlannedPath]] = {
    'figure_eight': ('figure-eight', path_library.figure_eight(0.7)),
    'square': ('square', path_library.square(2.0)),
    'lane_change': ('lane change', path_library.lane_change(3.0, 1.0)),
    'u_turn_30': ('U-turn 0.3 m', paths.u_turn(0.3)),
    'u_turn_40': ('U-turn 0.4 m', paths.u_turn(0.4)),
    'u_turn_50': ('U-turn 0.5 m', paths.u_turn(0.5)),
    'slalom': ('slalom', paths.slalom(2.0, 0.4)),
    'spiral': ('spiral', paths.spiral(0.3, 4.0)),
    'reverse_parking': ('reverse parking', paths.reverse_parking(0.5))}
# s, m: look-ahead with which the ideal kinematics track each path best on concrete and sand:
# python -m benchmarks.control.look_ahead
BEST_LOOK_AHEAD: dict[str, tuple[float, float]] = {
    'figure_eight': (0.15, 0.06), 'square': (0.1, 0.06), 'lane_change': (0.1, 0.06),
    'u_turn_30': (0.28, 0.09), 'u_turn_40': (0.15, 0.12), 'u_turn_50': (0.15, 0.12),
    'slalom': (0.15, 0.09), 'spiral': (0.15, 0.09), 'reverse_parking': SHORT_LOOK_AHEAD}
WITH_ESTIMATES = ('figure_eight', 'square', 'lane_change', 'u_turn_30', 'reverse_parking')
SAND_FIELDS = {  # m, begin and end along x, of the run over changes
    'figure_eight': (0.7, 10.0), 'square': (0.8, 10.0), 'lane_change': (1.2, 3.0)}


@dataclass(frozen=True)
class TrackingCase:
    """One run of the benchmark, apart from its seed."""

    path: str
    ground: str
    localization: str
    plant: str = OWN
    kinematics: str = OURS

    @property
    def name(self) -> str:
        """Return all but the kinematics: what they are compared on."""
        return f'{self.path}_{self.ground}_{self.localization}_{self.plant}'

    @property
    def title(self) -> str:
        """Return the title of the case."""
        return (f'{PATHS[self.path][0]}, {GROUNDS[self.ground]}, {self.localization} pose'
                f'{PLANTS[self.plant]}')

    def wanted(self) -> PlannedPath:
        """Return the path to follow."""
        return PATHS[self.path][1]

    def simulator(self, seed: int) -> SimulatorParams:
        """Return the parameters of the simulated robot and its ground."""
        params = self._scenario().simulator(seed)
        return (params if self.plant == OWN
                else replace(params, robot=other_robot(params.robot)))

    def stack(self) -> StackParams:
        """Return the parameters of the software, which knows nothing of the other plant."""
        robot = self._scenario().robot
        trajectory = TrajectoryControllerParams(
            robot=robot, effective_track=robot.track_width,
            slip_compensation=self.kinematics in (ICR, OURS))
        if self.kinematics in (SHORT, BEST):
            time, distance = (SHORT_LOOK_AHEAD if self.kinematics == SHORT
                              else BEST_LOOK_AHEAD[self.path])
            trajectory = replace(trajectory, follower=replace(
                trajectory.follower, look_ahead_time=time, min_look_ahead=distance))
        return StackParams(
            EstimatorParams(SlipEstimatorParams(robot=robot),
                            FrictionEstimatorParams(robot=robot)), trajectory,
            WheelControllerParams(robot=robot, effective_track=robot.track_width),
            estimated=self.localization == ESTIMATED,
            control=IcrControl if self.kinematics == ICR else TrajectoryControl)

    def _scenario(self) -> Scenario:
        surface = (ground(CONCRETE, fields=[(SAND, *SAND_FIELDS[self.path])])
                   if self.ground == CHANGE else ground(self.ground))
        return Scenario(name=self.name, title=self.name, legs=(), duration=MAX_DURATION,
                        ground=surface, film=FILM, gain_error=FILM.stretch_gain_tolerance)


# with true motion and slip on both plants, some with estimates
CASES: Mapping[str, TrackingCase] = {case.name: case for case in (
    TrackingCase(*parts) for parts in product(PATHS, GROUNDS, (TRUE, ESTIMATED), PLANTS))
    if (case.ground != CHANGE or case.path in SAND_FIELDS)
    and (case.localization == TRUE or (case.path in WITH_ESTIMATES and case.plant == OWN))}
