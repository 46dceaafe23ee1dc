# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire identify KIND`` with bags: what is printed, written and refused with reasons."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.scenarios import CONCRETE, SCENARIOS, sequence
import numpy as np
import pytest
from smart_tire.bags import BagWriter
from smart_tire.cli.calibrate import STEPS_OF
from smart_tire.cli.main import main, VERBS
from smart_tire.estimation.streams import INPUTS, SLIP
from smart_tire.identification.identify import KINDS as FUNCTIONS
from smart_tire.parameters import (
    load_files, load_robot, NODE_PARAMS, RobotParams, SimulatorParams, specs)
from smart_tire.simulation.offline import simulate
from support.identifying import turning_run, write_run
from support.motors import in_step_events, truth

SEED = 31
LENGTH, SPACING, GAINS = 0.048, 0.031, (290.0, 255.0)


def written(path, events, topics=None):
    with BagWriter(path) as writer:
        for receive_ns, topic, sample in events:
            if topics is None or topic in topics:
                writer.write_sample(topic, receive_ns, sample)
    return str(path)


def read(out, node):
    """Return the parameters in a file, of those of a node, and their standard errors."""
    known = specs(NODE_PARAMS[node])
    errors = {}
    for line in out.read_text(encoding='utf-8').splitlines():
        name, _, note = line.partition('standard error ')
        if note:
            errors[name.split(':')[0].strip()] = [
                float(part) for part in note.strip('[]').replace(']', '').replace(
                    ',', '').split() if part[0].isdigit()]
    return load_files([out], node, known, known), errors


@pytest.fixture(scope='module')
def turns(tmp_path_factory):
    """Return a bag of random turns with S = 0.05 m and a pose reference."""
    run = turning_run(13, 50.0, wheel_latency=0.07, icr=0.05, turn=0.4)
    return str(write_run(tmp_path_factory.mktemp('bags') / 'run', run, 'ground_truth/odom'))


@pytest.fixture(scope='module')
def films():
    """Return a run with turns to both sides; the true film parameters are not nominal."""
    robot = RobotParams()
    robot = replace(robot, tire=replace(robot.tire, contact_length=LENGTH), film=replace(
        robot.film, spacing=SPACING, stretch_gain=GAINS))
    legs, duration = sequence((4.0, 110.0, 60.0), (4.0, 60.0, 110.0), (4.0, 130.0, 70.0),
                              (4.0, 50.0, 120.0))
    return simulate(SimulatorParams(seed=5, robot=robot, ground=CONCRETE), legs, duration)


@pytest.fixture
def out(tmp_path):
    return tmp_path / 'out.yaml'


def identify(kind, out, *words):
    return main(['identify', kind, *words, '--out', str(out)])


def test_each_kind_of_bags_has_a_function_and_steps_of_a_live_calibration():
    assert FUNCTIONS.keys() == STEPS_OF.keys()
    assert {*FUNCTIONS, 'film'} == VERBS['identify']['kinds'].keys()


def test_a_table_is_printed_and_the_written_file_can_be_loaded(turns, out, capsys):
    assert identify('geometry', out, turns, turns, '--truth') == 0
    output = capsys.readouterr().out
    for name in ('wheel latency', 'effective track', 'rolling radius, left', 'stamp jitter',
                 'gyro bias z', 'mounting roll'):
        assert name in output
    assert f'written to {out} and {out.with_suffix(".png")}' in output
    assert load_robot([out]).encoder.latency == pytest.approx(0.07, abs=0.02)
    assert out.with_suffix('.png').exists()


def test_unobservable_quantities_are_reported_with_the_reason(turns, out, capsys):
    assert identify('geometry', out, turns, '--until', '2.5') == 1
    output = capsys.readouterr().out
    assert 'wheel latency                   not observable: the wheels do not rotate' in output
    assert 'rolling radius                  not observable: there is no pose reference' in output
    assert 'imu.gyro_noise                  not written: ' in output
    assert 'nothing could be identified' in output and not out.exists()


@pytest.fixture
def placed(tmp_path):
    """Return the option for a parameter file with the position of the IMU."""
    file = tmp_path / 'placed.yaml'
    file.write_text('/**: {ros__parameters: {imu.position: [0.05, 0.02, 0.1]}}', encoding='utf-8')
    return ['--params', str(file)]


def test_s_by_an_imu_whose_position_is_not_given_is_refused(turns, out, capsys):
    assert identify('icr', out, turns) == 1
    assert 'imu.position_sigma is 1 m' in capsys.readouterr().err


def test_s_is_printed_per_turn_and_the_reference_is_used_on_request_only(
        turns, out, placed, capsys):
    for words, source in ((['--truth'], 'of the reference'), (placed, 'acceleration of the IMU')):
        assert identify('icr', out, turns, *words, '--force') == 0
        output = capsys.readouterr().out
        assert 'turn at' in output and 'spread over all turns' in output and source in output
        values, _ = read(out, 'slip_estimator')
        assert values['icr_x'] == pytest.approx(0.05, abs=0.01)
        assert 0.0 < values['icr_x_sigma'] < 0.2
        assert out.with_suffix('.png').read_bytes().startswith(b'\x89PNG')


