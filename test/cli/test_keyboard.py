# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Driving by keys: decoding, the terminal, velocity commands, requests to stop."""

from __future__ import annotations

from contextlib import suppress
from fcntl import ioctl
import io
import os
import select
import signal
import subprocess
import sys
import termios

import pytest
from smart_tire.cli import _keyboard
from smart_tire.cli._keyboard import (
    ACCELERATION, BRAKING, DriveKey, FIRST_HOLD, Keyboard, KeyDecoder, MAX_SCALE, MIN_SCALE,
    REPEAT_HOLD, SIGNALS, STEP_FACTOR, StopRequest, Teleoperation, YAW_BRAKING, YAW_RATE)
from smart_tire.errors import ParameterError
from support.waiting import wait_for

pytestmark = pytest.mark.processes

ARROWS = [DriveKey.FORWARD, DriveKey.BACKWARD, DriveKey.RIGHT, DriveKey.LEFT]


@pytest.fixture
def terminal():
    """Return the end of the user and the end of the program of a terminal."""
    user, program = os.openpty()
    with open(program, encoding='utf-8', closefd=False) as stream:
        yield user, stream
    for end in (user, program):
        with suppress(OSError):  # closed by the test
            os.close(end)


def settings(stream):
    return termios.tcgetattr(stream.fileno())


@pytest.mark.parametrize('data', [
    b'\x1b[A\x1b[B\x1b[C\x1b[D', b'\x1bOA\x1bOB\x1bOC\x1bOD', b'wsda', b'WSDA',
    b'\x1b[1;2A\x1b[1;5Bda', b'x\x1b[5~\x1b[Z7wsda'])
def test_arrows_and_letters_are_decoded_and_others_ignored(data):
    assert KeyDecoder().decode(data) == ARROWS


def test_a_sequence_may_be_split_anywhere():
    data = b'\x1b[Aq\x1bOB+'
    for first in range(len(data)):
        decoder = KeyDecoder()
        keys = decoder.decode(data[:first]) + decoder.decode(data[first:])
        assert keys == [DriveKey.FORWARD, DriveKey.QUIT, DriveKey.BACKWARD, DriveKey.FASTER]


def test_a_sequence_that_was_completed_is_not_decoded_again():
    decoder = KeyDecoder()
    assert decoder.decode(b'\x1b[') == [] and decoder.decode(b'A') == [DriveKey.FORWARD]
    assert decoder.decode(b'q') == [DriveKey.QUIT] and decoder.decode(b'') == []


def test_escape_before_a_letter_is_no_sequence():
    assert KeyDecoder().decode(b'\x1bw ') == [DriveKey.FORWARD, DriveKey.STOP]


def press(user, stream, keys):
    """Press keys; return when the terminal has passed on all of them."""
    os.write(user, keys)
    wait_for(lambda: int.from_bytes(ioctl(stream, termios.FIONREAD, bytes(4)), sys.byteorder)
             >= len(keys))


def test_keys_arrive_without_enter_and_are_not_echoed(terminal, monkeypatch):
    user, stream = terminal
    waits, look = [], select.select
    monkeypatch.setattr(select, 'select', lambda *words: waits.append(words[3]) or look(*words))
    with Keyboard(stream) as keyboard:
        assert keyboard.pressed() == []
        assert waits == [0.0]  # commands are sent meanwhile
        press(user, stream, b'w ')
        assert keyboard.pressed() == [DriveKey.FORWARD, DriveKey.STOP]
        assert keyboard.pressed() == []
        os.set_blocking(user, False)
        with pytest.raises(BlockingIOError):
            os.read(user, 100)  # an echo


