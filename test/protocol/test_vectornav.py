# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""VectorNav binary output, against the messages of test/data/frames/vectornav_binary.txt."""

from dataclasses import replace
import struct

from hypothesis import given, settings, strategies as st
import pytest
from smart_tire.errors import FrameError
from smart_tire.protocol import vectornav
from smart_tire.protocol.vectornav import (
    BinaryDeframer, decode_binary, encode_binary, Field, FIELD_SIZES)
from smart_tire.samples import ImuSample
from support.frames import each_frame, frames

FRAMES = frames('vectornav_binary')
SAMPLE_VALUES = ('acceleration', 'rate', 'orientation')

f32 = st.floats(-100.0, 100.0, width=32)
vectors = st.tuples(f32, f32, f32)
SAMPLE = ImuSample(5, (0.5, -1.5, 9.75), (0.25, -0.125, 2.0), (0.5, -0.5, 0.5, 0.5))


def body_of(frame):
    """Return the bytes between sync byte and CRC."""
    return frame.data[1:-2]


def test_the_sizes_of_all_fields_have_the_sums_of_the_table_in_the_manual():
    assert [sum(group) for group in FIELD_SIZES] == [198, 60, 152, 156, 190, 262, 156]
    assert [sum(bit) for bit in zip(*FIELD_SIZES)] == [
        38, 80, 72, 76, 54, 96, 120, 76, 76, 77, 73, 130, 110, 60, 12, 24]


@each_frame('vectornav_binary', 'yaw_pitch_roll')
def test_published_angles_are_where_the_field_table_puts_them(frame):
    numbers = struct.unpack_from('<3f', body_of(frame), frame['payload_start'])
    assert numbers == pytest.approx(frame['yaw_pitch_roll'], rel=1e-7)


@each_frame('vectornav_binary', *SAMPLE_VALUES)
def test_a_message_decodes_to_the_documented_sample(frame):
    time, sample = decode_binary(body_of(frame), stamp_ns=42)
    assert time == frame['time_ns']
    assert (sample.stamp_ns, sample.acceleration, sample.rate) == (
        42, frame['acceleration'], frame['rate'])
    if frame['orientation'] is None:
        assert sample.orientation is None
    else:
        assert sample.orientation == pytest.approx(frame['orientation'], abs=1e-7)


@each_frame('vectornav_binary', *SAMPLE_VALUES, 'fields')
def test_a_documented_sample_encodes_to_the_bytes_of_its_message(frame):
    sample = ImuSample(0, *(frame[key] for key in SAMPLE_VALUES))
    assert encode_binary(frame['time_ns'], sample, frame['fields']) == body_of(frame)


def test_the_misprinted_message_is_refused_and_the_one_behind_it_is_not():
    good = FRAMES['manual_example_1']
    bodies = BinaryDeframer().extract(FRAMES['manual_example_2_as_printed'].data + good.data)
    assert list(bodies) == [body_of(good)]


def test_a_message_without_acceleration_is_refused_with_its_fields():
    with pytest.raises(FrameError, match='fields 0x0008, expected acceleration'):
        decode_binary(body_of(FRAMES['manual_example_1']))


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.integers(0, 2**64 - 1), vectors, vectors, st.integers(1, 0x7FFF))
def test_samples_survive_the_round_trip_with_any_mask_of_group_1(time, acceleration, rate, mask):
    mask |= Field.ACCEL | Field.ANGULAR_RATE
    sample = ImuSample(0, acceleration, rate)
    (body,) = BinaryDeframer().extract(
        vectornav.encode_frame(encode_binary(time, sample, mask)))
    device_time, decoded = decode_binary(body)
    assert device_time == (time if mask & Field.TIME_STARTUP else None)
    assert replace(decoded, orientation=None) == sample
    assert (decoded.orientation is None) == (not mask & Field.QUATERNION)


def test_uncompensated_values_fill_in_for_missing_compensated_fields_only():
    body = encode_binary(1, SAMPLE, Field.IMU | Field.ACCEL)
    assert decode_binary(body, 5) == (None, replace(SAMPLE, orientation=None))
    uncompensated = body[:-24] + bytes(12) + body[-12:]  # other acceleration in Imu
    assert decode_binary(uncompensated, 5) == decode_binary(body, 5)


@pytest.mark.parametrize('header', ['01 0080', '02 0008', '08 0000', '05 0100 0040'])
def test_a_header_with_undefined_fields_is_invalid(header):
    assert vectornav.payload_size(bytes.fromhex(header)) == 0


@pytest.mark.parametrize('body, message', [
    (b'', 'groups , expected group 1'), (b'\x02\x01\x00' + bytes(8), 'groups 02'),
    (body_of(FRAMES['default_fields'])[:-1], 'has 34 bytes, expected 35')])
def test_an_invalid_body_is_refused_with_the_reason(body, message):
    with pytest.raises(FrameError, match=message):
        decode_binary(body)


def test_undefined_fields_are_not_encoded():
    with pytest.raises(FrameError, match='undefined fields in 0x8000'):
        encode_binary(0, SAMPLE, 0x8000)
