# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""IMU bytes to timestamped samples, for all protocols."""

from __future__ import annotations

import math

import numpy as np
import pytest

from smart_tire.drivers.sample_stream import IMU_PROTOCOLS, SampleStream
from smart_tire.protocol import vectornav, vectornav_ascii, xsens
from smart_tire.samples import ImuSample

HOST_NS = 1_700_000_000_000_000_000
PERIOD_NS = 10_000_000
SAMPLE = ImuSample(0, (0.5, -0.25, 9.8125), (0.125, 0.0, -0.5))
DEVICE_NS = {'vectornav_binary': 123_456_789_000, 'xsens': xsens.SAMPLE_TIME_WRAP_NS - 10**9}


def frame(protocol, index):
    """Return the bytes of the sample ``index``."""
    device_ns = DEVICE_NS.get(protocol, 0) + index * PERIOD_NS
    if protocol == 'vectornav_binary':
        return vectornav.encode_frame(vectornav.encode_binary(device_ns, SAMPLE))
    if protocol == 'xsens':
        return xsens.encode_message(xsens.encode_imu(device_ns, SAMPLE))
    return vectornav_ascii.encode_sentence(vectornav_ascii.encode_ymr(SAMPLE))


def imu_stream(protocol, latency_ns=0):
    """Return the stream of an IMU."""
    return SampleStream(IMU_PROTOCOLS[protocol], latency_ns)


every_protocol = pytest.mark.parametrize(
    'protocol', ['vectornav_binary', 'vectornav_ascii', 'xsens'])


@every_protocol
def test_samples_have_rep_103_axes_and_the_time_of_measurement(protocol):
    stream, rng, rows = imu_stream(protocol, latency_ns=2_000_000), np.random.default_rng(1), []
    for index in range(600):  # Xsens: its time wraps in the first second
        true_ns = HOST_NS + index * PERIOD_NS
        arrival_ns = true_ns + 2_000_000 + round(rng.exponential(1e6))
        for sample in stream.receive(frame(protocol, index), arrival_ns):
            assert sample.acceleration == pytest.approx(SAMPLE.acceleration, abs=1e-3)
            assert sample.rate == pytest.approx(SAMPLE.rate, abs=1e-3)
            rows.append(sample.stamp_ns - true_ns)
    assert len(rows) == 600
    assert np.abs(rows[200:]).max() < 0.5e6
    assert stream.frames_ok == 600
    assert stream.frames_bad == 0


def test_the_source_of_the_timestamps_is_reported():
    sources = {}
    for protocol in ('vectornav_binary', 'vectornav_ascii'):
        stream = imu_stream(protocol)
        list(stream.receive(frame(protocol, 0), HOST_NS))
        sources[protocol] = stream.timestamp_source
    assert sources['vectornav_binary'] == 'device clock'
    assert 'arrival' in sources['vectornav_ascii']


def test_the_axes_of_the_devices_are_those_of_their_manuals():
    axes = {name: protocol.axes.partition(' on the device')[0]
            for name, protocol in IMU_PROTOCOLS.items()}
    assert axes == {'vectornav_binary': 'x forward, y right, z down',
                    'vectornav_ascii': 'x forward, y right, z down',
                    'xsens': 'x forward, y left, z up'}


@every_protocol
def test_before_the_first_frame_there_is_no_source_of_timestamps(protocol):
    assert imu_stream(protocol).timestamp_source == 'none yet'


def test_the_first_sentence_of_an_undamaged_stream_follows_no_missed_one():
    stream = imu_stream('vectornav_ascii')
    missed, timestamp = [], stream._arrival_clock.timestamp
    stream._arrival_clock.timestamp = lambda receive_ns, count: missed.append(count) or timestamp(
        receive_ns, count)
    data = frame('vectornav_ascii', 0)
    for chunk in (data, data, data[:8] + b'x' + data[9:], data):
        list(stream.receive(chunk, HOST_NS))
    assert missed == [0, 0, 1]


def test_a_late_frame_after_the_device_time_has_wrapped_has_the_time_of_its_measurement():
    stream, wrap = imu_stream('xsens'), 100  # 1 s after ``DEVICE_NS``
    errors = [sample.stamp_ns - HOST_NS - index * PERIOD_NS for index in range(2 * wrap)
              for sample in stream.receive(frame('xsens', index), HOST_NS + index * PERIOD_NS + (
                  8_000_000 if index == wrap else 0))]
    assert np.abs(errors).max() < 100_000


def test_a_binary_frame_without_device_time_gets_its_arrival_time():
    stream = imu_stream('vectornav_binary')
    fields = vectornav.Field.ANGULAR_RATE | vectornav.Field.ACCEL
    body = vectornav.encode_binary(0, SAMPLE, fields)
    (sample,) = stream.receive(vectornav.encode_frame(body), HOST_NS)
    assert sample.stamp_ns == HOST_NS
    assert 'arrival' in stream.timestamp_source


NASTY = (math.nan, math.inf, -math.inf, 1e30, -3e30, 0.0)


def nasty_frame(protocol, rng):
    """Return an intact frame with numbers that an IMU must not send."""
    numbers = [float(number) for number in rng.choice(NASTY, 10)]
    sample = ImuSample(0, tuple(numbers[:3]), tuple(numbers[3:6]), tuple(numbers[6:]))
    device_ns = int(rng.integers(0, 2**63))
    if protocol == 'vectornav_binary':
        fields = vectornav.DEFAULT_FIELDS | vectornav.Field.QUATERNION
        return vectornav.encode_frame(vectornav.encode_binary(device_ns, sample, fields))
    if protocol == 'xsens':
        return xsens.encode_message(xsens.encode_imu(device_ns, sample))
    return vectornav_ascii.encode_sentence(
        b'VNYMR,' + b','.join(f'{number}'.encode() for number in rng.choice(NASTY, 12)))


@every_protocol
def test_frames_with_invalid_numbers_are_rejected_and_decoding_continues(protocol):
    stream, rng = imu_stream(protocol), np.random.default_rng(3)
    for index in range(300):
        assert list(stream.receive(nasty_frame(protocol, rng), HOST_NS + index)) == []
    assert (stream.frames_ok, stream.frames_bad, stream.last_ok_ns) == (0, 300, 0)
    assert stream.last_error
    assert len(list(stream.receive(frame(protocol, 0), HOST_NS + 300))) == 1
    assert (stream.frames_ok, stream.frames_bad, stream.last_ok_ns) == (1, 300, HOST_NS + 300)


def test_damaged_sentences_advance_the_message_count():
    stream, stamps = imu_stream('vectornav_ascii'), []
    for index in range(400):
        data = frame('vectornav_ascii', index)
        if index % 10 == 9:
            data = data.replace(b'VNYMR', b'VNYMX')
        stamps += [sample.stamp_ns - HOST_NS - index * PERIOD_NS
                   for sample in stream.receive(data, HOST_NS + index * PERIOD_NS)]
    assert stream.frames_bad == 40
    assert np.abs(stamps).max() < 0.1e6


def test_clocks_are_reset_when_the_port_is_reopened():
    stream = imu_stream('vectornav_ascii')
    for index in range(50):
        list(stream.receive(frame('vectornav_ascii', index), HOST_NS + index * PERIOD_NS))
    stream.reset_clocks()
    later = HOST_NS + 3_333_333_333
    (sample,) = stream.receive(frame('vectornav_ascii', 60), later)
    assert sample.stamp_ns == later
