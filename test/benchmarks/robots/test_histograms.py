# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Histograms of normalized errors."""

from benchmarks.robots import histograms
from benchmarks.scoring import Errors, Run
import numpy as np


def test_only_errors_with_a_standard_deviation_count():
    errors = Errors(np.array([0.2, -0.3, np.nan, 0.4, 0.5]),
                    np.array([0.1, 0.1, 0.1, np.nan, np.inf]))
    np.testing.assert_allclose(histograms.normalized(errors), [2.0, -3.0])


def test_errors_beyond_the_limit_are_in_the_outermost_bins(tmp_path, monkeypatch):
    found = []
    histogram = np.histogram

    def spied(values, edges):
        found.append(histogram(values, edges)[0])
        return found[-1], edges
    monkeypatch.setattr(np, 'histogram', spied)
    one = Errors(np.array([0.0, 70.0, -6.0, -7.0]), np.ones(4))
    none = Errors(np.empty(0), np.empty(0))
    histograms.draw_histograms([Run('ice', 1, dict.fromkeys(histograms.TITLES, one)),
                                Run('ice', 2, dict.fromkeys(histograms.TITLES, none))], tmp_path)
    assert len(found) == 4
    assert (found[0][0], found[0][-1], found[0].sum()) == (2, 1, 4)
    assert (tmp_path / 'normalized_errors.png').read_bytes().startswith(b'\x89PNG')
