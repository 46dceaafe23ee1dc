# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters at the ends of their ranges: control in closed loop never fails or leaves bounds."""

from __future__ import annotations

from itertools import product
import math
import random

import pytest
from smart_tire.control.trajectory_control import PathState
from smart_tire.control.wheel_control import WheelControl
from smart_tire.errors import ParameterError
from smart_tire.parameters import build, specs, TrajectoryControllerParams, WheelControllerParams
from smart_tire.samples import NS_PER_S, VelocityCommand
from support.cases import long
from support.ideal_robot import odometry, path, Run

pytestmark = pytest.mark.slow

STALL_TORQUE, FREE_SPEED, FRICTION = 5.0, 22.0, 0.15     # N m, rad/s, N m
ON_GROUND, LIFTED = 0.0286, 0.008                        # kg m2, inertia of the wheel
TIME_STEP_NS = 1_000_000
READING_STEPS = 10       # at 100 Hz
COMMAND = VelocityCommand(0, 0.4, 0.3)
SHORT_PATH = path((0.0, 0.0), (1.0, 0.0), (1.5, 0.5))
GAINS = 'pid.proportional', 'pid.integral', 'pid.derivative'


def numbers(cls):
    """Return the numeric parameters of ``cls`` that are no lists."""
    return [spec for spec in specs(cls).values() if spec.kind in ('int', 'float')]


def ends(cls):
    """Return each numeric parameter at either end of its range, as values for ``build``."""
    return [{spec.name: value} for spec in numbers(cls) for value in (spec.low, spec.high)]


def mixed(cls, size=2, count=150):
    """Return random sets of parameters, each at an end of its range."""
    chance = random.Random(1)
    return [{spec.name: chance.choice((spec.low, spec.high))
             for spec in chance.sample(numbers(cls), size)} for _ in range(count)]


def few(cls):
    """Return sets of several parameters, each at an end of its range."""
    return mixed(cls, 4, 12)


def built(cls, values):
    """Return the parameters, None if they contradict each other."""
    try:
        return build(cls, values)
    except ParameterError as error:
        assert 'parameters: ' in str(error)  # not the range of one of them
        return None


class Wheels:
    """Four equal wheels whose duty is held between the steps of the controller."""

    def __init__(self, params, inertia=ON_GROUND):
        self._params, self._inertia, self._control = params, inertia, WheelControl(params)
        self.speed, self.speeds, self.steps = 0.0, [], []

    def run(self, seconds, command=COMMAND):
        """Return this after ``seconds`` with a command, then as many with a command of zero."""
        period, duty, turned = max(round(1000.0 / self._params.rate), 1), 0.0, 0.0
        for index in range(2 * round(1000 * seconds)):
            now_ns = NS_PER_S + index * TIME_STEP_NS
            if index % READING_STEPS == 0:
                mean = turned / (READING_STEPS * 1e-3)
                self._control.traction.add_odometry(odometry(
                    now_ns, v_x=mean * self._params.robot.wheel_radius))
                self._control.add_reading((mean,) * 4, now_ns, now_ns)
                turned = 0.0
            if index % period == 0:
                driven = command if index < 1000 * seconds else VelocityCommand(0, 0.0, 0.0)
                self.steps.append(self._control.follow(driven, now_ns, now_ns))
                duty = self.steps[-1][1][0]
            self._advance(duty)
            turned += 1e-3 * self.speed
            self.speeds.append(self.speed)
        return self

    def _advance(self, duty):
        torque = STALL_TORQUE * (duty - self.speed / FREE_SPEED)
        if abs(self.speed) < 0.01 and abs(torque) < FRICTION:
            self.speed = 0.0
        else:
            friction = math.copysign(FRICTION, self.speed or torque)
            self.speed += 1e-3 * (torque - friction) / self._inertia


def assert_in_bounds(wheels, params):
    for set_points, duties in wheels.steps:
        assert all(abs(duty) <= params.pid.limit for duty in duties)  # false for NaN
        assert all(math.isfinite(speed) for speed in set_points)
        if not params.traction.enabled:
            assert max(map(abs, set_points)) <= params.max_wheel_speed * (1.0 + 1e-9)


sweeps = pytest.mark.parametrize('choose', [few, *long(ends, mixed)])


@pytest.mark.parametrize('traction', [False, True])
@sweeps
def test_wheel_control_never_fails_with_parameters_at_the_ends_of_their_ranges(choose, traction):
    for values in choose(WheelControllerParams):
        params = built(WheelControllerParams, {'traction.enabled': traction, **values})
        if params is not None:
            assert_in_bounds(Wheels(params).run(0.3), params)


@pytest.mark.parametrize(('inertia', 'rate', 'all_gains'), [
    (ON_GROUND, 16.0, False), (LIFTED, 100.0, False),
    *long(*product((ON_GROUND, LIFTED), (16.0, 100.0, 200.0), (True,)))])
def test_the_wheels_follow_and_stop_with_any_gains(inertia, rate, all_gains):
    described = specs(WheelControllerParams)
    choices = [(described[name].low, described[name].default, described[name].high)
               for name in GAINS]
    for gains in product(*choices) if all_gains else list(zip(*choices))[::2]:
        params = build(WheelControllerParams, {'rate': rate, **dict(zip(GAINS, gains))})
        speeds = Wheels(params, inertia).run(2.0, VelocityCommand(0, 0.5, 0.0)).speeds
        wanted = 0.5 / params.robot.wheel_radius
        assert max(speeds) < 1.3 * wanted, gains
        assert min(speeds) > -0.3 * wanted, gains  # lifted: the feed-forward is for more inertia
        assert min(speeds[1500:2000]) > 0.8 * wanted, gains
        assert max(map(abs, speeds[3500:])) < 0.1 * wanted, gains


@sweeps
def test_path_following_never_fails_with_parameters_at_the_ends_of_their_ranges(choose):
    for values in choose(TrajectoryControllerParams):
        params = built(TrajectoryControllerParams, {'slip_compensation': False, **values})
        if params is None:
            continue
        run = Run(params, params.rate).start(SHORT_PATH).for_seconds(max(4.0, 4.0 / params.rate))
        assert run.control.state in PathState
        fastest = max(params.limits.yaw_rate, params.follower.spin_rate)
        for row in run.log:
            v_x, yaw_rate = row[-2:]
            assert abs(v_x) <= params.max_speed * (1.0 + 1e-9)  # false for NaN
            assert abs(yaw_rate) <= fastest * (1.0 + 1e-9)


@sweeps
def test_slip_compensation_never_fails_with_parameters_at_the_ends_of_their_ranges(choose):
    for values in choose(TrajectoryControllerParams):
        if (params := built(TrajectoryControllerParams, values)) is not None:
            run = Run(params, params.rate).start(SHORT_PATH).for_seconds(2.0)
            assert all(math.isfinite(number) for row in run.log for number in row), values
