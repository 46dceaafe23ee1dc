"""The output stage: what reaches the motors, what stops them, and what it takes to go on."""

from __future__ import annotations

import math

import pytest

from smart_tire.control.duty_gate import DutyGate, PAUSE_NS, STOPPED
from smart_tire.samples import NS_PER_S

AHEAD = (0.5, 0.5, 0.5, 0.5)
TIMEOUT_NS = NS_PER_S // 4
MS = NS_PER_S // 1000


class Gate(DutyGate):
    """A gate whose reports are kept."""

    def __init__(self, **options):
        self.reports = []
        super().__init__(0.25, self.reports.append, **options)


@pytest.fixture
def gate():
    """Return a gate that drives since time zero."""
    made = Gate()
    assert made.command(AHEAD, 0)
    assert made.output(0) == AHEAD
    return made


def test_nothing_moves_before_the_first_command():
    gate = Gate()
    assert gate.output(0) == STOPPED
    assert gate.expiry_ns is None
    assert gate.enabled
    assert gate.reports == []


def test_a_command_holds_until_its_time_out_and_not_longer(gate):
    assert gate.expiry_ns == TIMEOUT_NS
    assert gate.output(TIMEOUT_NS) == AHEAD
    assert gate.output(TIMEOUT_NS + 1) == STOPPED
    assert gate.expiry_ns is None
    assert gate.output(0) == STOPPED  # it is gone for good
    assert gate.timeouts == 1
    assert gate.reports == ['motors stopped: no motor command for 0.25 s']


def test_each_command_counts_from_its_own_arrival(gate):
    gate.command(AHEAD, 100 * MS)
    assert gate.output(TIMEOUT_NS + 100 * MS) == AHEAD
    assert gate.output(TIMEOUT_NS + 101 * MS) == STOPPED


def test_zero_that_expires_is_no_event():
    gate = Gate()
    gate.command(STOPPED, 0)
    assert gate.output(2 * TIMEOUT_NS) == STOPPED
    assert gate.timeouts == 0
    assert gate.reports == []


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
def test_a_duty_that_is_no_number_stops_the_motors(gate, bad):
    assert not gate.command((0.5, 0.5, bad, 0.5), MS)
    assert gate.output(MS) == STOPPED


def test_the_emergency_stop_is_latched_and_discards_the_command(gate):
    gate.engage()
    assert gate.emergency
    assert not gate.enabled
    assert gate.reasons() == ['emergency stop']
    assert gate.output(MS) == STOPPED
    assert not gate.command(AHEAD, 2 * MS)
    assert gate.output(2 * MS) == STOPPED
    gate.release()
    assert not gate.emergency
    assert gate.output(3 * MS) == STOPPED
    assert gate.command(AHEAD, 4 * MS)
    assert gate.output(4 * MS) == AHEAD


def test_a_release_discards_a_command_that_came_after_it_had_been_released_before(gate):
    gate.release()
    assert gate.output(MS) == STOPPED


def test_a_gate_may_begin_stopped():
    gate = Gate(stopped=True)
    assert gate.emergency
    assert not gate.command(AHEAD, 0)
    assert gate.output(0) == STOPPED


def test_a_hold_lasts_until_it_is_cleared_and_then_takes_a_new_command(gate):
    gate.hold('line', 'no answer')
    assert gate.output(MS) == STOPPED
    assert gate.reasons() == ['no answer']
    assert not gate.command(AHEAD, 2 * MS)
    gate.clear('line')
    assert gate.output(3 * MS) == STOPPED
    assert gate.enabled
    assert gate.command(AHEAD, 4 * MS)
    assert gate.output(4 * MS) == AHEAD


def test_holds_are_independent_and_reported_once_each(gate):
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


def test_a_trip_stays_through_an_unbroken_stream_of_commands(gate):
    gate.trip('wheel blocked')
    assert gate.output(MS) == STOPPED
    assert gate.reasons() == ['wheel blocked (latched until commands pause)']
    for tick in range(1, 100):
        assert not gate.command(AHEAD, tick * 60 * MS)
        assert gate.output(tick * 60 * MS) == STOPPED
    assert gate.reports == ['motors stopped: wheel blocked']


def test_a_trip_ends_with_a_zero_command_and_then_takes_a_new_one(gate):
    gate.trip('wheel blocked')
    assert gate.command(STOPPED, MS)
    assert gate.output(MS) == STOPPED
    assert gate.command(AHEAD, 2 * MS)
    assert gate.output(2 * MS) == AHEAD


def test_a_trip_ends_with_a_pause(gate):
    gate.trip('wheel blocked')
    assert not gate.command(AHEAD, PAUSE_NS)
    assert gate.command(AHEAD, 2 * PAUSE_NS + 1)


def test_commands_that_trip_do_not_count_as_a_pause_although_they_are_refused(gate):
    gate.trip('wheel blocked')
    assert not gate.command(AHEAD, PAUSE_NS // 2)
    assert not gate.command(AHEAD, PAUSE_NS)
    assert not gate.command(AHEAD, 2 * PAUSE_NS)


def test_a_new_trip_after_the_end_of_one_is_reported_again(gate):
    gate.trip('wheel blocked')
    gate.trip('wheel blocked')
    gate.command(STOPPED, MS)
    gate.trip('wheel blocked')
    assert gate.reports == ['motors stopped: wheel blocked'] * 2


def test_a_latched_hold_needs_to_be_cleared_and_a_pause(gate):
    gate.hold('supply', 'low', latch=True)
    assert gate.reasons() == ['low']
    assert not gate.command(STOPPED, MS)  # a pause counts only once the cause is gone
    gate.clear('supply')
    assert gate.reasons() == ['low (latched until commands pause)']
    assert not gate.command(AHEAD, 2 * MS)
    assert gate.command(STOPPED, 3 * MS)
    assert gate.command(AHEAD, 4 * MS)
    assert gate.reports == ['motors stopped: low']


def test_arming_is_not_required_unless_asked_for(gate):
    assert gate.armed
    assert gate.arm(False) == []
    assert gate.armed


class TestRequireArming:
    def test_it_drives_only_armed(self):
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

    def test_it_is_refused_while_something_stops_the_motors(self):
        gate = Gate(require_arming=True, stopped=True)
        gate.hold('line', 'no answer')
        assert gate.arm(True) == ['emergency stop', 'no answer']
        assert not gate.armed
        gate.release()
        gate.clear('line')
        assert not gate.armed
        assert gate.arm(True) == []

    def test_the_emergency_stop_disarms(self):
        gate = Gate(require_arming=True)
        gate.arm(True)
        gate.engage()
        gate.release()
        assert not gate.armed

    def test_arming_again_discards_the_command(self):
        gate = Gate(require_arming=True)
        gate.arm(True)
        gate.command(AHEAD, 0)
        gate.arm(True)
        assert gate.output(0) == STOPPED
