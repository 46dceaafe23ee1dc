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
RoboClaw packet serial, against the packets of test/data/frames/roboclaw.txt.

Basicmicro prints no example packets. These are written by hand from the manual's layout of each
command; test_deframers.py verifies the CRC with published values.
"""

import math

from hypothesis import given, strategies as st
import pytest
from smart_tire.errors import FrameError
from smart_tire.protocol import roboclaw
from smart_tire.protocol.roboclaw import (
    count_step, decode_reply, encode_reply, encode_request, Request, RequestDeframer)
from support.frames import each_frame, frames

FRAMES = frames('roboclaw')
REQUESTS = [frame for frame in FRAMES.values() if 'sent' in frame.values]
SET_DUTY = FRAMES['set_duty_smallest']
ENCODERS = FRAMES['encoders']
SPEEDS = roboclaw.Command(79, reply='>ii')  # of the same size


def command_of(frame):
    """Return the command that the file names for ``frame``."""
    return getattr(roboclaw, frame['command'])


def request_of(frame):
    """Return the request that the file gives for ``frame``."""
    return Request(frame['address'], command_of(frame), frame['sent'])


def decoded(deframer, chunk):
    """Return the requests that ``chunk`` completes."""
    return list(map(roboclaw.decode_request, deframer.extract(chunk)))


@each_frame('roboclaw', 'sent')
def test_a_documented_request_encodes_and_decodes(frame):
    assert encode_request(frame['address'], command_of(frame), *frame['sent']) == frame.data
    assert command_of(frame).request_size == len(frame.data)
    assert decoded(RequestDeframer(), frame.data) == [request_of(frame)]


@each_frame('roboclaw', 'received')
def test_a_documented_reply_encodes_and_decodes(frame):
    address, command = frame['address'], command_of(frame)
    assert encode_reply(address, command, *frame['received']) == frame.data
    assert command.reply_size == len(frame.data)
    assert decode_reply(address, command, frame.data) == frame['received']


@each_frame('roboclaw', 'text')
def test_a_documented_text_encodes_and_decodes(frame):
    address, command = frame['address'], command_of(frame)
    assert roboclaw.encode_text_reply(address, command, frame['text']) == frame.data
    assert roboclaw.decode_text_reply(address, command, frame.data) == frame['text']
    assert len(frame.data) <= command.reply_size == 50


@each_frame('roboclaw', 'request')
def test_the_crc_of_a_reply_covers_address_and_command_of_its_request(frame):
    assert encode_request(frame['address'], command_of(frame)) == bytes.fromhex(frame['request'])


def test_every_command_has_a_documented_request():
    assert {command_of(frame) for frame in REQUESTS} == set(roboclaw.COMMANDS.values())


def test_requests_survive_any_split():
    stream = b''.join(frame.data for frame in REQUESTS)
    for cut in range(len(stream) + 1):
        deframer = RequestDeframer()
        found = [*decoded(deframer, stream[:cut]), *decoded(deframer, stream[cut:])]
        assert found == [request_of(frame) for frame in REQUESTS]
        assert (deframer.bad_frames, deframer.skipped_bytes) == (0, 0)


@pytest.mark.parametrize('noise', ['00', '80 ff', 'ff ff', '7f 4e', '88 4e', '80 0e 03 0000'])
def test_a_request_behind_noise_is_decoded(noise):
    deframer = RequestDeframer()
    noise = bytes.fromhex(noise)
    assert decoded(deframer, noise + SET_DUTY.data) == [request_of(SET_DUTY)]
    assert deframer.skipped_bytes == len(noise)
    assert deframer.bad_frames == (len(noise) == 5)


def test_a_pause_discards_an_incomplete_packet():
    deframer = RequestDeframer()
    assert list(deframer.extract(SET_DUTY.data[:5])) == []
    deframer.clear()
    request = FRAMES['read_encoders']
    assert decoded(deframer, request.data) == [request_of(request)]
    assert deframer.skipped_bytes == 5


@pytest.mark.parametrize('address, command, reply, message', [
    (0x80, roboclaw.READ_ENCODERS, b'', 'has 0 bytes, expected 10'),
    (0x80, roboclaw.READ_ENCODERS, ENCODERS.data + b'\0', 'has 11 bytes, expected 10'),
    (0x80, roboclaw.READ_ENCODERS, b'\1' + ENCODERS.data[1:],
     '0x80 to command 78 has a wrong CRC'),
    (0x80, roboclaw.SET_DUTY, b'', 'has 0 bytes, expected 1'),
    (0x80, roboclaw.SET_DUTY, b'\x00', 'is 00, expected ff')])
def test_an_invalid_reply_is_refused_with_the_reason(address, command, reply, message):
    with pytest.raises(FrameError, match=message):
        decode_reply(address, command, reply)


@pytest.mark.parametrize('address, command', [(0x81, roboclaw.READ_ENCODERS),
                                              (0x80, SPEEDS)])
def test_a_reply_of_another_board_or_to_another_command_is_refused(address, command):
    with pytest.raises(FrameError, match='wrong CRC'):
        decode_reply(address, command, ENCODERS.data)


@given(st.integers(0, 2**32 - 1), st.integers(-2**31, 2**31 - 1))
def test_an_encoder_difference_is_correct_across_the_wrap(old, step):
    assert count_step((old + step) % roboclaw.COUNT_WRAP, old) == step


@pytest.mark.parametrize('duty, code', [(0.0, 0), (1.0, 32767), (-1.0, -32767), (2.0, 32767),
                                        (-7.0, -32767), (0.5, 16384)])
def test_duties_are_scaled_and_clipped(duty, code):
    assert roboclaw.duty_code(duty) == code
    assert roboclaw.duty_from_code(code) == pytest.approx(max(-1.0, min(1.0, duty)), abs=2e-5)


def test_the_lowest_code_is_full_reverse_duty():
    assert roboclaw.duty_from_code(-32768) == -1.0


@pytest.mark.parametrize('current, code', [(0.0, 0), (1.5, 150), (-0.01, -1), (0.004, 0),
                                           (-30.0, -3000), (326.0, 32600)])
def test_currents_are_scaled(current, code):
    assert roboclaw.current_code(current) == code
    assert roboclaw.current_from_code(code) == pytest.approx(current, abs=0.005)


@pytest.mark.parametrize('current', [327.68, 400.0, -400.0])
def test_a_current_beyond_the_range_of_the_code_is_unknown(current):
    assert abs(roboclaw.current_code(current)) == 32767
    assert math.isnan(roboclaw.current_from_code(roboclaw.current_code(current)))


@pytest.mark.parametrize('frame', ['currents', 'currents_limits'])
def test_documented_currents_are_signed(frame):
    currents = [roboclaw.current_from_code(code) for code in FRAMES[frame]['received']]
    if frame == 'currents':
        assert currents == pytest.approx([1.5, -0.01])
    else:
        assert all(map(math.isnan, currents))


@pytest.mark.parametrize('seconds, code', [(0.3, 3), (0.25, 3), (0.301, 4), (0.001, 1), (0.0, 1),
                                           (25.5, 255), (99.0, 255), (0.7, 7), (1.1, 11)])
def test_a_timeout_is_rounded_up_and_never_disabled(seconds, code):
    assert roboclaw.timeout_code(seconds) == code
