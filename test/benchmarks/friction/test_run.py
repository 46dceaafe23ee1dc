# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The friction benchmark on synthesized crossings; ``make check`` has short runs."""

import json

from benchmarks.friction import run
from benchmarks.friction.grid import Case


def test_synthesized_crossings_are_compared_with_the_bound(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(run, 'QUICK_COUNT', 4)
    monkeypatch.setattr(run, 'quick_cases', lambda: {'slip': [Case(slip=0.1)]})
    assert run.FRICTION.main(['--quick', '--runs', 'crossings', '--out', str(tmp_path)]) == 0
    assert 'Synthesized crossings' in capsys.readouterr().out
    ((row, figures),) = json.loads((tmp_path / 'results.json').read_text())['rows'].items()
    assert row == 'crossings/slip: slip +0.10, mu 0.47, 60 rpm, 5 mV'
    figures = figures['over_seeds']
    assert 0.01 < figures['bound'] < 0.03 and 'printed.bias' in figures
