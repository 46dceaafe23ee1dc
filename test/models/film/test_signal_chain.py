# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Amplifier and A/D converter: round trip of counts, and the ends of the range."""

from hypothesis import given, strategies as st
import numpy as np
import pytest
from smart_tire.models.film.signal_chain import SignalChain
from smart_tire.protocol import tire_payload

CHAIN = SignalChain()


def test_the_amplifier_has_half_a_millivolt_per_picocoulomb():
    assert CHAIN.amplified(1e-12) == pytest.approx(0.5e-3)


def test_every_count_survives_a_round_trip_and_agrees_with_the_radio_payload():
    counts = np.arange(1024)
    volts = CHAIN.volts(counts)
    np.testing.assert_array_equal(CHAIN.counts(volts), counts)
    np.testing.assert_allclose(volts + 1.65, [tire_payload.volts(code) for code in range(1024)])


@given(st.floats(-1.65, 1.65), st.integers(4, 16))
def test_quantization_errors_are_at_most_half_a_count(volts, bits):
    chain = SignalChain(bits=bits)
    assert abs(float(chain.volts(chain.counts(volts))) - volts) <= 0.5 * chain.step + 1e-12


@given(st.floats(-1e6, 1e6), st.floats(0.0, 10.0))
def test_counts_are_monotone_and_stay_in_range(volts, more):
    low, high = CHAIN.counts([volts, volts + more])
    assert 0 <= low <= high <= 1023


def test_outputs_outside_the_range_are_clipped_and_flagged():
    counts = CHAIN.counts([[-2.0, -1.65], [0.0, 5.0]])
    np.testing.assert_array_equal(counts, [[0, 0], [512, 1023]])
    np.testing.assert_array_equal(CHAIN.saturated(counts), [[True, True], [False, True]])


@pytest.mark.parametrize('call, message', [
    (lambda: SignalChain(bits=0), 'bits is 0'), (lambda: SignalChain(bits=10.0), 'bits is 10.0'),
    (lambda: SignalChain(voltage_range=-3.3), 'voltage_range is -3.3'),
    (lambda: SignalChain(rest_voltage=4.0), 'rest_voltage is 4.0, expected 0 to the range'),
    (lambda: SignalChain(amplifier=0.0), 'amplifier is 0'),
    (lambda: CHAIN.counts([0.0, np.nan]), r'volts\[1\] is nan'),
    (lambda: CHAIN.volts(1024), 'counts is 1024.0, expected 0 to 1023'),
    (lambda: CHAIN.volts([1, -1]), r'counts\[1\] is -1.0'),
    (lambda: CHAIN.saturated(0.5), 'counts holds 0.5, expected whole'),
    (lambda: CHAIN.amplified(np.inf), 'charge is inf')])
def test_invalid_arguments_are_rejected_with_name_and_value(call, message):
    with pytest.raises(ValueError, match=message):
        call()
