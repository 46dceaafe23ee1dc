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

"""Keys of a terminal: decoding, and a terminal that is restored however the program ends."""

from __future__ import annotations

from contextlib import suppress
import io
import os
import termios
import time

import pytest

from smart_tire.cli import _keyboard
from smart_tire.cli._keyboard import Key, Keyboard, KeyDecoder
from smart_tire.errors import ParameterError

ARROWS = [Key.FORWARD, Key.BACKWARD, Key.RIGHT, Key.LEFT]


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
    assert KeyDecoder().feed(data) == ARROWS


def test_a_sequence_may_be_split_anywhere():
    data = b'\x1b[Aq\x1bOB+'
    for first in range(len(data)):
        decoder = KeyDecoder()
        keys = decoder.feed(data[:first]) + decoder.feed(data[first:])
        assert keys == [Key.FORWARD, Key.QUIT, Key.BACKWARD, Key.FASTER]


def test_a_sequence_that_was_completed_is_not_decoded_again():
    decoder = KeyDecoder()
    assert decoder.feed(b'\x1b[') == [] and decoder.feed(b'A') == [Key.FORWARD]
    assert decoder.feed(b'q') == [Key.QUIT] and decoder.feed(b'') == []


def test_escape_before_a_letter_is_no_sequence():
    assert KeyDecoder().feed(b'\x1bw ') == [Key.FORWARD, Key.STOP]


def test_keys_arrive_without_enter_and_are_not_echoed(terminal):
    user, stream = terminal
    with Keyboard(stream) as keyboard:
        begin = time.monotonic()
        assert keyboard.pressed() == []
        assert time.monotonic() - begin < 0.5  # commands are sent meanwhile
        os.write(user, b'w ')
        assert keyboard.pressed() == [Key.FORWARD, Key.STOP]
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
            os.write(user, b'www')  # keys that the shell must not get
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
        assert keyboard.pressed() == [Key.QUIT]


def test_a_terminal_that_cannot_be_read_is_the_end(terminal, monkeypatch):
    def fail(*_):
        raise OSError(5, 'Input/output error')

    user, stream = terminal
    with Keyboard(stream) as keyboard:
        os.write(user, b'w')
        monkeypatch.setattr(_keyboard.os, 'read', fail)
        assert keyboard.pressed() == [Key.QUIT]
        monkeypatch.undo()


def test_a_pipe_is_refused():
    with pytest.raises(ParameterError, match='not a terminal'):
        Keyboard(io.StringIO())
