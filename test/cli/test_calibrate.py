# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire calibrate`` from recordings; confirmation before driving."""

from __future__ import annotations

import io

from benchmarks.calibration import demo
import pytest
from smart_tire.bags import BagWriter
from smart_tire.cli import _calibrate_live as live
from smart_tire.cli.main import main
from smart_tire.parameters import load_robot
from smart_tire.parameters import RobotParams
from smart_tire.samples import NS_PER_S, Odometry
from support.ideal_robot import odometry


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """Return rest and turns on one ground, the turns with a wrong ground truth."""
    folder = tmp_path_factory.mktemp('bags')
    events = demo(5).events['mixed']
    begin = events[0][2].stamp_ns
    for name, until in (('rest', 2.4), ('turns', 20.0)):
        with BagWriter(folder / name) as writer:
            for received, topic, sample in events:
                if sample.stamp_ns - begin > until * NS_PER_S:
                    continue
                if topic in ('imu/data', 'wheel_states'):
                    writer.write_sample(topic, received, sample)
                elif isinstance(sample, Odometry):  # at rest
                    writer.write_sample(topic, received, odometry(sample.stamp_ns))
    return folder


def test_recordings_give_a_parameter_file_without_ground_truth(bags, tmp_path, capsys):
    out = tmp_path / 'mine'
    words = ['calibrate', '--out', str(out), '--bags', f'rest={bags / "rest"}',
             f'turns={bags / "turns"}']
    assert main(words) == 0
    text, printed = (out / 'robot.yaml').read_text(encoding='utf-8'), capsys.readouterr().out
    assert 'effective_track: 0.57' in text and ', from turns' in text
    assert '# kept: tire.longitudinal_stiffness: 52.7  (no recording of straight' in text
    assert 'wheel_radius' in printed and 'kept: requires a pose reference' in printed
    assert load_robot([out / 'robot.yaml']).encoder.stamp_jitter != 0.001
    assert main(words) == 2 and 'exists' in capsys.readouterr().err
    assert main([*words, '--force']) == 0


def test_a_recording_at_rest_only_writes_its_noise_and_nothing_else(bags, tmp_path, capsys):
    assert main(['calibrate', '--out', str(tmp_path), '--bags', f'rest={bags / "rest"}']) == 0
    assert 'no recording with turns' in capsys.readouterr().out
    text = (tmp_path / 'robot.yaml').read_text(encoding='utf-8')
    values = [line for line in text.splitlines()
              if 'standard error' in line and not line.startswith('#')]
    assert [line.split(':')[0].strip() for line in values] == ['gyro_noise', 'accel_noise']


@pytest.mark.parametrize('words, message', [
    (['--bags', 'curve=x'], 'expected BAG or STEP=BAG'),
    (['--bags', __file__, '--drive'], 'for a live calibration'),
    (['--bags', 'missing'], 'missing')])
def test_wrong_arguments_are_usage_errors(words, message, tmp_path, capsys):
    try:
        status = main(['calibrate', '--out', str(tmp_path / 'out'), *words])
    except SystemExit as end:
        status = end.code
    assert status == 2 and message in capsys.readouterr().err


def test_a_sequence_without_a_recording_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(live, 'record_steps', lambda *_: {})
    assert main(['calibrate', '--out', str(tmp_path / 'out')]) == 2
    assert 'all steps were skipped' in capsys.readouterr().err


@pytest.mark.parametrize('typed', ['', 'yes\n', 'Drive \n'])
def test_nothing_is_driven_without_the_confirmation(typed, monkeypatch, capsys):
    monkeypatch.setattr('sys.stdin', io.StringIO(typed))
    with pytest.raises(live.RobotError, match='not confirmed'):
        live.confirm_driving(['rest', 'straight', 'turns'], RobotParams())
    assert 'm from where it is' in capsys.readouterr().out


def test_the_confirmation_allows_driving(monkeypatch):
    monkeypatch.setattr('sys.stdin', io.StringIO('drive\n'))
    live.confirm_driving(['rest', 'straight'], RobotParams())


class FakeNode:
    """Node with a clock that the test advances."""

    def __init__(self):
        self.time_ns, self.emergency_stop, self.commands = 0, False, []

    def steady_ns(self):
        return self.time_ns

    def drive(self, left, right):
        self.commands.append((left, right))


def driving_sequence(tmp_path, drive=True):
    sequence = live.Sequence(tmp_path, live.Guide(['straight']), RobotParams(), drive=drive)
    sequence.guide.key(live.Key.GO)
    sequence._recording = 'straight'
    sequence._legs = [(2.0, 60.0, 60.0), (1.0, 0.0, 0.0)]
    return sequence, FakeNode()


def test_legs_are_driven_in_order_and_end_the_step(tmp_path):
    sequence, node = driving_sequence(tmp_path)
    for time in (0.0, 1.9, 2.1, 2.9):
        node.time_ns = round(time * 1e9)
        sequence._drive_on(node)
    assert node.commands == [(60.0, 60.0), (0.0, 0.0)] and not sequence._actions
    node.time_ns = round(3.2e9)
    sequence._drive_on(node)
    assert sequence._actions == [live.Action.KEEP] and sequence.guide.recorded == ['straight']


def test_nothing_is_driven_without_the_option(tmp_path):
    sequence, node = driving_sequence(tmp_path, drive=False)
    sequence._drive_on(node)
    assert node.commands == []


def test_an_emergency_stop_ends_the_sequence(tmp_path):
    sequence, node = driving_sequence(tmp_path)
    sequence._drive_on(node)
    node.emergency_stop = True
    with pytest.raises(live.RobotError, match='emergency stop'):
        sequence._drive_on(node)
    assert node.commands == [(60.0, 60.0)] and sequence._legs == []
