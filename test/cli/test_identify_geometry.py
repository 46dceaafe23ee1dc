"""``smart_tire identify geometry`` on the command line."""

from __future__ import annotations

import pytest
from support.identifying import turning_run, write_run

from smart_tire.analysis.calibrate_robot import load_robot
from smart_tire.cli.main import main


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    run = turning_run(13, 40.0, wheel_latency=0.07)
    return write_run(tmp_path_factory.mktemp('identified') / 'run', run, 'ground_truth/odom')


def test_it_prints_a_table_and_writes_a_file_that_params_takes(bag, tmp_path, capsys):
    out = tmp_path / 'robot.yaml'
    assert main(['identify', 'geometry', str(bag), '--out', str(out)]) == 0
    said = capsys.readouterr().out
    for name in ('wheel latency', 'effective track', 'rolling radius, left', 'stamp jitter',
                 'gyro bias z', 'mounting roll'):
        assert name in said
    assert f'written to {out} and {out.with_suffix(".png")}' in said
    assert load_robot([out]).encoder.latency == pytest.approx(0.07, abs=0.02)
    assert out.with_suffix('.png').exists()


def test_what_is_not_told_is_said_with_the_reason(bag, tmp_path, capsys):
    out = tmp_path / 'rest.yaml'
    assert main(['identify', 'geometry', str(bag), '--until', '2.5', '--reference', 'none',
                 '--out', str(out)]) == 0
    said = capsys.readouterr().out
    assert 'wheel latency           not told: the wheels do not rotate' in said
    assert 'no pose reference' in said
    assert 'encoder' not in out.read_text()


def test_it_fails_where_nothing_can_be_told(bag, tmp_path, capsys):
    out = tmp_path / 'nothing.yaml'
    assert main(['identify', 'geometry', str(bag), '--from', '15', '--until', '17',
                 '--out', str(out)]) == 1
    assert 'nothing can be told' in capsys.readouterr().out
    assert not out.exists()


def test_a_bag_that_is_not_there_is_a_usage_error(tmp_path, capsys):
    assert main(['identify', 'geometry', str(tmp_path / 'none')]) == 2
    assert 'no such file' in capsys.readouterr().err


def test_several_bags_are_taken_together(bag, tmp_path, capsys):
    out = tmp_path / 'both.yaml'
    assert main(['identify', 'geometry', str(bag), str(bag), '--out', str(out)]) == 0
    assert 'wheel latency' in capsys.readouterr().out
