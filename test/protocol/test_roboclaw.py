"""
RoboClaw packet serial.

The manual prints no example packets, but each command's layout and the CRC's C code. The
packets here are written out by hand from these; their CRCs are computed by a transcription of
the manual's bitwise rule, not by the table that the package uses.
"""

from hypothesis import given, strategies as st
import pytest
from smart_tire.errors import FrameError
from smart_tire.protocol import roboclaw
from smart_tire.protocol.roboclaw import (
    count_step, decode_reply, encode_reply, encode_request, Request, RequestDeframer)

REQUESTS = [  # "Send:" of the manual; requests that read carry no CRC there
    (Request(0x80, roboclaw.READ_ENCODERS, ()), '80 4e'),
    (Request(0x81, roboclaw.READ_SPEEDS, ()), '81 4f'),
    (Request(0x80, roboclaw.READ_TIMEOUT, ()), '80 0f'),
    (Request(0x80, roboclaw.READ_BATTERY, ()), '80 18'),
    (Request(0x87, roboclaw.READ_STATUS, ()), '87 5a'),
    (Request(0x80, roboclaw.SET_TIMEOUT, (3,)), '80 0e 03 crc'),
    (Request(0x80, roboclaw.RESET_ENCODERS, ()), '80 14 crc'),
    (Request(0x80, roboclaw.SET_ENCODER_1, (0x12345678,)), '80 16 12345678 crc'),
    (Request(0x80, roboclaw.SET_ENCODER_2, (0xFFFFFFFF,)), '80 17 ffffffff crc'),
    (Request(0x81, roboclaw.SET_DUTY, (-32768, 32767)), '81 22 8000 7fff crc'),
]
REPLIES = [  # "Receive:" of the manual
    (0x80, roboclaw.READ_ENCODERS, (1, 0xFFFFFFFE), '00000001 fffffffe crc'),
    (0x81, roboclaw.READ_SPEEDS, (637, -2), '0000027d fffffffe crc'),
    (0x80, roboclaw.READ_TIMEOUT, (3,), '03 crc'),
    (0x80, roboclaw.READ_BATTERY, (300,), '012c crc'),  # "300 = 30v"
    (0x80, roboclaw.READ_STATUS, (0x8000,), '8000 crc'),
    (0x80, roboclaw.SET_DUTY, (), 'ff'),
    (0x80, roboclaw.RESET_ENCODERS, (), 'ff'),
]


def manual_crc(packet):
    """Return the CRC by the rule of the manual's "CRC16 Checksum Calculation"."""
    crc = 0
    for byte in packet:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc.to_bytes(2, 'big')


def packet_bytes(text, covered=b''):
    """Return the bytes of ``text``; ``crc`` at its end covers ``covered`` and what is before."""
    body = bytes.fromhex(text.removesuffix('crc'))
    return body + manual_crc(covered + body) if text.endswith('crc') else body


@pytest.mark.parametrize('request_, text', REQUESTS)
def test_documented_requests_encode_and_decode(request_, text):
    packet = packet_bytes(text)
    assert encode_request(request_.address, request_.command, *request_.values) == packet
    assert request_.command.request_size == len(packet)
    assert list(RequestDeframer().feed(packet)) == [request_]


@pytest.mark.parametrize('address, command, values, text', REPLIES)
def test_documented_replies_encode_and_decode(address, command, values, text):
    packet = packet_bytes(text, bytes((address, command.code)))
    assert encode_reply(address, command, *values) == packet
    assert command.reply_size == len(packet)
    assert decode_reply(address, command, packet) == values


def test_requests_survive_any_split():
    stream = b''.join(packet_bytes(text) for _, text in REQUESTS)
    for cut in range(len(stream) + 1):
        deframer = RequestDeframer()
        found = [*deframer.feed(stream[:cut]), *deframer.feed(stream[cut:])]
        assert found == [request for request, _ in REQUESTS]
        assert (deframer.bad_frames, deframer.skipped_bytes) == (0, 0)


@pytest.mark.parametrize('noise', ['00', '80 ff', 'ff ff', '7f 4e', '88 4e', '80 0e 03 0000'])
def test_a_request_behind_noise_is_understood(noise):
    deframer = RequestDeframer()
    noise = bytes.fromhex(noise)
    assert list(deframer.feed(noise + packet_bytes('81 22 0001 0002 crc'))) == [
        Request(0x81, roboclaw.SET_DUTY, (1, 2))]
    assert deframer.skipped_bytes == len(noise)
    assert deframer.bad_frames == (len(noise) == 5)


def test_silence_discards_the_part_of_a_packet():
    deframer = RequestDeframer()
    assert list(deframer.feed(packet_bytes('80 22 0001 0002 crc')[:5])) == []
    deframer.clear()
    assert list(deframer.feed(b'\x80\x4e')) == [Request(0x80, roboclaw.READ_ENCODERS, ())]
    assert deframer.skipped_bytes == 5


@pytest.mark.parametrize('address, command, reply, message', [
    (0x80, roboclaw.READ_ENCODERS, b'', 'has 0 bytes, expected 10'),
    (0x80, roboclaw.READ_ENCODERS, bytes(11), 'has 11 bytes, expected 10'),
    (0x80, roboclaw.READ_ENCODERS, bytes(10), '0x80 to command 78 has a wrong CRC'),
    (0x80, roboclaw.SET_DUTY, b'', 'has 0 bytes, expected 1'),
    (0x80, roboclaw.SET_DUTY, b'\x00', 'is 00, expected ff')])
def test_a_wrong_reply_is_refused_with_its_reason(address, command, reply, message):
    with pytest.raises(FrameError, match=message):
        decode_reply(address, command, reply)


@pytest.mark.parametrize('address, command', [(0x81, roboclaw.READ_ENCODERS),
                                              (0x80, roboclaw.READ_SPEEDS)])
def test_the_answer_of_another_board_or_to_another_question_is_refused(address, command):
    reply = encode_reply(0x80, roboclaw.READ_ENCODERS, 5, 6)
    with pytest.raises(FrameError, match='wrong CRC'):
        decode_reply(address, command, reply)


@given(st.integers(0, 2**32 - 1), st.integers(-2**31, 2**31 - 1))
def test_a_step_of_the_encoder_is_found_across_the_wrap(old, step):
    assert count_step((old + step) % roboclaw.COUNT_WRAP, old) == step


@pytest.mark.parametrize('duty, code', [(0.0, 0), (1.0, 32767), (-1.0, -32767), (2.0, 32767),
                                        (-7.0, -32767), (0.5, 16384)])
def test_duties_are_scaled_and_clipped(duty, code):
    assert roboclaw.duty_code(duty) == code
    assert roboclaw.duty_from_code(code) == pytest.approx(max(-1.0, min(1.0, duty)), abs=2e-5)


def test_the_lowest_code_is_full_duty_backwards():
    assert roboclaw.duty_from_code(-32768) == -1.0


@pytest.mark.parametrize('seconds, code', [(0.3, 3), (0.25, 3), (0.301, 4), (0.001, 1), (0.0, 1),
                                           (25.5, 255), (99.0, 255), (0.7, 7), (1.1, 11)])
def test_a_timeout_is_rounded_up_and_never_switched_off(seconds, code):
    assert roboclaw.timeout_code(seconds) == code
