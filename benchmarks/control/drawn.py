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
Path tracking of robots drawn at random, with other tires than those of the controller.

Each follows all paths with all controllers, which know the nominal robot only, on its ground.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
import math

from benchmarks.control import paths
from benchmarks.control.closed_loop import run_closed_loop
from benchmarks.control.pursuit import PursuitControl
from benchmarks.control.robot_stack import PathStack, StackParams
from benchmarks.control.scenarios import FILM, MAX_DURATION, OURS, SHORT, SHORT_LOOK_AHEAD
from benchmarks.control.tracking import score_drive
from benchmarks.grounds import ground
from benchmarks.robots.draws import DISTRIBUTIONS, PURE_BRUSH_SHARE
from benchmarks.robots.plant import plant_with, Traits
from benchmarks.scoring import Run
import numpy as np
from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.control import path_library
from smart_tire.control.trajectory_control import TrajectoryControl
from smart_tire.parameters import FrictionEstimatorParams, SimulatorParams, SlipEstimatorParams
from smart_tire.parameters.control import TrajectoryControllerParams, WheelControllerParams
from smart_tire.parameters.robot import RobotParams, TreadFilmParams
from smart_tire.rotation import euler, matrix, quaternion
from smart_tire.samples import (
    four, GRAVITY, ImuSample, NS_PER_S, Odometry, PlannedPath, Sample)

CALIBRATED, PURSUIT = 'calibrated', 'pursuit'
CONTROLLERS = OURS, SHORT, CALIBRATED, PURSUIT
PATHS: Mapping[str, PlannedPath] = {
    'straight': path_library.line(3.0), 'S': path_library.lane_change(3.0, 1.0),
    'figure-eight': path_library.figure_eight(0.7), 'U-turn 0.3 m': paths.u_turn(0.3),
    'spiral': paths.spiral(0.3, 4.0), 'square': path_library.square(2.0),
    'slalom': paths.slalom(2.0, 0.4), 'two cusps': paths.two_cusps(0.6)}
BORDER = 0.8           # m, x of the border to the second ground: all paths cross it
POSITION_NOISE, YAW_NOISE = 2e-3, 2e-3  # m, rad, of one pose; assumed: a good localization
SPEED_NOISE, RATE_NOISE = 5e-3, 5e-3    # m/s, rad/s, of one twist; assumed
STREAM = 5             # of random numbers; differs from the streams of the simulator


@dataclass(frozen=True)
class DrawnRobot:
    """A robot, its ground, and how fast and late it is."""

    simulator: SimulatorParams
    traits: Traits
    rate: float           # Hz, of odom, wheel_states and wheel control
    odom_delay: float     # s, from the motion to the reception of its pose
    command_delay: float  # s, of commands on their way to the wheel controller

    @property
    def effective_track(self) -> float:
        """Return the effective track [m] of tires that adhere, in a wide turn."""
        robot = self.simulator.robot
        return robot.track_width * (1.0 + self.traits.stiffness_ratio * (
            robot.wheelbase / robot.track_width) ** 2)


def draw_robot(seed: int) -> DrawnRobot:
    """Return the robot of ``seed``; half of all have two grounds."""
    rng = np.random.default_rng([seed, STREAM])
    value = {one: DISTRIBUTIONS[one].draw(rng) for one in (
        'resistance_share', 'fall', 'relaxation_length', 'load_transfer_time', 'stiffness_scale',
        'stamp_jitter', 'latency')}
    nominal = RobotParams(film=FILM)
    mass, (x, y) = rng.uniform(8.0, 16.0), rng.uniform(-0.02, 0.02, 2)
    robot = replace(
        nominal, mass=mass, yaw_inertia=nominal.yaw_inertia * mass / nominal.mass,
        center_of_mass=(float(x), float(y), nominal.center_of_mass[2]),
        encoder=replace(nominal.encoder, stamp_jitter=value['stamp_jitter'][0],
                        latency=value['latency'][0]))
    grounds = {name: (rng.uniform(0.2, 0.8), rng.uniform(25.0, 60.0), rng.uniform(0.005, 0.05))
               for name in ('first', 'second')}
    traits = Traits(
        resistance_share=value['resistance_share'][0], stiffness_ratio=rng.uniform(0.6, 1.4),
        fall=value['fall'][0] * bool(rng.random() > PURE_BRUSH_SHARE),
        relaxation_length=value['relaxation_length'][0],
        load_transfer_time=value['load_transfer_time'][0],
        stiffness_scale=four(value['stiffness_scale']),
        radius_scale=four(rng.uniform(0.99, 1.01, 4).tolist()),
        slope=rng.uniform(0.0, math.radians(4.0)), direction=rng.uniform(-math.pi, math.pi))
    rate, odom_delay, command_delay = rng.uniform((16.0, 0.0, 0.0), (100.0, 0.05, 0.1)).tolist()
    simulator = SimulatorParams(seed=seed, robot=robot, ground=ground(
        'first', grounds, [('second', BORDER, 10.0)] if rng.random() < 0.5 else []))
    return DrawnRobot(simulator, traits, rate, odom_delay, command_delay)


