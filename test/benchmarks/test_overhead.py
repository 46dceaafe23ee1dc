# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The benchmark of the overhead camera, with few small images."""

from __future__ import annotations

from benchmarks import overhead
import pytest

SMALL = {'size': (320, 240), 'focal_length': 300.0, 'position': (0.0, 0.0, 2.0)}


def test_each_condition_has_a_row_with_errors_and_each_size_one_with_times(monkeypatch, capsys):
    monkeypatch.setattr(overhead, 'SIZES', [(320, 240)])
    monkeypatch.setattr(overhead, 'DURATION', 1.0)
    monkeypatch.setattr(overhead, 'CONDITIONS', {
        'plain': SMALL, 'hidden': {**SMALL, 'occlusion': 0.9}})
    assert overhead.main(['--images', '2']) == 0
    plain, hidden, size = (line for line in capsys.readouterr().out.splitlines()
                           if line.startswith(('| plain', '| hidden', '| 320 x 240')))
    name, used, wrong, position, yaw, pixels = (cell.strip() for cell in plain.split('|')[1:-1])
    assert (name, used, wrong, pixels) == ('plain', '2 of 2', '0', '27')
    assert 0.01 < float(position) < 5.0 and 0.001 < float(yaw) < 1.0
    assert [cell.strip() for cell in hidden.split('|')[1:5]] == ['hidden', '0 of 2', '0', '-']
    spent, rate = map(float, size.split('|')[2:4])
    assert rate == pytest.approx(1e3 / spent, rel=0.2)
