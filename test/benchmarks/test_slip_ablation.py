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

"""Every rule of the slip estimator can be switched off, and its effect is measured."""

from __future__ import annotations

from dataclasses import fields, replace
import importlib
import json
import math

from benchmarks.scenarios import SCENARIOS
from benchmarks.slip_ablation import run
from benchmarks.slip_ablation.recorded import KNOWN, RecordedResult
from benchmarks.slip_ablation.rules import ALL_RULES, PACKAGE, Rule, RULES, switched_off
from benchmarks.slip_ablation.run import recordings_table
from benchmarks.slip_ablation.scoring import change, FIGURES
from benchmarks.tables import markdown
import pytest
from smart_tire.parameters import SlipEstimatorParams

every_rule = pytest.mark.parametrize(
    'rule', [RULES[name] for name in run.SPECIAL], ids=run.SPECIAL)
RULES_TRIED = 'speed_change', 'standstill', 'spikes'
CASES = ('a', 'torque'), ('b', 'torque')


def value_of(target):
    """Return the present value of a patch's target."""
    module, *path = target.split('.')
    found = importlib.import_module(f'{PACKAGE}.{module}')
    for name in path:
        found = getattr(found, name)
    return found


@every_rule
def test_a_rule_is_off_within_the_context_only(rule):
    before = {target: value_of(target) for target in rule.patches}
    with switched_off(rule):
        for target, value in rule.patches.items():
            assert value_of(target) is value
            assert before[target] != value
    assert {target: value_of(target) for target in rule.patches} == before


@every_rule
def test_a_rule_changes_something_that_exists(rule):
    assert rule.patches or rule.params
    assert rule.params.keys() <= {field.name for field in fields(SlipEstimatorParams)}
    defaults = SlipEstimatorParams()
    assert all(getattr(defaults, name) != value for name, value in rule.params.items())


def test_an_outdated_patch_is_an_error():
    with pytest.raises(AttributeError), switched_off(Rule('old', {'ekf.NO_SUCH_LIMIT': 0.0})):
        pass


def scores(*ratios):
    """Return the scores of seeds with these slip errors, in two cases."""
    return [{case: dict.fromkeys(FIGURES, ratio) for case in CASES} for ratio in ratios]


def test_changes_are_ratios_of_the_same_seed():
    found = change(scores(0.022, 0.044), scores(0.02, 0.04), 'slip')
    assert found.mean == pytest.approx(0.1)
    assert found.standard_error == pytest.approx(0.0, abs=1e-9)
    assert found.matters


def test_changes_within_the_scatter_of_seeds_do_not_matter():
    found = change(scores(1.2, 0.9, 1.02), scores(1.0, 1.0, 1.0), 'slip')
    assert 0.01 < found.mean < found.standard_error
    assert not found.matters
    assert not change(scores(1.005, 1.005), scores(1.0, 1.0), 'slip').matters  # below 1 %


def test_a_change_in_one_case_is_half_of_it_in_two():
    without = scores(1.0)
    without[0][CASES[0]] = dict.fromkeys(FIGURES, 1.21)
    base = scores(1.0)
    assert change(without, base, 'slip', CASES[0]).mean == pytest.approx(0.21)
    assert change(without, base, 'slip').mean == pytest.approx(0.1)
    assert math.isnan(change(without, base, 'slip').standard_error)


def test_a_run_gives_a_line_per_rule_and_results(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(run, 'RUNS', {'concrete': replace(SCENARIOS['concrete'], duration=8.0)})
    assert run.main(['--seeds', '1', '--runs', 'concrete', '--variants', 'no_torque',
                     '--rules', *RULES_TRIED, '--out', str(tmp_path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = {name: next(line for line in lines if line.strip().startswith(f'{name} '))
            for name in RULES_TRIED}
    assert '!' in rows['speed_change']  # by a parameter
    assert '!' in rows['standstill']    # by a patch
    assert '!' not in rows['spikes']
    (result,) = json.loads((tmp_path / 'results.json').read_text())['results']
    assert result['scores'].keys() == {ALL_RULES, *RULES_TRIED}
    assert result['scores']['spikes'] == result['scores'][ALL_RULES]


def test_an_unknown_rule_is_a_usage_error(capsys):
    with pytest.raises(SystemExit):
        run.main(['--rules', 'gravity'])
    assert 'gravity' in capsys.readouterr().err


def test_recordings_that_are_absent_are_skipped_with_a_message(tmp_path, capsys):
    assert run.main(['--runs', *KNOWN, '--rules', 'spikes', '--data', str(tmp_path),
                     '--out', str(tmp_path)]) == 0
    output = capsys.readouterr().out
    assert all(f'{name}: not in {tmp_path}, skipped' in output for name in KNOWN)


def test_the_change_on_a_recording_is_that_of_its_position_error():
    results = [RecordedResult('husky', {ALL_RULES: 0.10, 'spikes': 0.12, 'radius': 0.09})]
    assert markdown(recordings_table(results, ['spikes', 'radius'])).splitlines()[-2:] == [
        '| spikes | 20.0 |', '| radius | -10.0 |']
