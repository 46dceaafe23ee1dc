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

"""Timestamps of batches, regularized to the period of a sensor node."""

from __future__ import annotations

import numpy as np

from smart_tire.estimation.contact.stamp_regularizer import StampRegularizer


def test_timestamps_of_batches_become_as_regular_as_the_conversions():
    rng = np.random.default_rng(0)
    true = np.arange(4000) * 2_500_125  # 50 ppm slow
    received = true + np.repeat(rng.normal(0.0, 300_000.0, 250), 16).astype(np.int64)
    kept = np.ones(4000, bool)
    kept[1600:1648] = False
    regular = StampRegularizer(2_500_000).regularize(received[kept].tolist())
    error = (regular - true[kept])[1000:]
    assert np.std(error) < 120_000
    assert np.max(np.abs(np.diff(error))) < 10_000


def test_a_reset_of_the_node_is_followed_at_once():
    regularizer = StampRegularizer(2_500_000)
    regularizer.regularize([i * 2_500_000 for i in range(500)])
    assert regularizer.regularize([10**12])[0] == 10**12
