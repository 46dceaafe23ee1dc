# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Xsens MTData2, against the messages of test/data/frames/xsens.txt."""

from dataclasses import replace
import math

from hypothesis import given, settings, strategies as st
import pytest
from smart_tire.errors import FrameError
from smart_tire.protocol import xsens
from smart_tire.protocol.xsens import decode_imu, encode_imu, Precision, XsensDeframer
from smart_tire.samples import ImuSample
from support.frames import each_frame, frames
from support.rotations import rotate

FRAMES = frames('xsens')
SAMPLE = ImuSample(5, (0.5, -1.5, 9.75), (0.25, -0.125, 2.0), (0.5, -0.5, 0.25, 0.75))
PRINTED = 5.1e-9  # half the last digit of eight decimals, and the rounding of that digit


def body_of(frame):
    """Return message identifier and data of a message that is not extended."""
    return frame.data[2:3] + frame.data[4:-1]


@each_frame('xsens', 'acceleration', 'rate')
def test_a_message_decodes_to_the_documented_sample(frame):
    time, sample = decode_imu(body_of(frame), stamp_ns=9)
    assert xsens.packet_counter(body_of(frame)) == frame['counter']
    assert time == frame['ticks'] * 100_000
    assert sample.stamp_ns == 9
    assert sample.acceleration == pytest.approx(frame['acceleration'], rel=0.0, abs=PRINTED)
    assert sample.rate == pytest.approx(frame['rate'], rel=0.0, abs=PRINTED)


@each_frame('xsens', 'quaternion')
def test_a_quaternion_decodes_to_the_documented_orientation(frame):
    _, sample = decode_imu(body_of(frame))
    w, x, y, z = frame['quaternion']
    assert sample.orientation == pytest.approx((x, y, z, w), rel=0.0, abs=PRINTED)


@each_frame('xsens', 'at_rest')
def test_recorded_gravity_is_vertical_in_the_world_frame(frame):
    """The tilt from the attitude agrees with the one from the accelerometer to 1.5 degrees."""
    _, sample = decode_imu(body_of(frame))
    x, y, z = rotate(sample.orientation, sample.acceleration)
    assert math.degrees(math.atan2(math.hypot(x, y), z)) < 1.5
    assert z == pytest.approx(9.8, abs=0.1)


@each_frame('xsens', 'precision')
def test_a_documented_sample_encodes_to_the_bytes_of_its_message(frame):
    w, x, y, z = frame['quaternion']
    sample = ImuSample(0, frame['acceleration'], frame['rate'], (x, y, z, w))
    body = encode_imu(frame['ticks'] * xsens.TICK_NS, sample, frame['counter'],
                      Precision[frame['precision']])
    assert body == body_of(frame)


def test_a_decoded_message_encodes_to_the_published_packets():
    body = body_of(FRAMES['mtig_710'])
    time, sample = decode_imu(body)
    packets = xsens.decode_packets(encode_imu(time, sample, 57285)) | {0xE020: b'\0\0\0\x81'}
    assert xsens.encode_packets(packets) == body


def test_a_recorded_fixed_point_number_decodes_and_encodes():
    frame = FRAMES['fixed_point_latitude']
    (number,) = xsens.decode_numbers(frame.data, Precision.FP16_32)
    assert number == pytest.approx(frame['number'], rel=0.0, abs=1e-12)
    assert xsens.encode_numbers((number,), Precision.FP16_32) == frame.data


@pytest.mark.parametrize('precision, step', [
    (Precision.FLOAT32, 0.0), (Precision.FLOAT64, 0.0), (Precision.FP12_20, 2.0**-20),
    (Precision.FP16_32, 2.0**-32)])
@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(0, 2**32 - 1), st.integers(0, 65535),
       *[st.tuples(*[st.floats(-limit, limit, width=32)] * count)
         for count, limit in ((3, 1000.0), (3, 100.0), (4, 1.0))])
def test_samples_survive_the_round_trip(precision, step, ticks, counter, acceleration, rate,
                                        orientation):
    sample = ImuSample(5, acceleration, rate, orientation)
    (body,) = XsensDeframer().extract(xsens.encode_message(
        encode_imu(ticks * xsens.TICK_NS, sample, counter, precision)))
    time, decoded = decode_imu(body, 5)
    assert time == ticks * xsens.TICK_NS
    assert xsens.packet_counter(body) == counter
    for part in ('acceleration', 'rate', 'orientation'):
        assert getattr(decoded, part) == pytest.approx(getattr(sample, part), rel=0.0,
                                                       abs=step / 2.0)


