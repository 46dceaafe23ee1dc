# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Payload of the tire sensor node, against the bytes of test/data/frames/tire_payload.txt."""

from dataclasses import replace

from hypothesis import given, strategies as st
import pytest
from smart_tire.errors import FrameError
from smart_tire.protocol import tire_payload
from smart_tire.protocol.tire_payload import decode_batch, encode_batch, TireBatch
from support.frames import each_frame, frames

FRAMES = frames('tire_payload')
PAYLOAD = FRAMES['two_channels'].data
BATCH_VALUES = ('flags', 'sequence', 'timer_us', 'period_us', 'codes', 'battery_mv')


def batch_of(frame):
    """Return the batch that the file gives for ``frame``."""
    return TireBatch(*(frame[key] for key in BATCH_VALUES))


BATCH = batch_of(FRAMES['two_channels'])


@st.composite
def batches(draw):
    channels = draw(st.integers(1, 2))
    row = st.tuples(*[st.integers(0, 1023)] * channels)
    u16, u32 = st.integers(0, 0xFFFF), st.integers(0, 0xFFFFFFFF)
    return TireBatch(draw(st.integers(0, 255)), draw(u16), draw(u32),
                     draw(st.integers(1, 0xFFFF)),
                     tuple(draw(st.lists(row, min_size=1, max_size=20))), draw(u16))


@each_frame('tire_payload', *BATCH_VALUES)
def test_payload_and_batch_correspond_byte_by_byte(frame):
    assert decode_batch(frame.data) == batch_of(frame)
    assert encode_batch(batch_of(frame)) == frame.data


def test_a_batch_of_16_samples_keeps_their_order():
    frame = FRAMES['default_batch']
    batch = decode_batch(frame.data)
    assert len(batch.codes) == frame['samples']
    assert (batch.codes[0], batch.codes[-1]) == (frame['first'], frame['last'])
    assert (batch.sequence, batch.timer_us) == (frame['sequence'], frame['timer_us'])
    assert encode_batch(batch) == frame.data


def test_bit_0_of_the_flags_reports_saturation():
    assert BATCH.saturated
    assert not replace(BATCH, flags=0xFE).saturated


@given(batches())
def test_batches_survive_the_round_trip(batch):
    assert decode_batch(encode_batch(batch)) == batch


@pytest.mark.parametrize('samples, size', [(16, 78), (17, 82), (20, 94)])
def test_two_channels_fit_the_size_budget_of_the_radio(samples, size):
    assert len(encode_batch(replace(BATCH, codes=((0, 0),) * samples))) == size


def test_the_converter_range_is_0_to_3_3_volts():
    assert tire_payload.volts(0) == 0.0
    assert tire_payload.volts(1023) == pytest.approx(3.3, rel=1e-15)
    assert tire_payload.volts(1) == pytest.approx(3.3 / 1023.0)


@pytest.mark.parametrize('change, message', [
    (lambda b: b'', 'version none, expected 01'),
    (lambda b: b'\x02' + b[1:], 'version 02, expected 01'),
    (lambda b: b[:13], 'has 13 bytes, expected at least 14'),
    (lambda b: b[:-1], 'has 25 bytes, expected 26 for 3 samples of 2 channels'),
    (lambda b: b + b'\0', 'has 27 bytes, expected 26'),
    (lambda b: b[:10] + b'\x00' + b[11:12] + b[-2:], '0 channels'),
    (lambda b: b[:10] + b'\x03\x02' + b[12:], '3 channels, expected 1 or 2'),
    (lambda b: b[:11] + b'\x00' + b[-2:], '0 samples'),
    (lambda b: b[:8] + b'\0\0' + b[10:], 'period of 0 us'),
    (lambda b: b[:12] + b'\x00\x04' + b[14:], 'readings 0 to 1024, expected 0 to 1023')])
def test_an_invalid_payload_is_refused_with_the_reason(change, message):
    with pytest.raises(FrameError, match=message):
        decode_batch(change(PAYLOAD))


@pytest.mark.parametrize('codes', [(), ((),), ((1, 2, 3),), ((1, 2), (3,)), ((1024,),), ((-1,),),
                                   ((1,),) * 256])
def test_a_batch_that_could_not_be_decoded_is_not_encoded(codes):
    with pytest.raises(FrameError):
        encode_batch(replace(BATCH, codes=codes))
