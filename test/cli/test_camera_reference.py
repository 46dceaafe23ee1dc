# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``analyze`` and ``report`` with the overhead camera: in the bag, in a folder, or not at all."""

from __future__ import annotations

from dataclasses import replace
import json
from pathlib import Path

import pytest
from smart_tire.bags import BagWriter
from smart_tire.cli.main import main
from smart_tire.parameters import build, SimulatorParams
from smart_tire.samples import NS_PER_S, Odometry
from smart_tire.simulation.offline import simulate
from support.recordings import write_bag

SIGMA = 0.02  # m, rad and per s, of the camera; and of its slips
COVARIANCE = tuple(SIGMA ** 2 if i % 7 == 0 else 0.0 for i in range(36))


@pytest.fixture(scope='module')
def events():
    """Return the events of a short drive."""
    return simulate(build(SimulatorParams, {'film.wheels': ['front_left'], 'seed': 2}),
                    [(0.5, 100.0, 60.0)], 4.0)


def seen(events, topics=('odom', 'wheel_slip')):
    """Return every tenth of the true poses and slips, as the camera would publish them."""
    found = []
    for topic in topics:
        for receive_ns, name, sample in events:
            if name == f'ground_truth/{topic}' and not sample.stamp_ns % (NS_PER_S // 10):
                if isinstance(sample, Odometry):
                    sample = replace(sample, pose_covariance=COVARIANCE,
                                     twist_covariance=COVARIANCE)
                else:
                    sample = replace(sample, sigma=tuple(max(SIGMA, s) for s in sample.sigma))
                found.append((receive_ns, f'overhead/{topic}', sample))
    return found


def without_truth(events):
    """Return the events that a real robot would record."""
    return [event for event in events if not event[1].startswith('ground_truth/')]


def bag_of(path, events):
    """Write ``events`` in order of reception; return the bag."""
    return write_bag(path, sorted(events, key=lambda event: event[0]))


def overhead(folder, events):
    """Write the output folder of ``smart_tire overhead`` with ``events``; return it."""
    with BagWriter(folder / 'estimates') as writer:
        for _, topic, sample in events:
            writer.write_sample(topic, sample.stamp_ns, sample)
    (folder / 'camera.png').write_bytes(b'\x89PNG picture')
    return folder


def analyzed(bag, out, *words):
    """Return the summary of an analysis."""
    assert main(['analyze', str(bag), '--out', str(out), '--no-checks', *map(str, words)]) == 0
    return json.loads((out / 'summary.json').read_text(encoding='utf-8'))


@pytest.fixture(scope='module')
def real(events, tmp_path_factory):
    """Return a bag without ground truth, and the output of ``smart_tire overhead`` for it."""
    folder = tmp_path_factory.mktemp('real')
    return bag_of(folder / 'drive', without_truth(events)), overhead(
        folder / 'camera', seen(events))


def test_the_camera_is_the_same_reference_in_the_bag_and_in_a_folder(
        events, real, tmp_path, capsys):
    bag, camera = real
    separate = analyzed(bag, tmp_path / 'a', '--overhead', camera)
    said = capsys.readouterr().out
    inside = analyzed(bag_of(tmp_path / 'both', without_truth(events) + seen(events)),
                      tmp_path / 'b')
    assert separate['against_truth'] is None
    assert separate['against_camera'] == inside['against_camera']
    assert set(separate['against_camera']) == {'baselines', 'pose', 'slip'}
    assert 'ground truth is not in the bag: errors are against the overhead camera' in '\n'.join(
        separate['left_out'])
    assert 'Errors of the path; camera aligned at the start' in said and 'mean camera' in said
    nothing = analyzed(bag, tmp_path / 'c')
    assert nothing['against_camera'] is nothing['against_truth'] is None
    assert 'ground truth is not in the bag: no errors are computed' in nothing['left_out']
    assert nothing['estimates'] == separate['estimates'] == inside['estimates']


def test_a_folder_replaces_the_camera_in_the_bag(events, real, tmp_path):
    wrong = [(ns, name, replace(one, linear=(9.0, 0.0, 0.0)) if isinstance(one, Odometry)
              else one) for ns, name, one in seen(events)]
    bag = bag_of(tmp_path / 'wrong', without_truth(events) + wrong)
    recorded, replaced = analyzed(bag, tmp_path / 'a'), analyzed(
        bag, tmp_path / 'b', '--overhead', real[1])
    errors = [one['against_camera']['pose']['twist']['v_x']['rms']
              for one in (recorded, replaced)]
    assert errors[0] > 8.0 and errors[1] < 0.3


def test_with_ground_truth_the_camera_does_not_change_the_errors(events, tmp_path):
    alone = analyzed(bag_of(tmp_path / 'one', events), tmp_path / 'a')
    both = analyzed(bag_of(tmp_path / 'two', events + seen(events)), tmp_path / 'b')
    assert both['against_truth'] == alone['against_truth'] and both['against_camera'] is None
    assert both['left_out'] == alone['left_out']


def test_a_part_of_the_camera_gives_a_part_of_the_errors(events, real, tmp_path):
    summary = analyzed(real[0], tmp_path / 'out', '--overhead',
                       overhead(tmp_path / 'camera', seen(events, ['odom'])))
    assert set(summary['against_camera']) == {'baselines', 'pose'}
    assert 'overhead/wheel_slip is missing: no errors of slips' in summary['left_out']


def test_a_camera_of_another_time_is_named(events, real, tmp_path):
    late = [(ns, name, replace(one, stamp_ns=one.stamp_ns + 3600 * NS_PER_S))
            for ns, name, one in seen(events)]
    summary = analyzed(real[0], tmp_path / 'out', '--overhead', overhead(tmp_path / 'late', late))
    assert (summary['against_camera'] or {}).get('pose') is None
    for name in ('odom', 'wheel_slip'):
        assert (f'overhead/{name}: its timestamps do not overlap those of wheel_states'
                in summary['left_out'])


@pytest.mark.parametrize('verb', ['analyze', 'report'])
def test_a_wrong_folder_is_one_line(verb, real, tmp_path, capsys):
    bag, camera = real
    (tmp_path / 'empty').mkdir()
    for given, reason in ((tmp_path / 'empty', 'empty'), (tmp_path / 'no', 'no'),
                          (bag, 'neither overhead/odom nor overhead/wheel_slip in the bag: '
                                'expected the output folder of "smart_tire overhead"')):
        out = tmp_path / 'out.html'
        assert main([verb, str(bag), '--overhead', str(given), '--out', str(out)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f'smart_tire {verb}: ') and reason in line
        assert not out.exists()
    other = tmp_path / 'other'
    other.symlink_to(next(bag.glob('*.mcap')))
    assert main([verb, str(bag), str(other), '--overhead', str(camera), '--out',
                 str(tmp_path / 'out')]) == 2
    assert '--overhead is for one bag, 2 are given' in capsys.readouterr().err


def test_the_report_names_the_camera_and_contains_its_picture(real, tmp_path):
    bag, camera = real
    page, params = tmp_path / 'report.html', tmp_path / 'robot.yaml'
    params.write_text('/**: {ros__parameters: {wheel_radius: 0.087}}')
    assert main(['report', str(bag), '--overhead', str(camera), '--out', str(page),
                 '--params', str(params)]) == 0
    text = page.read_text(encoding='utf-8')
    assert 'Errors against the overhead camera' in text
    assert 'by the covariances that estimator and camera report, added' in text
    assert 'of the distance, by the overhead camera' in text
    assert 'data:image/png;base64,iVBORyBwaWN0dXJl' in text  # the bytes of camera.png
    assert 'camera \\u00b1 2\\u03c3' in text or 'camera ± 2σ' in text
    policy = text[text.index('Content-Security-Policy'):][:400]
    assert 'sha256-' in policy and "script-src 'unsafe-inline'" not in policy
    assert 'Errors against ground truth' not in text
    assert not Path(tmp_path / 'camera.png').exists()