def test_a_packet_may_be_empty():
    packets = {xsens.ACCELERATION: b'', xsens.RATE_OF_TURN: b''}
    assert xsens.decode_packets(xsens.encode_packets(packets)) == packets


def test_the_device_time_wraps_like_a_32_bit_counter():
    time, _ = decode_imu(encode_imu(xsens.SAMPLE_TIME_WRAP_NS + 3 * xsens.TICK_NS, SAMPLE))
    assert time == 3 * xsens.TICK_NS


@pytest.mark.parametrize('size', [0, 254, 255, 256, xsens.MAX_DATA_LENGTH])
def test_long_messages_use_the_extended_length(size):
    body = b'\x36' + bytes(size)
    message = xsens.encode_message(body)
    assert len(message) == size + (5 if size < 255 else 7)
    assert list(XsensDeframer().extract(message)) == [body]


def test_a_message_that_is_too_long_is_not_encoded():
    with pytest.raises(FrameError, match='2049 bytes'):
        xsens.encode_message(bytes(2 + xsens.MAX_DATA_LENGTH))


@pytest.mark.parametrize('axes, is_enu', [(0x0, True), (0x4, False), (0x8, False)])
def test_an_orientation_in_axes_other_than_enu_is_left_out(axes, is_enu):
    packets = xsens.decode_packets(encode_imu(0, SAMPLE))
    packets[xsens.QUATERNION | axes] = packets.pop(xsens.QUATERNION)
    _, decoded = decode_imu(xsens.encode_packets(packets), 5)
    assert decoded == (SAMPLE if is_enu else replace(SAMPLE, orientation=None))


def test_time_and_counter_are_optional():
    packets = xsens.decode_packets(encode_imu(0, SAMPLE))
    del packets[xsens.SAMPLE_TIME_FINE], packets[xsens.PACKET_COUNTER]
    body = xsens.encode_packets(packets)
    assert decode_imu(body, 5) == (None, SAMPLE)
    assert xsens.packet_counter(body) is None


@pytest.mark.parametrize('body, message', [
    (b'', 'message is , expected 36'),
    (b'\x31', 'message is 31, expected 36'),
    (b'\x36\x10', 'packet 10 at 1'),
    (b'\x36\x10\x20\x02\x00', 'packet 102002 at 1 exceeds the 5 bytes'),
    (b'\x36\x10\x20\x02\x00\x00', 'packets 0x1020, expected acceleration')])
def test_an_invalid_message_is_refused_with_the_reason(body, message):
    with pytest.raises(FrameError, match=message):
        decode_imu(body)


@pytest.mark.parametrize('identifier, content, message', [
    (xsens.ACCELERATION, bytes(11), '0x4020 has 11 bytes, expected 12'),
    (xsens.RATE_OF_TURN, bytes(24), '0x8020 has 24 bytes, expected 12'),
    (xsens.SAMPLE_TIME_FINE, bytes(2), '0x1060 has 2 bytes, expected 4'),
    (xsens.ACCELERATION, b'\x7f\xc0\0\0' * 3, 'acceleration')])
def test_a_packet_with_invalid_content_is_refused_by_name(identifier, content, message):
    packets = xsens.decode_packets(encode_imu(0, SAMPLE)) | {identifier: content}
    with pytest.raises(FrameError, match=message):
        decode_imu(xsens.encode_packets(packets))


@pytest.mark.parametrize('precision, number', [(Precision.FLOAT32, 1e39),
                                               (Precision.FP12_20, 2048.0),
                                               (Precision.FP16_32, -32769.0)])
def test_numbers_out_of_range_are_not_encoded(precision, number):
    with pytest.raises(FrameError, match=precision.name):
        xsens.encode_numbers((number,), precision)


def test_the_counter_of_an_encoded_sample_begins_at_zero_and_wraps():
    sample = ImuSample(0, (0.0, 0.0, 9.81), (0.0, 0.0, 0.0))
    assert xsens.packet_counter(xsens.encode_imu(0, sample)) == 0
    assert xsens.packet_counter(xsens.encode_imu(0, sample, 65537)) == 1
