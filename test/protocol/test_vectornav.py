"""VectorNav binary output, against the examples in the VN-100 manual."""

from dataclasses import replace
import math
import struct

from hypothesis import given, settings, strategies as st
import pytest
from smart_tire.errors import FrameError
from smart_tire.protocol import vectornav
from smart_tire.protocol.vectornav import BinaryDeframer, decode_binary, encode_binary, Field
from smart_tire.samples import ImuSample

# "VN-100 User Manual" UM001, 4.3.7 "Example Cases": group 1 with yaw, pitch and roll, and then
# group 3 besides. The second is printed with 0x0001 for the fields of group 3; its CRC is the
# one of 0x0020, a field of four bytes as is shown.
EXAMPLE_1 = bytes.fromhex('fa 01 0800 93502e42 833ef13f 48b504bb 9288')
EXAMPLE_2 = bytes.fromhex('fa 05 0800 2000 a4150242 4ddfeb3f f61a36be bf2da441 a83a')
# VectorNav's C library, example of its UART protocol: TimeStartup, then yaw, pitch and roll.
EXAMPLE_3 = bytes.fromhex('fa 01 0900 700500030a000000 480e2c42 084c37c1 10388bc2 d4cb')
EXAMPLE_2_AS_PRINTED = EXAMPLE_2[:4] + b'\x01' + EXAMPLE_2[5:]

f32 = st.floats(-100.0, 100.0, width=32)
vectors = st.tuples(f32, f32, f32)
SAMPLE = ImuSample(5, (0.5, -1.5, 9.75), (0.25, -0.125, 2.0), (0.5, -0.5, 0.5, 0.5))


@pytest.mark.parametrize('frame, angles', [
    (EXAMPLE_1, (43.578686, 1.8847202, -2.0249654e-3)),
    (EXAMPLE_2, (32.521133, 1.8427521, -1.7783722e-1)),
    (EXAMPLE_3, (43.0139465, -11.4560623, -69.6095))])
def test_published_frames_decode_and_encode(frame, angles):
    (body,) = BinaryDeframer().feed(frame)
    header = 1 + 2 * body[0].bit_count()
    assert vectornav.payload_size(body[:header]) == len(body) - header
    first = header + (8 if body[1] & Field.TIME_STARTUP else 0)
    assert struct.unpack_from('<3f', body, first) == pytest.approx(angles, rel=1e-7)
    assert vectornav.encode_frame(body) == frame


def test_the_misprinted_frame_is_refused_and_the_one_behind_it_is_not():
    bodies = list(BinaryDeframer().feed(EXAMPLE_2_AS_PRINTED + EXAMPLE_1))
    assert bodies == [EXAMPLE_1[1:-2]]


def test_a_frame_without_acceleration_is_refused_by_name():
    with pytest.raises(FrameError, match='fields 0x0008, expected acceleration'):
        decode_binary(EXAMPLE_1[1:-2])


def test_right_and_down_become_left_and_up():
    body = (b'\x01' + struct.pack('<H', Field.TIME_STARTUP | Field.ANGULAR_RATE | Field.ACCEL)
            + struct.pack('<Q', 12_345_678_901)
            + struct.pack('<3f', 0.5, 0.25, -0.125) + struct.pack('<3f', 1.0, 2.0, -9.75))
    time, sample = decode_binary(body, stamp_ns=42)
    assert time == 12_345_678_901
    assert sample == ImuSample(42, (1.0, -2.0, 9.75), (0.5, -0.25, 0.125), None)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(st.integers(0, 2**64 - 1), vectors, vectors, st.integers(1, 0x7FFF))
def test_samples_survive_the_round_trip_with_any_mask_of_group_1(time, acceleration, rate, mask):
    mask |= Field.ACCEL | Field.ANGULAR_RATE
    sample = ImuSample(0, acceleration, rate)
    (body,) = BinaryDeframer().feed(
        vectornav.encode_frame(encode_binary(time, sample, mask)))
    device_time, decoded = decode_binary(body)
    assert device_time == (time if mask & Field.TIME_STARTUP else None)
    assert replace(decoded, orientation=None) == sample
    assert (decoded.orientation is None) == (not mask & Field.QUATERNION)


def test_the_uncompensated_pair_serves_where_the_compensated_fields_are_not_sent():
    body = encode_binary(1, SAMPLE, Field.TIME_STARTUP | Field.IMU)
    assert decode_binary(body, 5) == (1, replace(SAMPLE, orientation=None))
    mixed = encode_binary(1, SAMPLE, Field.IMU | Field.ACCEL)
    assert decode_binary(mixed, 5) == (None, replace(SAMPLE, orientation=None))


def test_the_attitude_survives_the_round_trip():
    _, decoded = decode_binary(encode_binary(0, SAMPLE, 0x0131), 5)
    assert decoded.orientation == pytest.approx(SAMPLE.orientation, abs=1e-6)


def test_a_frame_with_more_groups_is_read_by_its_group_1():
    first = encode_binary(77, SAMPLE)
    body = b'\x05' + first[1:3] + struct.pack('<H', 0x0010) + first[3:] + struct.pack('<f', 20.5)
    (found,) = BinaryDeframer().feed(vectornav.encode_frame(body))
    assert decode_binary(found, 5) == (77, replace(SAMPLE, orientation=None))


@pytest.mark.parametrize('header', ['01 0080', '02 0008', '08 0000', '05 0100 0040'])
def test_fields_of_unknown_size_are_no_header(header):
    assert vectornav.payload_size(bytes.fromhex(header)) == 0


@pytest.mark.parametrize('body, message', [
    (b'', 'groups , expected group 1'), (b'\x02\x01\x00' + bytes(8), 'groups 02'),
    (encode_binary(0, SAMPLE)[:-1], 'has 34 bytes, expected 35')])
def test_a_body_that_can_not_be_decoded_is_refused_with_its_reason(body, message):
    with pytest.raises(FrameError, match=message):
        decode_binary(body)


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf, 3e38])
@pytest.mark.parametrize('part, name', [
    ('acceleration', 'acceleration'), ('rate', 'angular rate'), ('orientation', 'orientation')])
@pytest.mark.parametrize('fields', [Field.ACCEL | Field.ANGULAR_RATE, Field.IMU])
def test_what_is_no_measurement_is_refused_by_name(value, part, name, fields):
    numbers = (value, *getattr(SAMPLE, part)[1:])
    body = encode_binary(0, replace(SAMPLE, **{part: numbers}), fields | Field.QUATERNION)
    with pytest.raises(FrameError, match=name):
        decode_binary(body)


def test_fields_that_do_not_exist_are_not_encoded():
    with pytest.raises(FrameError, match='0x8000'):
        encode_binary(0, SAMPLE, 0x8000)
