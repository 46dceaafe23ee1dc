# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Set points and feed-forward stay within their bounds whatever the estimates are."""

from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

from smart_tire.control.slip_limits import bounded, TireLoad
from smart_tire.control.traction import TractionControl
from smart_tire.control.wheel_servo import drive_model, SpeedReference
from smart_tire.parameters.control import PidParams, TractionParams
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import GroundState, NS_PER_S, Odometry
from smart_tire.uncertain import Uncertain

ROBOT, PARAMS = RobotParams(), TractionParams(enabled=True)
NOW_NS, PERIOD = 1_000 * NS_PER_S, 0.02
STEP = PARAMS.min_deceleration * PERIOD / ROBOT.wheel_radius  # rad/s in a control period
TOP = 20.0  # rad/s, largest set point

EXTREME = 0.0, math.nan, math.inf, -math.inf, 1e9, -1e9, 1e300, 5e-324, 1e-3, 1.0


def number(rng, low=-3.0, high=3.0):
    return rng.choice(EXTREME) if rng.random() < 0.3 else rng.uniform(low, high)


def four(rng, low=-TOP, high=TOP):
    return tuple(number(rng, low, high) for _ in range(4))


def command(rng):
    return tuple(rng.choice((0.0, rng.uniform(-TOP, TOP))) for _ in range(4))


def odometry(rng, now_ns):
    stamp_ns = now_ns - rng.choice((rng.randrange(10**8), rng.randrange(-10**12, 10**12)))
    return Odometry(stamp_ns, (0.0,) * 3, (0.0, 0.0, 0.0, 1.0), (number(rng), number(rng), 0.0),
                    (0.0, 0.0, number(rng)), (0.0,) * 36, (number(rng),) * 36)


def ground(rng, now_ns):
    stiffness, mu = (Uncertain(number(rng, 0.0, high), number(rng, 0.0, high))
                     for high in (100.0, 1.2))
    return GroundState(now_ns - rng.randrange(-10**8, 10**9), stiffness, mu)


def receive(rng, traction, now_ns, count=4):
    """Give up to ``count`` arbitrary estimates to traction control."""
    for _ in range(rng.randrange(count + 1)):
        traction.add_odometry(odometry(rng, now_ns))
        traction.set_ground(ground(rng, now_ns))


streams = st.randoms(use_true_random=True)


@settings(max_examples=60, deadline=None)
@given(streams)
def test_a_set_point_never_leaves_the_command_and_its_ramp_whatever_the_estimates_are(rng):
    traction, now_ns, wanted = TractionControl(PARAMS, ROBOT), NOW_NS, command(rng)
    before = wanted
    for _ in range(15):
        now_ns += rng.choice((20_000_000, 20_000_000, 20_000_000, 0, -10**10, 10**10))
        receive(rng, traction, now_ns)
        wanted = rng.choice((wanted, wanted, command(rng)))
        found = traction.limit(wanted, now_ns, PERIOD)
        for new, target, old in zip(found, wanted, before):
            beyond = abs(old) > abs(target) or old * target < 0.0
            ramp = max(abs(old) - STEP, 0.0) if beyond else 0.0
            assert abs(new) <= max(abs(target), ramp + 1e-9)
            assert new * target >= 0.0 or (new * old >= 0.0 and abs(new) <= ramp + 1e-9)
        before = found


@settings(max_examples=10, deadline=None)
@given(streams)
def test_after_a_command_of_zero_wheels_only_slow_down_and_stop_in_a_stated_time(rng):
    traction, now_ns = TractionControl(PARAMS, ROBOT), NOW_NS
    receive(rng, traction, now_ns)
    latest = traction.limit(command(rng), now_ns, PERIOD)
    for _ in range(math.ceil(TOP / STEP)):
        now_ns += rng.choice((20_000_000, 20_000_000, 0, -10**10))
        receive(rng, traction, now_ns, count=1)
        found = traction.limit((0.0,) * 4, now_ns, PERIOD)
        assert all(abs(new) <= abs(old) and new * old >= 0.0 for new, old in zip(found, latest))
        latest = found
    assert latest == (0.0,) * 4


@given(st.floats(), st.floats(-TOP, TOP), st.floats(-TOP, TOP), st.floats(0.0, 5.0))
def test_the_bound_contains_command_and_zero_and_leaves_what_is_within(
        wanted, command, latest, step):
    found = bounded(wanted, command, latest, step)
    low, high = min(0.0, command), max(0.0, command)
    if low <= wanted <= high:
        assert found == wanted
    assert min(low, latest) <= found <= max(high, latest)


@settings(deadline=None)
@given(*[st.floats(-2.0 * TOP, 2.0 * TOP)] * 3, st.floats(0.0, 1e3), st.floats(1e-3, 3.0))
def test_the_feed_forward_of_a_slipping_wheel_does_not_leave_the_command(
        before, set_point, ground, torque, critical):
    """Else the wheel has the input that it would have without traction control."""
    model, limits = drive_model(PidParams(), ROBOT), (40.0, 60.0)
    tire = TireLoad(ground, torque, critical, command=12.0)
    found = SpeedReference(before, 0).advance(set_point, PERIOD, 0, model, limits, tire)
    without = SpeedReference(before, 0).advance(set_point, PERIOD, 0, model, limits)
    assert found == without or min(0.0, without) <= found <= max(12.0, without)


def test_set_points_after_an_interruption_begin_at_the_command():
    traction = TractionControl(PARAMS, ROBOT)
    traction.limit((12.0,) * 4, NOW_NS, PERIOD)
    traction.reset()
    traction.add_odometry(Odometry(NOW_NS, (0.0,) * 3, (0.0, 0.0, 0.0, 1.0), (1.0, 0.0, 0.0),
                                   (0.0,) * 3, (0.0,) * 36, (0.0,) * 36))
    assert traction.limit((0.0,) * 4, NOW_NS, PERIOD) == (0.0,) * 4
    assert traction.limit((5.0,) * 4, NOW_NS, PERIOD) == pytest.approx((5.0,) * 4)