class OdometryErrors:
    """True motion and slip as a localization would give them: at a rate, late and with noise."""

    def __init__(self, robot: DrawnRobot) -> None:
        self._rng = np.random.default_rng([robot.simulator.seed, STREAM, 1])
        self._period_ns, self._delay_ns = NS_PER_S / robot.rate, robot.odom_delay * NS_PER_S
        self._held = deque[Sample]()
        self._number = 0  # of the period

    def __call__(self, samples: Iterable[Sample]) -> Iterator[Sample]:
        """Yield what is received by the time of these samples."""
        for one in samples:
            number = int(one.stamp_ns / self._period_ns)
            if isinstance(one, Odometry) and number > self._number:
                self._number = number
                self._held.append(self._measured(one))
            elif not isinstance(one, Odometry) and self._held and (
                    one.stamp_ns == self._held[-1].stamp_ns):
                self._held.append(one)
            while self._held and self._held[0].stamp_ns <= one.stamp_ns - self._delay_ns:
                yield self._held.popleft()

    def _measured(self, true: Odometry) -> Odometry:
        x, y, yaw, v_x, v_y, rate = (self._rng.standard_normal(6) * (
            POSITION_NOISE, POSITION_NOISE, YAW_NOISE, SPEED_NOISE, SPEED_NOISE, RATE_NOISE)
            ).tolist()
        return replace(
            true, position=(true.position[0] + x, true.position[1] + y, 0.0),
            orientation=quaternion(0.0, 0.0, euler(true.orientation)[2] + yaw),
            linear=(true.linear[0] + v_x, true.linear[1] + v_y, 0.0),
            angular=(0.0, 0.0, true.angular[2] + rate))


class SlopeStack(PathStack):
    """The software on a slope, which the IMU measures and the motion of the plant contains."""

    def __init__(self, params: StackParams, path: PlannedPath, robot: DrawnRobot) -> None:
        super().__init__(params, path)
        self._slope, self._direction = robot.traits.slope, robot.traits.direction or 0.0
        self._to_imu = matrix(*robot.simulator.robot.imu.rotation)

    def receive(self, topic: str, sample: Sample, now_ns: int) -> None:
        """Process a message received at ``now_ns``."""
        if isinstance(sample, ImuSample):
            sample = self._tilted(sample)
        super().receive(topic, sample, now_ns)

    def _tilted(self, sample: ImuSample) -> ImuSample:
        """Return ``sample`` with gravity in the axes of the tilted body."""
        yaw = euler(self.truth[-1].orientation)[2] if self.truth else 0.0
        along = self._direction - yaw
        up = np.array([math.sin(self._slope) * math.cos(along),
                       math.sin(self._slope) * math.sin(along), math.cos(self._slope) - 1.0])
        a_x, a_y, a_z = (np.array(sample.acceleration) + GRAVITY * up @ self._to_imu).tolist()
        return replace(sample, acceleration=(a_x, a_y, a_z))


def stack_params(robot: DrawnRobot, controller: str, *, estimated: bool) -> StackParams:
    """Return the parameters of the software with ``controller``, which knows the nominal robot."""
    film = FILM if estimated else TreadFilmParams(wheels=())
    nominal = RobotParams(film=film)
    track = robot.effective_track if controller == CALIBRATED else nominal.track_width
    trajectory = TrajectoryControllerParams(
        robot=nominal, effective_track=track, slip_compensation=controller == OURS)
    if controller in (SHORT, CALIBRATED):
        time, distance = SHORT_LOOK_AHEAD
        trajectory = replace(trajectory, follower=replace(
            trajectory.follower, look_ahead_time=time, min_look_ahead=distance))
    return StackParams(
        EstimatorParams(SlipEstimatorParams(robot=nominal),
                        FrictionEstimatorParams(robot=nominal)), trajectory,
        WheelControllerParams(robot=nominal, effective_track=track, rate=robot.rate),
        estimated=estimated, control=PursuitControl if controller == PURSUIT else (
            TrajectoryControl), fault=iter if estimated else OdometryErrors(robot),
        command_delay=robot.command_delay)


def run_drawn(path: str, seed: int, *, estimated: bool, row: str) -> list[Run]:
    """
    Return the figures of the controllers on a path, of ``tracking.score_drive``.

    A ratio is that of our distance of the true pose from the path to another one's, who has lost
    if it is the larger one.
    """
    robot, values = draw_robot(seed), dict[str, float]()
    controllers = (OURS, SHORT) if estimated else CONTROLLERS
    for controller in controllers:
        _, found = score_drive(driven(robot, path, controller, estimated=estimated))
        values |= {f'{controller}.{name}': value for name, value in found.items()}
    for other in controllers[1:]:
        ratio = values[f'{OURS}.true_rms'] / values[f'{other}.true_rms']
        values |= {f'{other}.ratio': ratio, f'{other}.lost': float(ratio < 1.0)}
    return [Run(f'{row}/{path}', seed, values=values)]


def driven(robot: DrawnRobot, path: str, controller: str, *, estimated: bool) -> SlopeStack:
    """Return the software after it has driven the robot along a path."""
    params = robot.simulator
    if not estimated:
        params = replace(params, robot=replace(params.robot, film=TreadFilmParams(wheels=())))
    stack = SlopeStack(stack_params(robot, controller, estimated=estimated), PATHS[path], robot)
    run_closed_loop(params, stack, MAX_DURATION, wheel_rate=robot.rate, control_rate=robot.rate,
                    plant=plant_with(robot.traits))
    return stack
