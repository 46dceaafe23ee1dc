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

"""``smart_tire identify gains`` on the command line."""

from __future__ import annotations

from dataclasses import replace

from benchmarks.scenarios import CONCRETE, sequence
import pytest
from smart_tire.bags import BagWriter
from smart_tire.cli.main import main
from smart_tire.estimation.streams import INPUTS
from smart_tire.parameters import load_files, load_robot, RobotParams, SimulatorParams, specs
from smart_tire.simulation.offline import simulate

LENGTH, SPACING, GAINS = 0.048, 0.031, (290.0, 255.0)


@pytest.fixture(scope='module')
def events():
    """Return a run with turns to both sides; the true film parameters are not nominal."""
    robot = RobotParams()
    robot = replace(robot, tire=replace(robot.tire, contact_length=LENGTH), film=replace(
        robot.film, spacing=SPACING, stretch_gain=GAINS))
    legs, duration = sequence((5.0, 110.0, 60.0), (5.0, 60.0, 110.0), (5.0, 130.0, 70.0),
                              (5.0, 50.0, 120.0))
    return simulate(SimulatorParams(seed=5, robot=robot, ground=CONCRETE), legs, duration)


def written(path, events, topics=INPUTS):
    with BagWriter(path) as writer:
        for receive_ns, topic, sample in events:
            if topic in topics:
                writer.write_sample(topic, receive_ns, sample)
    return str(path)


def read(out):
    """Return the parameters in a file, and their standard errors."""
    known = specs(RobotParams)
    values = load_files([out], 'slip_estimator', known, known)
    errors = {}
    for line in out.read_text(encoding='utf-8').splitlines():
        name, _, note = line.partition('standard error ')
        if note:
            errors[name.split(':')[0].strip()] = [
                float(part) for part in note.strip('[]').replace(']', '').replace(
                    ',', '').split() if part[0].isdigit()]
    return values, errors


def test_gains_and_lengths_are_identified_and_the_file_can_be_loaded(events, tmp_path, capsys):
    out = tmp_path / 'films.yaml'
    bag = written(tmp_path / 'run', events)
    assert main(['identify', 'gains', bag, '--out', str(out)]) == 0
    output = capsys.readouterr().out
    assert 'per unit slip' in output
    assert 'angle of film 1, front_right' in output
    values, errors = read(out)
    for name, true in (('film.stretch_gain', GAINS), ('film.spacing', (SPACING,)),
                       ('tire.contact_length', (LENGTH,))):
        found = values[name] if isinstance(values[name], tuple | list) else (values[name],)
        for value, sigma, expected in zip(found, errors[name.rpartition('.')[2]], true):
            assert value == pytest.approx(expected, abs=3.0 * sigma)
            assert sigma < 0.1 * expected
    assert 0.0 < values['film.stretch_gain_tolerance'] < 0.1
    assert out.with_suffix('.png').read_bytes().startswith(b'\x89PNG')
    robot = load_robot([out])
    assert robot.tire.contact_length == values['tire.contact_length']
    assert robot.film.gains('front_right') == tuple(values['film.stretch_gain'])


def test_a_stationary_recording_is_rejected_with_the_reason(events, tmp_path, capsys):
    out = tmp_path / 'films.yaml'
    bag = written(tmp_path / 'run', events)
    assert main(['identify', 'gains', bag, '--until', '2.5', '--out', str(out)]) == 1
    assert 'no film crossing was detected' in capsys.readouterr().err
    assert not out.exists()


@pytest.mark.parametrize('missing', INPUTS)
def test_a_bag_without_an_input_is_rejected_with_its_name(events, tmp_path, capsys, missing):
    bag = written(tmp_path / 'run', events[:300], [name for name in INPUTS if name != missing])
    assert main(['identify', 'gains', bag]) == 1
    assert missing in capsys.readouterr().err


def test_missing_films_of_an_instrumented_wheel_are_reported(
        events, tmp_path, capsys):
    wheels = tmp_path / 'wheels.yaml'
    wheels.write_text('/**:\n  ros__parameters:\n    film:\n      wheels: [rear_left]\n',
                      encoding='utf-8')
    bag = written(tmp_path / 'run', events[:300])
    assert main(['identify', 'gains', bag, '--params', str(wheels)]) == 1
    assert 'rear_left' in capsys.readouterr().err
