# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Frames of the charge amplifier of a film."""

from contextlib import suppress

from hypothesis import given, strategies as st
import pytest
from smart_tire.errors import FrameError
from smart_tire.protocol.film_charge import (
    CHARGE_LSB, decode_charge, encode_charge, FilmDeframer, LAYOUT, TIMER_WRAP_NS)
from smart_tire.samples import FilmCharge
from support.frames import each_frame


@each_frame('film_charge', 'charge')
def test_a_documented_frame_is_decoded_and_encoded(frame):
    (body,) = FilmDeframer().extract(frame.data)
    device_ns, sample = decode_charge(body, 7)
    assert device_ns == 1000 * frame['timer_us']
    assert (sample.stamp_ns, sample.saturated, sample.discharged) == (
        7, frame['saturated'], frame['discharged'])
    assert sample.charge == pytest.approx(frame['charge'], abs=0.01 * CHARGE_LSB)
    assert encode_charge(device_ns, sample) == body


@given(st.floats(-2e-4, 2e-4), st.booleans(), st.booleans(), st.integers(0, 1 << 60))
def test_samples_survive_the_wire_within_its_resolution(charge, saturated, discharged, time_ns):
    device_ns, found = decode_charge(encode_charge(
        time_ns, FilmCharge(0, charge, saturated, discharged)))
    assert abs(found.charge - charge) <= 0.5001 * CHARGE_LSB
    assert (found.saturated, found.discharged) == (saturated, discharged)
    assert 0 <= time_ns % TIMER_WRAP_NS - device_ns < 1000


@pytest.mark.parametrize('charge', [3e-4, -3e-4, float('nan'), float('inf')])
def test_a_charge_that_the_frame_cannot_hold_is_refused(charge):
    with pytest.raises(FrameError, match='out of range'):
        encode_charge(0, FilmCharge(0, charge))


@pytest.mark.parametrize('body', [
    b'', bytes(LAYOUT.size - 1), bytes(LAYOUT.size), LAYOUT.pack(0x46, 4, 0, 0)])
def test_bodies_of_another_size_kind_or_with_unknown_flags_are_refused(body):
    with pytest.raises(FrameError, match='film frame has'):
        decode_charge(body)


@given(st.binary(max_size=40))
def test_any_bytes_are_decoded_or_refused(data):
    for body in (data, *FilmDeframer().extract(data)):
        with suppress(FrameError):
            decode_charge(body)
