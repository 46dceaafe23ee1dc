# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Output stage: which duty reaches the motors, what stops them, and how a stop ends."""

from __future__ import annotations

import math

import pytest

from smart_tire.control.constants import MIN_PAUSE_NS
from smart_tire.control.duty_gate import DutyGate
from smart_tire.samples import NS_PER_S, STOPPED

AHEAD = (0.5, 0.5, 0.5, 0.5)
TIMEOUT_NS = NS_PER_S // 4
MS = NS_PER_S // 1000


class Gate(DutyGate):
    """A gate that records its reports."""

    def __init__(self, **options):
        self.reports = []
        super().__init__(0.25, self.reports.append, **options)


@pytest.fixture
def gate():
    """Return a gate with a command at time zero."""
    made = Gate()
    assert made.command(AHEAD, 0)
    assert made.output(0) == AHEAD
    return made


def test_before_the_first_command_the_duty_is_zero():
    gate = Gate()
    assert gate.output(0) == STOPPED
    assert gate.expiry_ns is None
    assert gate.enabled
    assert gate.reports == []


def test_each_command_is_active_until_its_time_out(gate):
    assert gate.expiry_ns == TIMEOUT_NS
    gate.command(AHEAD, MS)
    assert gate.output(MS + TIMEOUT_NS) == AHEAD
    assert gate.output(MS + TIMEOUT_NS + 1) == STOPPED
    assert gate.expiry_ns is None
    assert gate.output(0) == STOPPED  # it was discarded
    assert gate.timeouts == 1
    assert gate.reports == ['motors stopped: no motor command for 0.25 s']


def test_an_expired_zero_command_is_not_reported():
    gate = Gate()
    gate.command(STOPPED, 0)
    assert gate.output(2 * TIMEOUT_NS) == STOPPED
    assert gate.timeouts == 0
    assert gate.reports == []


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
def test_a_duty_that_is_not_finite_stops_the_motors(gate, bad):
    assert not gate.command((0.5, 0.5, bad, 0.5), MS)
    assert gate.output(MS) == STOPPED


def test_the_emergency_stop_is_latched_and_discards_the_command(gate):
    gate.engage(0)
    assert gate.emergency
    assert not gate.enabled
    assert gate.reasons() == ['emergency stop']
    assert gate.output(MS) == STOPPED
    assert not gate.command(AHEAD, 2 * MS)
    assert gate.output(2 * MS) == STOPPED
    gate.release(0)
    assert not gate.emergency
    assert gate.output(3 * MS) == STOPPED
    assert gate.command(AHEAD, 4 * MS)
    assert gate.output(4 * MS) == AHEAD


def test_a_release_discards_the_command_even_without_an_emergency_stop(gate):
    gate.release(0)
    assert gate.output(MS) == STOPPED


def test_a_release_is_refused_within_the_hold_off_after_the_engagement():
    gate = Gate(release_hold_off=1.0)
    gate.engage(0)
    assert gate.release(999 * MS) == ('release refused: 1 s after the last request, '
                                      'expected at least 1 s')
    assert gate.emergency
    assert gate.release(1999 * MS) == ''
    assert not gate.emergency


def test_a_repeated_release_never_undoes_an_emergency_stop():
    gate = Gate(release_hold_off=1.0)
    assert gate.release(0) == ''
    for tick in range(1, 2000):  # 500 requests per second
        if tick == 1000:
            gate.engage(2 * tick * MS)
        assert gate.release(2 * tick * MS) != ''
        assert gate.emergency == (tick >= 1000)
    assert gate.refused_releases == 1999
    assert gate.release(5000 * MS) == ''


def test_a_hold_lasts_until_it_is_cleared_and_a_new_command_arrives(gate):
    gate.hold('line', 'no answer')
    assert gate.output(MS) == STOPPED
    assert gate.reasons() == ['no answer']
    assert not gate.command(AHEAD, 2 * MS)
    gate.clear('line')
    assert gate.output(3 * MS) == STOPPED
    assert gate.enabled
    assert gate.command(AHEAD, 4 * MS)
    assert gate.output(4 * MS) == AHEAD


def test_holds_are_independent_and_each_is_reported_once(gate):
    gate.hold('a', 'first')
    gate.hold('a', 'first, still')
    gate.hold('b', 'second')
    assert gate.reports == ['motors stopped: first', 'motors stopped: second']
    assert gate.reasons() == ['first, still', 'second']
    gate.clear('a')
    gate.clear('unknown')
    assert not gate.command(AHEAD, MS)
    gate.clear('b')
    assert gate.command(AHEAD, 2 * MS)
    gate.hold('a', 'again')
    assert gate.reports[2:] == ['motors stopped: again']