@pytest.mark.parametrize('error', [None, KeyboardInterrupt, RuntimeError])
def test_the_terminal_is_restored_on_every_way_out(terminal, error):
    user, stream = terminal
    before = settings(stream)
    try:
        with Keyboard(stream):
            inside = settings(stream)
            press(user, stream, b'www')  # keys that the shell must not get
            if error:
                raise error
    except (KeyboardInterrupt, RuntimeError) as raised:
        assert type(raised) is error
    assert settings(stream) == before
    assert inside[3] & (termios.ICANON | termios.ECHO) == 0
    assert inside[3] & termios.ISIG  # Ctrl-C interrupts
    assert inside[0] == before[0] & ~termios.IXON  # Ctrl-S does not stop the output
    assert {inside[6][key] for key in (termios.VSUSP, termios.VQUIT)} == {b'\0'}
    os.write(user, b'\n')
    assert os.read(stream.fileno(), 100) == b'\n'


def test_a_closed_terminal_is_the_end(terminal):
    user, stream = terminal
    with Keyboard(stream) as keyboard:
        os.close(user)
        assert keyboard.pressed() == [DriveKey.QUIT]


def test_a_terminal_that_cannot_be_read_is_the_end(terminal, monkeypatch):
    def fail(*_):
        raise OSError(5, 'Input/output error')

    user, stream = terminal
    with Keyboard(stream) as keyboard:
        press(user, stream, b'w')
        monkeypatch.setattr(_keyboard.os, 'read', fail)
        assert keyboard.pressed() == [DriveKey.QUIT]
        monkeypatch.undo()


def test_a_pipe_is_refused():
    with pytest.raises(ParameterError, match='not a terminal'):
        Keyboard(io.StringIO())


PERIOD = 0.05  # s
SPEED = 0.3    # m/s


class Hand:
    """Presses keys and collects one command per period."""

    def __init__(self, speed=SPEED):
        self.pilot, self.count, self.commands = Teleoperation(speed), 0, []

    @property
    def time(self):
        return self.count * PERIOD

    def wait(self, seconds, *, repeat=None):
        """Step for ``seconds``; ``repeat`` is a key that repeats in each period."""
        for _ in range(round(seconds / PERIOD)):
            self.count += 1
            if repeat:
                self.pilot.press(repeat, self.time)
            self.commands.append(self.pilot.step(self.time))
        return self.commands[-1]

    def hold(self, key, seconds, delay=0.5):
        """Hold a key as a person does: pressed, a pause, repetitions."""
        self.pilot.press(key, self.time)
        self.wait(min(delay, seconds))
        return self.wait(max(seconds - delay, 0.0), repeat=key)


def test_times_and_limits_are_those_of_the_document():
    assert (FIRST_HOLD, REPEAT_HOLD, STEP_FACTOR) == (0.75, 0.3, 1.1)
    assert (BRAKING, YAW_BRAKING) == (1.6, 6.0)
    assert (YAW_RATE, MIN_SCALE, MAX_SCALE) == (1.2, 0.2, 3.0)


@pytest.mark.parametrize('key', [DriveKey.FORWARD, DriveKey.LEFT])
def test_a_key_is_in_force_until_its_time_is_over_not_longer(key):
    pilot = Teleoperation(10.0)
    pilot.step(0.0)
    pilot.press(key, 0.0)
    for now in (0.1, 0.2, 0.3):
        held = max(pilot.step(now))
    pilot.press(key, 0.3)
    for now in (0.4, 0.5, 0.59):
        held = max(pilot.step(now))
    assert max(pilot.step(0.6)) < held  # exactly the time-out after a repetition


def test_a_held_key_drives_at_the_speed_without_a_gap():
    hand = Hand()
    assert hand.hold(DriveKey.FORWARD, 3.0) == pytest.approx((SPEED, 0.0))
    speeds = [speed for speed, _ in hand.commands]
    assert speeds == sorted(speeds)  # no dip before the first repetition


@pytest.mark.parametrize('key, sign', [(DriveKey.FORWARD, 1.0), (DriveKey.BACKWARD, -1.0)])
def test_the_speed_decays_to_zero_after_the_last_repetition(key, sign):
    hand = Hand()
    hand.hold(key, 2.0)
    held = hand.wait(REPEAT_HOLD - PERIOD)
    assert held[0] == pytest.approx(sign * SPEED)
    assert abs(hand.wait(2 * PERIOD)[0]) < SPEED
    hand.wait(SPEED / BRAKING)
    assert hand.wait(PERIOD) == (0.0, 0.0)


