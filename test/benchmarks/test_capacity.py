# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Load of the capacity benchmark: all bytes are valid, at the rates that are stated."""

from benchmarks.capacity import (
    ADDRESS, BATCH, FILM_RATE, IMU_RATE, limit, Loss, make_load, MAX_AGE)
import pytest
from smart_tire.drivers.sample_stream import IMU_PROTOCOLS, SampleStream
from smart_tire.drivers.tire_receiver import TireStream
from smart_tire.samples import NS_PER_S, TireSamples, WHEELS

SECONDS, FACTOR = 1.5, 2.0


def test_all_bytes_are_received_at_the_rates_of_the_factor():
    load = make_load(FACTOR, SECONDS)
    radio = TireStream({ADDRESS + index: wheel for index, wheel in enumerate(WHEELS)})
    imu = SampleStream(IMU_PROTOCOLS['vectornav_binary'])
    samples, readings = [], []
    for due, port, data in load.writes:
        stream, found = (radio, samples) if port == 'radio' else (imu, readings)
        found += stream.receive(data, round((due + 100.0) * NS_PER_S))
    batches = [found.samples for found in samples if isinstance(found, TireSamples)]
    assert sum(map(len, batches)) == load.samples
    assert len(readings) == load.readings
    assert radio.frames_bad == imu.frames_bad == 0
    assert all(node.lost == node.resets == 0 for node in radio.sensor_nodes.values())
    assert load.samples == pytest.approx(len(WHEELS) * FACTOR * FILM_RATE * SECONDS,
                                         abs=len(WHEELS) * BATCH)
    assert load.readings == pytest.approx(FACTOR * IMU_RATE * SECONDS, abs=2)
    assert len(load.wheels) == pytest.approx(16.0 * SECONDS, abs=2)
    assert {len(sample.volts) for batch in batches for sample in batch} == {2}


@pytest.mark.parametrize('loss, none', [
    (Loss(0, 0, 0, MAX_AGE), True), (Loss(1, 0, 0, 0.1), False), (Loss(0, 1, 0, 0.1), False),
    (Loss(0, 0, 1, 0.1), False), (Loss(0, 0, 0, MAX_AGE + 0.01), False)])
def test_everything_that_is_not_used_in_time_is_a_loss(loss, none):
    assert loss.none is none


def test_the_limit_is_the_last_rate_without_loss():
    good, bad = Loss(0, 0, 0, 0.05), Loss(16, 3, 2, 0.3)
    said = ('6400 Hz of 4 x 2 films, 3200 Hz of the IMU: 16 lost at the receivers, 3 at the '
            'estimators, 2 late, odom up to 300 ms old')
    assert limit({1.0: good, 2.0: good, 16.0: bad}) == (
        f'without loss: up to 800 Hz of 4 x 2 films, 400 Hz of the IMU; not {said}')
    assert limit({1.0: good}) == 'without loss: up to 400 Hz of 4 x 2 films, 200 Hz of the IMU'
    assert limit({16.0: bad}) == f'without loss: no rate measured; not {said}'
