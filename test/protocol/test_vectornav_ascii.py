"""VectorNav sentences, against those that VectorNav publishes."""

from dataclasses import replace
import math

from hypothesis import given, settings, strategies as st
import pytest
from smart_tire.errors import FrameError
from smart_tire.protocol import vectornav_ascii
from smart_tire.protocol.vectornav_ascii import (
    AsciiDeframer, decode_ymr, encode_sentence, encode_ymr)
from smart_tire.samples import ImuSample

# VectorNav's C library, example of its UART protocol.
YMR = (b'$VNYMR,+100.949,-007.330,+000.715,-00.0049,-00.2449,+00.5397,'
       b'-01.258,-00.100,-09.701,-00.000018,+00.001122,-00.000551*69\r\n')
# "VN-100 User Manual" UM001: 7.2.3 (register 27 holds the same numbers), 7.2.1; "VN-200 User
# Manual" UM004: 5.11.1 (without and with a counter), 5.11.7.
PUBLISHED = [
    YMR,
    b'$VNRRG,27,+006.380,+000.023,-001.953,+1.0640,-0.2531,+3.0614,+00.005,+00.344,-09.758,'
    b'-0.001222,-0.000450,-0.001218*4F\r\n',
    b'$VNRRG,8,+006.271,+000.031,-002.000*66\r\n',
    b'$VNYPR,+010.071,+000.278,-002.026*60\r\n',
    b'$VNYPR,+010.071,+000.278,-002.026,T1162704*2F\r\n',
    b'$VNERR,03*72\r\n']


@pytest.mark.parametrize('sentence', PUBLISHED)
def test_published_sentences_decode_and_encode(sentence):
    (body,) = AsciiDeframer().feed(sentence)
    assert body == sentence[1:-5]
    assert encode_sentence(body) == sentence


def test_the_published_ymr_decodes_into_rep_103_and_encodes_back():
    time, sample = decode_ymr(YMR[1:-5], stamp_ns=9)
    assert time is None
    assert sample.stamp_ns == 9
    assert sample.acceleration == (-1.258, 0.100, 9.701)
    assert sample.rate == (-0.000018, -0.001122, 0.000551)
    assert encode_ymr(sample, magnetic=(-0.0049, -0.2449, 0.5397)) == YMR[1:-5]


def test_the_heading_is_turned_from_north_to_east():
    _, sample = decode_ymr(YMR[1:-5])
    x, y, z, w = sample.orientation
    yaw = math.degrees(math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
    assert yaw == pytest.approx(90.0 - 100.949, abs=1e-9)


def test_both_kinds_of_checksum_are_taken_in_either_case():
    body = YMR[1:-5]
    with_crc = encode_sentence(body, use_crc=True)
    assert len(with_crc) == len(YMR) + 2
    lower_case = with_crc[:-6] + with_crc[-6:].lower()
    assert lower_case != with_crc
    assert list(AsciiDeframer().feed(with_crc + YMR + lower_case)) == [body] * 3


@pytest.mark.parametrize('wrong', [YMR.replace(b'*69', b'*68'), YMR.replace(b'*69', b'*XX'),
                                   YMR.replace(b'*69', b''), YMR.replace(b'100.949', b'100.948')])
def test_a_wrong_or_missing_checksum_is_refused(wrong):
    deframer = AsciiDeframer()
    assert list(deframer.feed(wrong + YMR)) == [YMR[1:-5]]
    assert deframer.bad_frames == 1


def test_a_lost_line_end_costs_nothing():
    assert list(AsciiDeframer().feed(YMR.rstrip() + YMR)) == [YMR[1:-5]] * 2


@settings(max_examples=100, deadline=None, derandomize=True)
@given(*[st.tuples(*[st.integers(-50_000, 50_000)] * 3)] * 2)
def test_samples_survive_the_round_trip(milli, micro):
    sample = ImuSample(3, tuple(n / 1e3 for n in milli), tuple(n / 1e6 for n in micro))
    (body,) = AsciiDeframer().feed(encode_sentence(encode_ymr(sample), use_crc=True))
    _, decoded = decode_ymr(body, 3)
    assert replace(decoded, orientation=None) == sample


def test_counter_and_status_may_follow():
    _, plain = decode_ymr(YMR[1:-5])
    assert decode_ymr(YMR[1:-5] + b',T1162704,S0') == (None, plain)


@pytest.mark.parametrize('body', [
    b'VNERR,03', b'VNYMR', b'VNYMR,1,2,3', YMR[1:-5] + b',1.0', YMR[1:-5].replace(b'YMR', b'YPR')])
def test_another_sentence_is_refused_by_name(body):
    with pytest.raises(FrameError, match="expected b'VNYMR' with 12"):
        decode_ymr(body)


@pytest.mark.parametrize('place', range(12))
@pytest.mark.parametrize('field, message', [
    (b'abc', 'no number'), (b'', 'no number'), (b'nan', 'finite'), (b'inf', 'finite'),
    (b'-inf', 'finite'), (b'1e999', 'finite')])
def test_a_field_that_is_no_finite_number_is_refused_wherever_it_is(place, field, message):
    header, *fields = YMR[1:-5].split(b',')
    fields[place] = field
    with pytest.raises(FrameError, match=message):
        decode_ymr(b','.join([header, *fields]))


@pytest.mark.parametrize('place, field, message', [
    (0, b'+1e308', 'yaw, pitch and roll'), (2, b'-361', 'yaw, pitch and roll'),
    (6, b'1001', 'acceleration'), (11, b'1e30', 'angular rate')])
def test_a_number_beyond_any_sensor_is_refused_by_name(place, field, message):
    header, *fields = YMR[1:-5].split(b',')
    fields[place] = field
    with pytest.raises(FrameError, match=message):
        decode_ymr(b','.join([header, *fields]))


def test_a_line_without_end_is_bounded():
    deframer = AsciiDeframer()
    assert list(deframer.feed(b'$' + b'1' * vectornav_ascii.MAX_SENTENCE)) == []
    assert deframer.bad_frames == 1
    assert deframer.skipped_bytes == 1 + vectornav_ascii.MAX_SENTENCE