def test_a_key_pressed_once_acts_until_the_first_repetition_is_overdue():
    hand = Hand()
    hand.pilot.press(DriveKey.LEFT, 0.0)
    assert hand.wait(FIRST_HOLD - PERIOD)[1] == pytest.approx(YAW_RATE)
    assert hand.wait(0.5) == (0.0, 0.0)


def test_changes_are_ramps():
    hand = Hand(speed=1.0)
    hand.hold(DriveKey.FORWARD, 2.0)
    hand.hold(DriveKey.BACKWARD, 3.0)
    speeds = [speed for speed, _ in hand.commands]
    assert speeds[-1] == pytest.approx(-1.0)
    steps = [after - before for before, after in zip([0.0, *speeds], speeds)]
    assert max(steps) == pytest.approx(ACCELERATION * PERIOD)
    assert min(steps) == pytest.approx(-BRAKING * PERIOD)
    assert all(step >= -ACCELERATION * PERIOD - 1e-9
               for step, speed in zip(steps, speeds) if speed < 0.0)


def test_the_space_bar_stops_at_once_and_until_the_next_key():
    hand = Hand()
    hand.hold(DriveKey.FORWARD, 2.0)
    hand.pilot.press(DriveKey.LEFT, hand.time)
    hand.wait(0.2)
    hand.pilot.press(DriveKey.STOP, hand.time)
    assert hand.wait(PERIOD) == (0.0, 0.0)
    assert hand.wait(2.0) == (0.0, 0.0)
    assert hand.hold(DriveKey.FORWARD, 1.0)[0] > 0.0


def test_a_held_key_for_turning_keeps_the_speed():
    hand = Hand()
    hand.hold(DriveKey.FORWARD, 1.0)
    assert hand.hold(DriveKey.RIGHT, 3.0) == pytest.approx((SPEED, -YAW_RATE))
    assert hand.hold(DriveKey.FORWARD, 1.5) == pytest.approx((SPEED, 0.0))  # straight again


def test_a_turn_does_not_revive_a_speed_that_has_ended():
    hand = Hand()
    hand.hold(DriveKey.FORWARD, 1.0)
    hand.wait(1.0)
    assert hand.hold(DriveKey.LEFT, 1.0)[0] == 0.0


def test_speed_steps_have_limits():
    hand = Hand()
    hand.pilot.press(DriveKey.FASTER, 0.0)
    assert hand.pilot.limits == pytest.approx((SPEED * STEP_FACTOR, YAW_RATE * STEP_FACTOR))
    for key, scale in ((DriveKey.FASTER, MAX_SCALE), (DriveKey.SLOWER, MIN_SCALE)):
        for _ in range(100):
            hand.pilot.press(key, 0.0)
        assert hand.pilot.limits == pytest.approx((SPEED * scale, YAW_RATE * scale))
    assert hand.wait(1.0) == (0.0, 0.0)  # these keys do not drive


def test_a_pause_of_the_program_is_no_time_to_accelerate():
    pilot = Teleoperation(1.0)
    assert pilot.step(0.0) == (0.0, 0.0)
    pilot.press(DriveKey.FORWARD, 9.9)
    assert pilot.step(10.0)[0] <= 0.1 * ACCELERATION + 1e-9


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_is_a_flag_and_the_handlers_return(number):
    before = [signal.getsignal(one) for one in SIGNALS]
    with StopRequest() as stopped:
        assert not stopped
        os.kill(os.getpid(), number)
        assert stopped
        os.kill(os.getpid(), number)  # repeated: nothing is interrupted
    assert [signal.getsignal(one) for one in SIGNALS] == before


def test_output_after_the_terminal_was_closed_is_discarded():
    code = ('import os, signal; from smart_tire.cli._keyboard import StopRequest\n'
            'with StopRequest() as stopped:\n'
            '    print("before", flush=True); os.kill(os.getpid(), signal.SIGHUP)\n'
            '    print("after", flush=True); assert stopped')
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, 'before\n', '')
