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

"""``smart_tire identify geometry`` on the command line."""

from __future__ import annotations

import pytest
from smart_tire.cli.main import main
from smart_tire.parameters import load_robot
from support.identifying import turning_run, write_run


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    run = turning_run(13, 80.0, wheel_latency=0.07)
    return write_run(tmp_path_factory.mktemp('identified') / 'run', run, 'ground_truth/odom')


def test_a_table_is_printed_and_the_written_file_can_be_loaded(bag, tmp_path, capsys):
    out = tmp_path / 'robot.yaml'
    assert main(['identify', 'geometry', str(bag), '--truth', '--out', str(out)]) == 0
    output = capsys.readouterr().out
    for name in ('wheel latency', 'effective track', 'rolling radius, left', 'stamp jitter',
                 'gyro bias z', 'mounting roll'):
        assert name in output
    assert f'written to {out} and {out.with_suffix(".png")}' in output
    assert load_robot([out]).encoder.latency == pytest.approx(0.07, abs=0.02)
    assert out.with_suffix('.png').exists()


def test_unobservable_quantities_are_reported_with_the_reason(bag, tmp_path, capsys):
    out = tmp_path / 'rest.yaml'
    assert main(['identify', 'geometry', str(bag), '--until', '2.5', '--out', str(out)]) == 1
    output = capsys.readouterr().out
    assert 'wheel latency                   not observable: the wheels do not rotate' in output
    assert 'no pose reference' in output
    assert 'imu.gyro_noise                  not written: ' in output
    assert not out.exists()


def test_ground_truth_is_used_on_request_only(bag, tmp_path, capsys):
    out = tmp_path / 'robot.yaml'
    assert main(['identify', 'geometry', str(bag), '--out', str(out)]) == 0
    output = capsys.readouterr().out
    assert 'rolling radius                  not observable: there is no pose reference' in output
    assert 'encoder.stamp_jitter            not written: no significant difference' in output


def test_the_command_fails_if_nothing_is_identified(bag, tmp_path, capsys):
    out = tmp_path / 'nothing.yaml'
    assert main(['identify', 'geometry', str(bag), '--from', '15', '--until', '17',
                 '--out', str(out)]) == 1
    assert 'nothing could be identified' in capsys.readouterr().out
    assert not out.exists()


def test_a_missing_bag_is_a_usage_error(tmp_path, capsys):
    assert main(['identify', 'geometry', str(tmp_path / 'none')]) == 2
    assert 'no such file' in capsys.readouterr().err


def test_several_bags_are_combined(bag, tmp_path, capsys):
    out = tmp_path / 'both.yaml'
    assert main(['identify', 'geometry', str(bag), str(bag), '--out', str(out)]) == 0
    assert 'wheel latency' in capsys.readouterr().out
