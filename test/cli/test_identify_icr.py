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

"""``smart_tire identify icr`` on the command line."""

from __future__ import annotations

import pytest
from smart_tire.cli.main import main
from smart_tire.parameters import load_files, SlipEstimatorParams, specs
from support.identifying import turning_run, write_run


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    run = turning_run(14, 40.0, icr=0.05, turn=0.4)
    return write_run(tmp_path_factory.mktemp('identified') / 'run', run, 'ground_truth/odom')


def test_s_is_printed_per_turn_and_the_written_file_can_be_loaded(bag, tmp_path, capsys):
    out = tmp_path / 'icr.yaml'
    assert main(['identify', 'icr', str(bag), '--out', str(out)]) == 0
    output = capsys.readouterr().out
    assert 'turn at' in output and 'spread over all turns' in output
    known = specs(SlipEstimatorParams)
    values = load_files([out], 'slip_estimator', known, known)
    assert values['icr_x'] == pytest.approx(0.05, abs=0.01)
    assert 0.0 < values['icr_x_sigma'] < 0.2
    assert out.with_suffix('.png').read_bytes().startswith(b'\x89PNG')


def test_without_a_reference_s_is_identified_from_the_imu(bag, tmp_path, capsys):
    out = tmp_path / 'icr.yaml'
    assert main(['identify', 'icr', str(bag), '--reference', 'none', '--out', str(out)]) == 0
    assert 'from lateral acceleration of the IMU' in capsys.readouterr().out


def test_a_recording_without_turns_fails_with_the_reason(bag, tmp_path, capsys):
    out = tmp_path / 'icr.yaml'
    assert main(['identify', 'icr', str(bag), '--until', '4', '--out', str(out)]) == 1
    assert 'expected at least 2' in capsys.readouterr().err
    assert not out.exists()


def test_calibrate_only_identifies_the_same(bag, tmp_path, capsys):
    assert main(['identify', 'icr', str(bag), '--out', str(tmp_path / 'icr.yaml')]) == 0
    words = ['calibrate', '--only', 'icr', '--bags', str(bag), '--out', str(tmp_path / 'all')]
    assert main(words) == 0
    texts = [(tmp_path / name).read_text(encoding='utf-8')
             for name in ('icr.yaml', 'all/robot.yaml')]
    assert texts[0] == texts[1]
    assert (tmp_path / 'all/icr.png').exists()
    assert main(words) == 2 and 'exists' in capsys.readouterr().err
    assert main(['calibrate', '--only', 'icr', '--bags', f'lifted={bag}', '--out',
                 str(tmp_path / 'none')]) == 2
    assert 'no recording on the ground' in capsys.readouterr().err
