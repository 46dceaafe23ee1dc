# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Table of film accuracy: complete, with consistent standard deviations."""

from __future__ import annotations

import re

from benchmarks import film


def test_each_amplitude_and_frequency_has_an_error_and_a_normalized_error(capsys, monkeypatch):
    monkeypatch.setattr(film, 'AMPLITUDES', (0.002, 0.010))
    monkeypatch.setattr(film, 'FREQUENCIES', (1.0, 5.0))
    film.print_accuracy()
    cells = re.findall(r'([0-9.]+) \(([0-9.]+)\)', capsys.readouterr().out)
    assert len(cells) == 4
    assert all(10.0 < float(error) < 100.0 for error, _ in cells)  # um
    assert all(0.4 < float(share) < 1.4 for _, share in cells)
