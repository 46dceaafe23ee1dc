# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Every hazard of ``docs/safety.md`` in virtual time: no stop takes longer than its bound."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
import math

from hypothesis import given, settings, strategies as st, target
import pytest
from smart_tire.control.duty_gate import DutyGate
from support.cases import long
from support.hazards import (
    ACTORS, conditions_of, HAZARDS, longest, MARGIN, MAX_LATENESS, MAX_STALL, PHASES, RATES,
    README, recorded, runs_of, SENTENCE, sentence, worst)

hazards = pytest.mark.parametrize('name', HAZARDS)
TOPICS = ('motor_commands', 'wheel_states', 'cmd_vel')
SOON = st.floats(-MAX_STALL, 0.3)  # s, since the fault


@hazards
def test_no_stop_takes_longer_than_recorded(name):
    seconds, number = worst(name, 16.0, runs_of(name) // 5)
    assert 0.6 * recorded()[name][16.0] <= seconds <= 1.05 * recorded()[name][16.0], number


def is_recorded(name, rate):
    """Return whether the longest stop time is the recorded one; else, run the script again."""
    return longest((name, rate)) == pytest.approx(recorded()[name][rate], rel=0.05)


@pytest.mark.long
@hazards
@pytest.mark.parametrize('rate', RATES)
def test_the_recorded_stop_time_is_the_longest_at_all_phases(name, rate):
    assert is_recorded(name, rate)


@hazards
@pytest.mark.parametrize('rate', [rate for rate in RATES if rate != 16.0])
def test_the_wheels_stop_within_the_bound_at_other_rates(name, rate):
    seconds, number = worst(name, rate, 2)
    assert seconds <= HAZARDS[name].bound, number


@hazards
def test_no_bound_is_far_above_the_worst_stop_time(name):
    found = max(recorded()[name].values())
    assert found <= HAZARDS[name].bound <= MARGIN * found


def test_the_readme_has_the_bounds():
    assert SENTENCE.search(README.read_text(encoding='utf-8'))[0] == sentence()


@settings(max_examples=100)
@given(name=st.sampled_from(sorted(HAZARDS)), rate=st.sampled_from(RATES),
       number=st.integers(0, 2 * PHASES),
       stalls=st.tuples(*(st.tuples(SOON, st.floats(0.0, MAX_STALL)) for _ in ACTORS)),
       late=st.tuples(*(st.tuples(st.integers(0, 9), st.floats(0.0, MAX_LATENESS))
                        for _ in TOPICS)),
       lost=st.tuples(st.sampled_from(TOPICS), st.integers(0, 9)),
       doubled=st.tuples(st.sampled_from(TOPICS), st.integers(0, 9)))
def test_no_disturbance_within_the_allowance_delays_a_stop_beyond_the_bound(
        name, rate, number, stalls, late, lost, doubled):
    conditions = replace(
        conditions_of(name, number, rate),
        stalls=tuple((actor, *stall) for actor, stall in zip(ACTORS, stalls)),
        late=tuple((topic, *one) for topic, one in zip(TOPICS, late)),
        lost=(lost,), doubled=(doubled,))
    seconds = HAZARDS[name].stop_time(conditions, number)
    target(seconds / HAZARDS[name].bound)
    assert seconds <= HAZARDS[name].bound


def some(cases):
    """Return the first cases, and the others for ``make check``."""
    return [*cases[:2], *long(*cases[2:])]


def constant(name, factor=1.2):
    """Return a fault of the code: a constant, named with its module, is too large."""
    def apply(patch, hazard):
        module, _, own = name.rpartition('.')
        value = getattr(import_module(f'smart_tire.{module}'), own) * factor
        patch.setattr(f'smart_tire.{name}', math.ceil(value) if value > 1.0 else value)
    return apply


def parameter(node, **values):
    """Return a fault of the code: a parameter is larger than its default."""
    def apply(patch, hazard):
        case = HAZARDS[hazard]
        patch.setitem(HAZARDS, hazard, replace(case, settings={**case.settings, node: values}))
    return apply


def without(name):
    """Return a fault of the code: a method does nothing."""
    def apply(patch, hazard):
        patch.setattr(f'smart_tire.{name}', lambda *_: None)
    return apply


def wrong_clock(patch, hazard):
    """Let the output stage count the time-out of a command from a clock that is ahead."""
    command = DutyGate.command
    patch.setattr(DutyGate, 'command',
                  lambda gate, duty, now_ns: command(gate, duty, now_ns + 50_000_000))


@pytest.mark.parametrize(('hazard', 'fault'), some([
    ('replies of both boards lost', constant('drivers.roboclaw_line.REPLY_TIMEOUT')),
    ('replies of one board lost', constant('drivers.roboclaw_line.MAX_ATTEMPTS')),
    ('requests garbled', constant('drivers.roboclaw_pair.ZERO_DUTY_TIME', 1.4)),
    ('requests garbled', parameter('driver', board_timeout=0.3)),
    ('motor_driver killed or stopped', parameter('driver', board_timeout=0.3)),
    ('encoder frozen', parameter('driver', stall_time=0.26)),
    ('encoder frozen', constant('drivers.motor_board.CHECK_PERIOD_NS', 2.0)),
    ('board status not normal', constant('drivers.roboclaw_pair.HEALTH_PERIOD_NS')),
    ('supply low', constant('drivers.roboclaw_pair.HEALTH_PERIOD_NS')),
    ('supply low', constant('drivers.roboclaw_pair.MIN_LOW_READINGS')),
    ('cmd_vel ends', parameter('controller', cmd_vel_timeout=0.3)),
    ('wheel_controller killed or stopped', parameter('driver', command_timeout=0.3)),
    ('wheel_controller killed or stopped', wrong_clock),
    ('queued motor_commands', wrong_clock),
    ('speed of a wheel NaN or too high', parameter('controller', wheel_states_timeout=0.6)),
    ('emergency stop', without('drivers.roboclaw_pair.RoboclawPair.wake')),
    ('second publisher on motor_commands',
     without('drivers.motor_output.MotorOutput.set_conflict')),
    ('second publisher on wheel_states',
     without('control.wheel_loop.WheelLoop.set_wheel_conflict')),
    ('odom ends', parameter('follower', **{'checks.odom_timeout': 0.6})),
    ('odom repeats one pose', constant('control.constants.WINDOW_NS')),
]))
def test_a_wrong_time_limit_is_found(hazard, fault, monkeypatch):
    fault(monkeypatch, hazard)
    assert not is_recorded(hazard, 16.0)
