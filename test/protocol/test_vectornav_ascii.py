# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""VectorNav sentences, against those of test/data/frames/vectornav_ascii.txt."""

from dataclasses import replace
import math

from hypothesis import given, settings, strategies as st
import pytest
from smart_tire.errors import FrameError
from smart_tire.protocol.vectornav_ascii import (
    AsciiDeframer, crc_digits, decode_ymr, encode_sentence, encode_ymr)
from smart_tire.samples import ImuSample
from support.frames import each_frame, frames
from support.rotations import rotate

FRAMES = frames('vectornav_ascii')
YMR = FRAMES['library_ymr'].data
YMR_VALUES = ('yaw', 'magnetic', 'acceleration', 'rate')


def body_of(frame):
    """Return the characters between ``$`` and ``*``."""
    return frame.data[1:].partition(b'*')[0]


BODY = body_of(FRAMES['library_ymr'])


@each_frame('vectornav_ascii', *YMR_VALUES)
def test_a_ymr_decodes_to_its_numbers_in_rep_103_axes(frame):
    time, sample = decode_ymr(body_of(frame), stamp_ns=9)
    assert time is None
    assert sample.stamp_ns == 9
    assert sample.acceleration == frame['acceleration']
    assert sample.rate == frame['rate']


@each_frame('vectornav_ascii', *YMR_VALUES)
def test_a_decoded_ymr_encodes_to_the_same_characters(frame):
    _, sample = decode_ymr(body_of(frame))
    assert encode_ymr(sample, magnetic=frame['magnetic']) == body_of(frame)


@each_frame('vectornav_ascii', *YMR_VALUES)
def test_the_heading_is_converted_from_north_clockwise_to_east_counterclockwise(frame):
    _, sample = decode_ymr(body_of(frame))
    forward = rotate(sample.orientation, (1.0, 0.0, 0.0))
    yaw = math.degrees(math.atan2(forward[1], forward[0]))
    assert yaw == pytest.approx(90.0 - frame['yaw'], abs=1e-9)


@each_frame('vectornav_ascii', *YMR_VALUES)
def test_recorded_gravity_is_vertical_in_the_world_frame(frame):
    """The tilt from the attitude agrees with the one from the accelerometer to 1.5 degrees."""
    _, sample = decode_ymr(body_of(frame))
    x, y, z = rotate(sample.orientation, sample.acceleration)
    assert math.degrees(math.atan2(math.hypot(x, y), z)) < 1.5


@each_frame('vectornav_ascii', 'header')
def test_another_published_sentence_is_not_decoded_as_ymr(frame):
    assert body_of(frame).split(b',')[0] == frame['header']
    with pytest.raises(FrameError, match="expected b'VNYMR' with 12"):
        decode_ymr(body_of(frame))


def test_both_kinds_of_checksum_are_accepted_in_either_case():
    with_crc = FRAMES['library_ymr_with_crc'].data
    lower_case = with_crc[:-6] + with_crc[-6:].lower()
    assert lower_case != with_crc
    assert list(AsciiDeframer().extract(with_crc + YMR + lower_case)) == [BODY] * 3
    assert with_crc == encode_sentence(BODY, crc_digits)


@pytest.mark.parametrize('wrong', [YMR.replace(b'*69', b'*68'), YMR.replace(b'*69', b'*XX'),
                                   YMR.replace(b'*69', b''), YMR.replace(b'100.949', b'100.948')])
def test_a_wrong_or_missing_checksum_is_refused(wrong):
    assert wrong != YMR
    deframer = AsciiDeframer()
    assert list(deframer.extract(wrong + YMR)) == [BODY]
    assert deframer.bad_frames == 1


def test_a_sentence_without_line_end_is_accepted():
    assert list(AsciiDeframer().extract(YMR.rstrip() + YMR)) == [BODY] * 2


@settings(max_examples=100, deadline=None, derandomize=True)
@given(*[st.tuples(*[st.integers(-50_000, 50_000)] * 3)] * 2)
def test_samples_survive_the_round_trip(milli, micro):
    sample = ImuSample(3, tuple(n / 1e3 for n in milli), tuple(n / 1e6 for n in micro))
    (body,) = AsciiDeframer().extract(encode_sentence(encode_ymr(sample), crc_digits))
    _, decoded = decode_ymr(body, 3)
    assert replace(decoded, orientation=None) == sample


def test_counter_and_status_may_follow():
    _, plain = decode_ymr(BODY)
    assert decode_ymr(BODY + b',T1162704,S0') == (None, plain)


@pytest.mark.parametrize('body', [
    b'VNYMR', b'VNYMR,1,2,3', BODY + b',1.0', BODY.replace(b'YMR', b'YPR')])
def test_a_sentence_with_another_layout_is_refused(body):
    with pytest.raises(FrameError, match="expected b'VNYMR' with 12"):
        decode_ymr(body)


@pytest.mark.parametrize('index', range(12))
@pytest.mark.parametrize('field, message', [
    (b'abc', 'not a number'), (b'', 'not a number'), (b'nan', 'not finite'),
    (b'inf', 'not finite'), (b'-inf', 'not finite'), (b'1e999', 'not finite')])
def test_any_field_that_is_not_a_finite_number_is_refused(index, field, message):
    header, *fields = BODY.split(b',')
    fields[index] = field
    with pytest.raises(FrameError, match=message):
        decode_ymr(b','.join([header, *fields]))


@pytest.mark.parametrize('index, field, message', [
    (0, b'+1e308', 'yaw, pitch and roll'), (2, b'-361', 'yaw, pitch and roll'),
    (6, b'1001', 'acceleration'), (11, b'1e30', 'angular rate')])
def test_a_value_that_no_sensor_measures_is_refused_by_name(index, field, message):
    header, *fields = BODY.split(b',')
    fields[index] = field
    with pytest.raises(FrameError, match=message):
        decode_ymr(b','.join([header, *fields]))
