# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Rates and gaps from timestamps."""

import numpy as np
import pytest

from smart_tire.analysis.summary import input_stats, stream_stats
from smart_tire.recording import SampleArrays
from smart_tire.samples import ImuSample, TireSample

EPOCH = 1_700_000_000_000_000_000
PERIOD = 2_500_000  # ns, 400 Hz


def stamps(indices):
    return EPOCH + np.asarray(indices, np.int64) * PERIOD


@pytest.mark.parametrize('kept, gaps, missing, longest', [
    (range(400), 0, 0, 0.0), ([*range(100), *range(116, 200)], 1, 16, 17 * 2.5e-3)])
def test_a_lost_batch_is_one_gap_of_sixteen_samples(kept, gaps, missing, longest):
    found = stream_stats(stamps(kept))
    assert (found.messages, found.gaps, found.missing) == (len(kept), gaps, missing)
    assert found.longest_gap_s == pytest.approx(longest)
    assert found.rate_hz == pytest.approx(400.0)


def test_jitter_is_not_a_gap():
    rng = np.random.default_rng(1)
    jittered = stamps(range(1000)) + rng.normal(0.0, 0.05 * PERIOD, 1000).astype(np.int64)
    assert stream_stats(jittered).gaps == 0


def test_the_order_of_arrival_does_not_matter():
    shuffled = stamps(np.random.default_rng(1).permutation(200))
    assert stream_stats(shuffled) == stream_stats(stamps(range(200)))


@pytest.mark.parametrize('indices', [[0], [0, 0, 0]])
def test_equal_timestamps_have_no_rate(indices):
    assert stream_stats(stamps(indices)).rate_hz == 0.0


def test_wheels_that_share_a_topic_are_evaluated_separately():
    inputs = SampleArrays()
    for i, stamp in enumerate(stamps(range(100)).tolist()):
        inputs.add_sample(TireSample(stamp, 'front_left', (1.65, 1.65)))
        if i not in (50, 51):
            inputs.add_sample(TireSample(stamp + 700_000, 'front_right', (1.65, 1.65)))
        inputs.add_sample(ImuSample(stamp, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0)))
    found = input_stats(inputs)
    assert found['tire_samples'].messages == 198
    assert found['tire_samples'].rate_hz == pytest.approx(400.0)
    assert (found['tire_samples'].gaps, found['tire_samples'].missing) == (1, 2)
    assert found['imu/data'].gaps == 0