def test_calibrate_only_identifies_the_same(turns, out, placed, tmp_path, capsys):
    assert identify('icr', out, turns, *placed) == 0
    words = ['calibrate', *placed, '--only', 'icr', '--bags', turns, '--out',
             str(tmp_path / 'all')]
    assert main(words) == 0
    assert out.read_text(encoding='utf-8') == (tmp_path / 'all/robot.yaml').read_text(
        encoding='utf-8')
    assert (tmp_path / 'all/icr.png').exists()
    assert main(words) == 2 and 'exists' in capsys.readouterr().err
    words[words.index(turns)] = f'lifted={turns}'
    assert main([*words, '--force']) == 2
    assert 'no recording on the ground' in capsys.readouterr().err


def test_the_stiffness_is_identified_from_starts_and_stops(out, tmp_path, capsys):
    bag = written(tmp_path / 'run', SCENARIOS['straight'].events(21), SLIP.inputs.values())
    assert identify('stiffness', out, bag) == 0
    assert 'measured over true' in capsys.readouterr().out
    values, _ = read(out, 'slip_estimator')
    sigma = values['tire.longitudinal_stiffness_sigma']
    assert values['tire.longitudinal_stiffness'] == pytest.approx(52.7, rel=3.0 * sigma)
    assert 0.0 < sigma < 0.15


def test_motors_are_identified_on_the_ground_and_lifted(out, tmp_path, capsys):
    ground, lifted = (written(tmp_path / name, in_step_events(SEED, lifted=name == 'up'))
                      for name in ('run', 'up'))
    assert identify('motor', out, ground, '--lifted', lifted) == 0
    printed = capsys.readouterr().out
    assert 'torque constant' in printed
    assert 'axle friction                   not observable' in printed
    values, _ = read(out, 'wheel_controller')
    sigma = values['motor.torque_constant_sigma']
    assert sigma <= 0.025
    assert values['motor.torque_constant'] == pytest.approx(
        1.2 * float(np.mean(truth(SEED)[0])), rel=2.0 * sigma)
    assert values['motor.inertia'] == pytest.approx(0.008, rel=0.2)
    assert values['pid.feed_forward'] == pytest.approx(1.0 / 22.0, rel=0.02)
    assert values['pid.stall_torque'] == pytest.approx(5.0, rel=0.06)
    assert 'up' in out.read_text(encoding='utf-8').splitlines()[0]
    assert out.with_suffix('.png').read_bytes().startswith(b'\x89PNG')


def test_gains_and_lengths_are_identified_and_the_file_can_be_loaded(films, out, tmp_path,
                                                                     capsys):
    assert identify('gains', out, written(tmp_path / 'run', films, INPUTS)) == 0
    output = capsys.readouterr().out
    assert 'per unit slip' in output and 'angle of film 1, front_right' in output
    values, errors = read(out, 'slip_estimator')
    for name, true in (('film.stretch_gain', GAINS), ('film.spacing', (SPACING,)),
                       ('tire.contact_length', (LENGTH,))):
        for value, sigma, expected in zip(
                np.atleast_1d(values[name]), errors[name.rpartition('.')[2]], true):
            assert value == pytest.approx(expected, abs=3.0 * sigma)
            assert sigma < 0.1 * expected
    assert 0.0 < values['film.stretch_gain_tolerance'] < 0.1
    assert load_robot([out]).film.gains('front_right') == tuple(values['film.stretch_gain'])
    assert out.with_suffix('.png').read_bytes().startswith(b'\x89PNG')


@pytest.mark.parametrize('missing', INPUTS)
def test_a_bag_without_an_input_is_rejected_with_its_name(films, out, tmp_path, capsys, missing):
    bag = written(tmp_path / 'run', films[:300], [name for name in INPUTS if name != missing])
    assert identify('gains', out, bag) == 1
    assert missing in capsys.readouterr().err and not out.exists()


def test_missing_films_of_an_instrumented_wheel_are_reported(films, out, tmp_path, capsys):
    wheels = tmp_path / 'wheels.yaml'
    wheels.write_text('/**:\n  ros__parameters:\n    film:\n      wheels: [rear_left]\n',
                      encoding='utf-8')
    bag = written(tmp_path / 'run', films[:300])
    assert identify('gains', out, bag, '--params', str(wheels)) == 1
    assert 'rear_left' in capsys.readouterr().err


@pytest.mark.parametrize('kind, words, reason', [
    ('icr', ['--until', '4'], 'intervals in turns, expected at least'),
    ('stiffness', [], 'speed changes too little'), ('motor', [], 'without motor torque')])
def test_a_recording_that_shows_nothing_fails_with_the_reason(turns, out, capsys, kind, words,
                                                              reason):
    assert identify(kind, out, turns, *words) == 1
    assert reason in capsys.readouterr().err and not out.exists()


def test_a_stationary_recording_shows_no_film(films, out, tmp_path, capsys):
    bag = written(tmp_path / 'run', films[:3000], INPUTS)
    assert identify('gains', out, bag, '--until', '2.5') == 1
    assert 'no film crossing was detected' in capsys.readouterr().err
