# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire view``: arguments, the recording as a file, live topics, missing rerun."""

from __future__ import annotations

from argparse import Namespace
from importlib.util import find_spec
import sys

import pytest

from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.bags import BagWriter, PARAMETERS_KEY
from smart_tire.cli._bags import open_bag
from smart_tire.cli.main import install_hint, main
from smart_tire.cli.view import has_display
from smart_tire.samples import WheelSlip

needs_rerun = pytest.mark.skipif(find_spec('rerun') is None, reason='rerun is not installed')
SLIP = WheelSlip(1_000_000_000, (0.25,) * 4, (0.0,) * 4, (0.1,) * 4)


@pytest.mark.parametrize('words', [[], [__file__, '--live'], ['--live', '--estimate']])
def test_either_a_bag_or_live_topics_are_shown(words, capsys):
    assert main(['view', *words]) == 2
    assert 'either BAG or --live' in capsys.readouterr().err


@pytest.mark.parametrize('node, radius', [
    ('/**', 0.3), ('overhead_localizer', 0.25)])  # an analysis, and one of the camera alone
def test_estimates_are_shown_with_the_parameters_that_they_were_made_with(tmp_path, node, radius):
    bag, estimates = tmp_path / 'drive', tmp_path / 'out' / 'estimates'
    text = EstimatorParams.load([]).text.replace('wheel_radius: 0.087', 'wheel_radius: 0.3')
    if node != '/**':
        text = f'{node}: {{ros__parameters: {{wheel_radius: 0.3}}}}'
    recorded = EstimatorParams.load([]).text.replace('wheel_radius: 0.087', 'wheel_radius: 0.25')
    for path, used in ((bag, recorded), (estimates, text)):
        with BagWriter(path, custom_data={PARAMETERS_KEY: used}) as writer:
            writer.write_sample('wheel_slip', 0, SLIP)
    args = Namespace(params=[], remap=[])
    with open_bag(bag, args, required=(), estimates=estimates) as (_, source):
        assert source.params.robot.wheel_radius == radius
    file = tmp_path / 'robot.yaml'
    file.write_text('/**: {ros__parameters: {wheel_radius: 0.2}}')
    args.params = [file]
    with open_bag(bag, args, required=(), estimates=estimates) as (_, source):
        assert source.params.robot.wheel_radius == 0.2


@needs_rerun
def test_a_recording_is_saved_without_a_viewer(tmp_path, capsys, monkeypatch):
    from support.rerun_file import RerunFile
    monkeypatch.setattr('smart_tire.view.viewer.Viewer', None)
    bag, file = tmp_path / 'drive', tmp_path / 'drive.rrd'
    with BagWriter(bag) as writer:
        writer.write_sample('wheel_slip', 0, SLIP)
        writer.write_sample('ground_truth/wheel_slip', 0, SLIP)
    assert main(['view', str(bag), '--save', str(file), '--no-fit']) == 0
    printed = capsys.readouterr()
    assert f'written to {file}' in printed.out and '--no-fit has no effect' in printed.err
    assert RerunFile(file).scalars('slip/rear_left/truth') == [(0, [0.25])]
    assert main(['view', str(bag), '--save', str(file)]) == 2
    assert 'exists' in capsys.readouterr().err


def test_a_missing_rerun_is_reported_with_the_command_that_installs_it(
        tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, 'rerun', None)
    for name in [name for name in sys.modules if name.startswith('smart_tire.view.')]:
        monkeypatch.delitem(sys.modules, name)
    bag = tmp_path / 'drive'
    with BagWriter(bag) as writer:
        writer.write_sample('wheel_slip', 0, SLIP)
    assert main(['view', str(bag)]) == 1
    assert 'rerun is not installed (pip install smart_tire[view])' in capsys.readouterr().err
    assert install_hint('rerun.blueprint') == 'pip install smart_tire[view]'


@pytest.mark.parametrize(('environment', 'expected'), [
    ({}, False), ({'DISPLAY': ''}, False), ({'DISPLAY': ':0'}, True),
    ({'WAYLAND_DISPLAY': 'wayland-0'}, True)])
def test_a_display_is_noticed(environment, expected):
    assert has_display(environment) is expected
