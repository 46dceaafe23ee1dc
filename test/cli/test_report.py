# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The command line of ``smart_tire report``: files, names, dates and exit status."""

from dataclasses import replace
from pathlib import Path
import re
import shutil

import pytest

from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.analysis.tables import date_text
from smart_tire.bags import Bag, BagWriter, PARAMETERS_KEY
from smart_tire.cli.main import main
from smart_tire.parameters import build, SimulatorParams
from smart_tire.simulation.offline import simulate
from support.recordings import write_bag


@pytest.fixture(scope='module')
def demo(tmp_path_factory):
    """Return a folder with a bag one level below, as the demo writes it."""
    folder = tmp_path_factory.mktemp('recorded') / 'my_demo'
    write_bag(folder / 'bag', simulate(
        build(SimulatorParams, {'film.wheels': ['front_left'], 'seed': 2}),
        [(0.2, 100.0, 60.0)], 1.0))
    return folder


def report(*words):
    return main(['report', *map(str, words)])


def test_the_report_of_a_demo_folder_has_its_name(demo, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert report(demo) == 0
    text = Path('my_demo_report.html').read_text()
    assert '<h1>my_demo</h1>' in text and str(demo / 'bag') in text
    assert 'Software</dt><dd>smart_tire 0.' in text
    with Bag(demo / 'bag') as bag:
        assert f'Recorded</dt><dd>{date_text(bag.span_ns[0])}</dd>' in text
    assert [path.name for path in tmp_path.iterdir()] == ['my_demo_report.html']


def test_a_report_is_replaced_with_force_only(demo, tmp_path, capsys):
    out = tmp_path / 'new' / 'drive.html'
    out.parent.mkdir()
    out.write_text('mine')
    assert report(demo, '--out', out) == 2
    assert 'drive.html exists' in capsys.readouterr().err
    assert out.read_text() == 'mine'
    assert report(demo, '--out', out, '--force') == 0
    assert out.read_text().startswith('<!DOCTYPE html>')


def test_several_bags_have_a_file_each_in_a_new_folder(demo, tmp_path):
    copy = tmp_path / 'copy'
    shutil.copytree(demo / 'bag', copy)
    assert report(demo, copy, '--out', tmp_path / 'out') == 0
    assert {path.name for path in (tmp_path / 'out').iterdir()} == {
        'my_demo_report.html', 'copy_report.html'}


def test_one_file_for_two_bags_is_refused(demo, tmp_path, capsys):
    assert report(demo, demo / 'bag', '--out', tmp_path / 'x.html') == 2
    assert 'give a folder' in capsys.readouterr().err
    assert report(demo, demo / 'bag') == 2
    assert '2 bags would be written to my_demo_report.html' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_report_has_the_parameters_in_the_bag_and_their_source(tmp_path):
    params = EstimatorParams.load([])
    params = replace(params, slip=replace(
        params.slip, robot=replace(params.robot, wheel_radius=0.0875)))
    with BagWriter(tmp_path / 'bag', custom_data={PARAMETERS_KEY: params.text}) as writer:
        for receive_ns, topic, sample in simulate(SimulatorParams(), [(0.2, 100.0, 60.0)], 0.6):
            writer.write_sample(topic, receive_ns, sample)
    out = tmp_path / 'x.html'
    assert report(tmp_path / 'bag', '--out', out) == 0
    rows = re.findall(r'<tr>.*?</tr>', out.read_text(), re.DOTALL)
    row, = (row for row in rows if 'wheel_radius<' in row and '0.0875' in row)
    assert 'the bag' in row and 'slip_estimator' in row


def test_nothing_is_written_into_the_folder_of_a_bag(demo, capsys):
    before = sorted(demo.rglob('*'))
    assert report(demo, '--out', demo / 'bag' / 'x.html', '--force') == 2
    assert 'is in the folder of the bag' in capsys.readouterr().err
    assert sorted(demo.rglob('*')) == before


def test_a_bag_without_estimates_has_no_report(tmp_path, capsys):
    assert report(write_bag(tmp_path / 'empty', []), '--out', tmp_path / 'x.html') == 1
    assert 'nothing can be estimated' in capsys.readouterr().out
    assert not (tmp_path / 'x.html').exists()


def test_a_file_instead_of_the_folder_is_an_error_in_one_line(demo, tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert report(demo, '--out', tmp_path / 'file' / 'x.html') == 2
    assert 'cannot be written' in capsys.readouterr().err


def test_simulated_time_is_not_a_date():
    assert date_text(946_684_800 * 10 ** 9) == '2000-01-01 00:00:00 UTC'
    assert date_text(12_300_000_000) == 'date unknown (receive times start at 12.3 s)'