def test_a_hold_may_be_silent(gate):
    gate.hold('a', 'starting', report=False)
    assert gate.reports == []
    assert gate.output(MS) == STOPPED


def test_a_trip_is_not_reset_by_an_uninterrupted_stream_of_commands(gate):
    gate.trip('wheel blocked')
    assert gate.output(MS) == STOPPED
    assert gate.reasons() == ['wheel blocked (latched until commands pause)']
    for tick in range(1, 100):
        assert not gate.command(AHEAD, tick * 60 * MS)
        assert gate.output(tick * 60 * MS) == STOPPED
    assert gate.reports == ['motors stopped: wheel blocked']


@pytest.mark.parametrize('zero', [True, False])
def test_a_trip_is_reset_by_a_pause_in_which_no_duty_is_commanded(gate, zero):
    gate.trip('wheel blocked')
    for now_ns in (MIN_PAUSE_NS // 2, MIN_PAUSE_NS, 2 * MIN_PAUSE_NS):
        assert not gate.command(AHEAD, now_ns)  # refused commands count, too
    for tick in range(1, 10 * zero):  # zero is no duty, and no pause by itself
        assert not gate.command(STOPPED, 2 * MIN_PAUSE_NS + tick * 100 * MS)
    assert gate.command(AHEAD, 3 * MIN_PAUSE_NS + 1)
    assert gate.output(3 * MIN_PAUSE_NS + 1) == AHEAD


def test_zero_between_two_duties_does_not_reset_a_trip(gate):
    gate.trip('wheel blocked')
    assert not gate.command(AHEAD, MS)
    assert not gate.command(STOPPED, 500 * MS)
    assert not gate.command(AHEAD, 501 * MS)


def test_a_new_trip_after_a_reset_is_reported_again(gate):
    gate.trip('wheel blocked')
    gate.trip('wheel blocked')
    gate.command(STOPPED, MIN_PAUSE_NS + MS)
    gate.trip('wheel blocked')
    assert gate.reports == ['motors stopped: wheel blocked'] * 2


def test_a_latched_hold_ends_when_it_is_cleared_and_commands_pause(gate):
    gate.hold('supply', 'low', latch=True)
    assert gate.reasons() == ['low']
    assert not gate.command(AHEAD, MS)
    assert not gate.command(STOPPED, 2 * MIN_PAUSE_NS)  # the cause is not gone
    gate.clear('supply')
    assert gate.reasons() == ['low (latched until commands pause)']
    assert not gate.command(AHEAD, MIN_PAUSE_NS)
    assert gate.command(AHEAD, 2 * MIN_PAUSE_NS + MS)
    assert gate.reports == ['motors stopped: low']


def test_arming_is_not_required_by_default(gate):
    assert gate.armed
    assert gate.arm(False) == []
    assert gate.armed


class TestRequireArming:

    def test_duties_are_accepted_only_while_armed(self):
        gate = Gate(require_arming=True)
        assert not gate.armed
        assert gate.reasons() == ['not armed']
        assert not gate.command(AHEAD, 0)
        assert gate.arm(True) == []
        assert gate.armed
        assert gate.output(MS) == STOPPED
        assert gate.command(AHEAD, 2 * MS)
        assert gate.arm(False) == []
        assert gate.output(3 * MS) == STOPPED
        assert not gate.command(AHEAD, 4 * MS)

    def test_arming_is_refused_while_the_motors_are_stopped(self):
        gate = Gate(require_arming=True, stopped=True)
        assert gate.emergency
        gate.hold('line', 'no answer')
        assert gate.arm(True) == ['emergency stop', 'no answer']
        assert not gate.armed
        gate.release(0)
        gate.clear('line')
        assert not gate.armed
        assert gate.arm(True) == []

    def test_the_emergency_stop_disarms(self):
        gate = Gate(require_arming=True)
        gate.arm(True)
        gate.engage(0)
        gate.release(0)
        assert not gate.armed

    def test_arming_again_discards_the_command(self):
        gate = Gate(require_arming=True)
        gate.arm(True)
        gate.command(AHEAD, 0)
        gate.arm(True)
        assert gate.output(0) == STOPPED
