"""Xsens MTData2, against the example of the manufacturer's protocol documentation."""

from dataclasses import replace
import math

from hypothesis import given, settings, strategies as st
import pytest
from smart_tire.errors import FrameError
from smart_tire.protocol import xsens
from smart_tire.protocol.xsens import decode_imu, encode_imu, Precision, XsensDeframer
from smart_tire.samples import ImuSample

# Movella, mtidocs.movella.com, "MT low level communication protocol example": packet counter,
# SampleTimeFine, acceleration, rate of turn and status of an MTi-G-710.
MTDATA2 = bytes.fromhex(
    'faff3631 102002dfc5 10600400459da0 40200cbedc9afa3f549f37411cbb70 '
    '80200cbbaa5c803b8c5501bb813300 e0200400000081 45')
# The commands and acknowledgements on the same page.
OTHERS = ['faff3000d1', 'faff3100d0', 'faff18018068', 'faff1900e8', 'faff6402000299',
          'faff65009c', 'faff1000f1',
          'faffc028 1020ffff 1060ffff 20100064 40200190 80200190 c0200064 e020ffff 50420064 '
          '50220064 d0120064 73']
SAMPLE = ImuSample(5, (0.5, -1.5, 9.75), (0.25, -0.125, 2.0), (0.5, -0.5, 0.25, 0.75))


def test_the_published_message_decodes():
    (body,) = XsensDeframer().feed(MTDATA2)
    time, sample = decode_imu(body, stamp_ns=9)
    assert xsens.packet_counter(body) == 57285
    assert time == 0x00459DA0 * 100_000
    assert sample.stamp_ns == 9
    assert sample.acceleration == pytest.approx((-0.43086988, 0.83055443, 9.79576111), rel=1e-7)
    assert sample.rate == pytest.approx((-0.00519902, 0.00428259, -0.00394285), abs=1e-8)
    assert sample.orientation is None


def test_the_published_message_encodes_back():
    (body,) = XsensDeframer().feed(MTDATA2)
    time, sample = decode_imu(body)
    packets = xsens.decode_packets(encode_imu(time, sample, 57285)) | {0xE020: b'\0\0\0\x81'}
    assert xsens.encode_message(xsens.encode_packets(packets)) == MTDATA2


@pytest.mark.parametrize('text', OTHERS)
def test_other_published_messages_are_framed_alike(text):
    message = bytes.fromhex(text)
    (body,) = XsensDeframer().feed(message)
    assert body[0] == message[2]
    assert xsens.encode_message(body) == message


def test_a_published_fixed_point_number_decodes_and_encodes():
    # A latitude that Xsens MT Manager showed, published with the tests of an Xbus parser.
    content = bytes.fromhex('64a68aa8001f')
    (number,) = xsens.decode_numbers(content, Precision.FP16_32)
    assert number == pytest.approx(31.393166223541, abs=1e-12)
    assert xsens.encode_numbers((number,), Precision.FP16_32) == content


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
    (body,) = XsensDeframer().feed(xsens.encode_message(
        encode_imu(ticks * xsens.TICK_NS, sample, counter, precision)))
    time, decoded = decode_imu(body, 5)
    assert time == ticks * xsens.TICK_NS
    assert xsens.packet_counter(body) == counter
    for part in ('acceleration', 'rate', 'orientation'):
        assert getattr(decoded, part) == pytest.approx(getattr(sample, part), rel=0.0,
                                                       abs=step / 2.0)


def test_the_device_time_wraps_as_a_counter_of_32_bits():
    time, _ = decode_imu(encode_imu(xsens.SAMPLE_TIME_WRAP_NS + 3 * xsens.TICK_NS, SAMPLE))
    assert time == 3 * xsens.TICK_NS


@pytest.mark.parametrize('size', [0, 254, 255, 256, xsens.MAX_DATA])
def test_long_messages_use_the_extended_length(size):
    body = b'\x36' + bytes(size)
    message = xsens.encode_message(body)
    assert len(message) == size + (5 if size < 255 else 7)
    assert list(XsensDeframer().feed(message)) == [body]


def test_a_message_that_is_too_long_is_not_encoded():
    with pytest.raises(FrameError, match='2049 bytes'):
        xsens.encode_message(bytes(2 + xsens.MAX_DATA))


@pytest.mark.parametrize('axes, known', [(0x0, True), (0x4, False), (0x8, False)])
def test_an_orientation_in_other_axes_than_enu_is_left_out(axes, known):
    packets = xsens.decode_packets(encode_imu(0, SAMPLE))
    packets[xsens.QUATERNION | axes] = packets.pop(xsens.QUATERNION)
    _, decoded = decode_imu(xsens.encode_packets(packets), 5)
    assert decoded == (SAMPLE if known else replace(SAMPLE, orientation=None))


def test_time_and_counter_may_be_missing():
    packets = xsens.decode_packets(encode_imu(0, SAMPLE))
    del packets[xsens.SAMPLE_TIME_FINE], packets[xsens.PACKET_COUNTER]
    body = xsens.encode_packets(packets)
    assert decode_imu(body, 5) == (None, SAMPLE)
    assert xsens.packet_counter(body) is None


@pytest.mark.parametrize('body, message', [
    (b'', 'message is , expected 36'),
    (b'\x31', 'message is 31, expected 36'),
    (b'\x36\x10', 'packet 10 at 1'),
    (b'\x36\x10\x20\x02\x00', 'packet 102002 at 1 goes beyond the 5 bytes'),
    (b'\x36\x10\x20\x02\x00\x00', 'packets 0x1020, expected acceleration')])
def test_a_message_that_can_not_be_decoded_is_refused_with_its_reason(body, message):
    with pytest.raises(FrameError, match=message):
        decode_imu(body)


@pytest.mark.parametrize('identifier, content, message', [
    (xsens.ACCELERATION, bytes(11), '0x4020 has 11 bytes, expected 12'),
    (xsens.RATE_OF_TURN, bytes(24), '0x8020 has 24 bytes, expected 12'),
    (xsens.SAMPLE_TIME_FINE, bytes(2), '0x1060 has 2 bytes, expected 4'),
    (xsens.ACCELERATION, b'\x7f\xc0\0\0' * 3, 'acceleration')])
def test_a_packet_of_the_wrong_content_is_refused_by_name(identifier, content, message):
    packets = xsens.decode_packets(encode_imu(0, SAMPLE)) | {identifier: content}
    with pytest.raises(FrameError, match=message):
        decode_imu(xsens.encode_packets(packets))


@pytest.mark.parametrize('precision, number', [(Precision.FLOAT32, 1e39),
                                               (Precision.FP12_20, 2048.0),
                                               (Precision.FP16_32, -32769.0)])
def test_numbers_that_do_not_fit_are_not_encoded(precision, number):
    with pytest.raises(FrameError, match=precision.name):
        xsens.encode_numbers((number,), precision)


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf, 3e38])
@pytest.mark.parametrize('precision', [Precision.FLOAT32, Precision.FLOAT64])
@pytest.mark.parametrize('part, name', [
    ('acceleration', 'acceleration'), ('rate', 'angular rate'), ('orientation', 'orientation')])
def test_what_is_no_measurement_is_refused_by_name(value, precision, part, name):
    numbers = (value, *getattr(SAMPLE, part)[1:])
    body = encode_imu(0, replace(SAMPLE, **{part: numbers}), 0, precision)
    with pytest.raises(FrameError, match=name):
        decode_imu(body)
