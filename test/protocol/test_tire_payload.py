"""The wheel unit's payload, byte for byte as INTERFACES lays it out."""

from dataclasses import replace

from hypothesis import given, strategies as st
import pytest
from smart_tire.errors import FrameError
from smart_tire.protocol import tire_payload
from smart_tire.protocol.tire_payload import decode_batch, encode_batch, TireBatch

PAYLOAD = bytes.fromhex(
    '01'           # version
    '01'           # flags: saturated
    'fe ff'        # sequence 65534
    'f0 ff ff ff'  # timer 4294967280 us
    'c4 09'        # period 2500 us
    '02 03'        # two channels, three samples
    '00 02 ff 03  01 02 00 00  02 02 01 00'
    '74 0e')       # 3700 mV
BATCH = TireBatch(1, 65534, 4294967280, 2500, ((512, 1023), (513, 0), (514, 1)), 3700)


@st.composite
def batches(draw):
    channels = draw(st.integers(1, 2))
    row = st.tuples(*[st.integers(0, 1023)] * channels)
    u16, u32 = st.integers(0, 0xFFFF), st.integers(0, 0xFFFFFFFF)
    return TireBatch(draw(st.integers(0, 255)), draw(u16), draw(u32),
                     draw(st.integers(1, 0xFFFF)),
                     tuple(draw(st.lists(row, min_size=1, max_size=20))), draw(u16))


def test_the_layout_is_the_documented_one():
    assert decode_batch(PAYLOAD) == BATCH
    assert encode_batch(BATCH) == PAYLOAD
    assert BATCH.saturated
    assert not replace(BATCH, flags=0xFE).saturated


@given(batches())
def test_batches_survive_the_round_trip(batch):
    assert decode_batch(encode_batch(batch)) == batch


@pytest.mark.parametrize('samples, size', [(16, 78), (17, 82), (20, 94)])
def test_payload_sizes_are_those_of_the_radio_budget(samples, size):
    assert len(encode_batch(replace(BATCH, codes=((0, 0),) * samples))) == size


def test_volts_span_the_range_of_the_converter():
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
    (lambda b: b[:8] + b'\0\0' + b[10:], '0 us apart'),
    (lambda b: b[:12] + b'\x00\x04' + b[14:], 'readings 0 to 1024, expected 0 to 1023')])
def test_a_damaged_payload_is_refused_with_its_reason(change, message):
    with pytest.raises(FrameError, match=message):
        decode_batch(change(PAYLOAD))


@pytest.mark.parametrize('codes', [(), ((),), ((1, 2, 3),), ((1, 2), (3,)), ((1024,),), ((-1,),),
                                   ((1,),) * 256])
def test_what_could_not_be_read_back_is_not_written(codes):
    with pytest.raises(FrameError):
        encode_batch(replace(BATCH, codes=codes))
