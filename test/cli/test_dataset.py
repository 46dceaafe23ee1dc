# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Many bags into one data set: ``smart_tire analyze --dataset``, and other verbs of many bags."""

from __future__ import annotations

import json
import os
from pathlib import Path
import re
import resource
import shutil
import subprocess
import sys

import pytest

from smart_tire.api import estimate, load_params
from smart_tire.cli.main import main
from support.fleet import Cluster, serving, write_fleet
from support.recordings import write_bag

pytest.importorskip('pyarrow', reason='needs pyarrow')
pytestmark = [pytest.mark.processes, pytest.mark.slow]

HOW_TO = Path(__file__).parents[2] / 'docs' / 'how_to' / 'fleet.md'


@pytest.fixture(scope='module')
def fleet(tmp_path_factory):
    """Return the folder of the bags of two robots, and their parameter file."""
    folder = tmp_path_factory.mktemp('fleet') / 'bags'
    params = write_fleet(folder)
    return folder, params


def analyze(*words):
    return main(['analyze', *map(str, words)])


def files(folder):
    """Return the bytes of all tables in a data set."""
    return {str(path.relative_to(folder)): path.read_bytes()
            for path in sorted(folder.rglob('*.parquet'))}


@pytest.fixture(scope='module')
def done(fleet, tmp_path_factory):
    """Return a data set of all bags, written one by one by one process."""
    out = tmp_path_factory.mktemp('done') / 'fleet'
    for bag in sorted(fleet[0].glob('*/*')):
        assert analyze(bag, '--params', fleet[1], '--dataset', out, '--jobs', 1) == 0
    return out


@pytest.fixture
def copy(fleet, tmp_path):
    """Return a folder with two bags, which a test may change, and their parameter file."""
    shutil.copytree(fleet[0] / 'alpha', tmp_path / 'bags')
    return tmp_path / 'bags', fleet[1]


def rows(dataset, table='drives', columns='*'):
    """Return the rows of a table as dictionaries, by drive."""
    duckdb = pytest.importorskip('duckdb', reason='needs duckdb')
    found = duckdb.sql(f"SELECT {columns} FROM read_parquet('{dataset}/{table}/*/*/*.parquet', "
                       'hive_partitioning = true)')
    return [dict(zip(found.columns, row)) for row in found.fetchall()]


def test_tables_are_the_same_one_by_one_in_processes_and_on_a_cluster(fleet, done, tmp_path):
    pytest.importorskip('distributed', reason='needs dask.distributed')
    common = [fleet[0], '--params', fleet[1], '--dataset']
    assert analyze(*common, tmp_path / 'two', '--jobs', 2) == 0
    with Cluster() as cluster:
        assert analyze(*common, tmp_path / 'cluster', '--dask', cluster.address) == 0
    expected = files(done)
    assert len(expected) >= 4 * 5
    assert files(tmp_path / 'two') == files(tmp_path / 'cluster') == expected


def test_rows_are_the_estimates_of_the_bag_with_units_and_versions(fleet, done):
    import pyarrow.parquet as pq
    for bag in sorted(fleet[0].glob('*/*')):
        found = estimate(bag, load_params(fleet[1]))
        for table, one in (('odom', found.pose), ('wheel_slip', found.slip),
                           ('tire_friction', found.friction), ('ground_state', found.ground)):
            path, = done.glob(f'{table}/robot={bag.parent.name}/date=*/{bag.name}-*.parquet')
            written = pq.read_table(path, partitioning=None)
            assert written['stamp_ns'].to_pylist() == one.stamp_ns.tolist()
            for name, values in one.columns().items():
                column = written[name.replace('.', '_')].to_pylist()
                assert [repr(value) for value in column] == [
                    repr(value) if isinstance(value, str) or abs(value) < float('inf')
                    else 'None' for value in values.tolist()]
            assert written.schema.metadata[b'smart_tire.schema'] == b'1'
            assert written.schema.metadata[b'smart_tire.key']
            assert {*written['schema'].to_pylist()} == {1}
    units = {field.name: field.metadata[b'unit'].decode() for field in pq.read_schema(
        next(done.glob('tire_friction/*/*/*.parquet')))}
    assert units['normal_load_sigma'] == 'N' and units['slip'] == '-'
    drives = rows(done)
    assert len(drives) == 4 and {row['robot'] for row in drives} == {'alpha', 'beta'}
    for row in drives:
        assert row['status'] == 'estimated' and 2.0 < row['distance'] < 4.0
        assert row['position_end'] < 0.5 and row['reference'] == 'ground truth'
        assert row['parameters'] == str(fleet[1]) and row['errors'] == []


def test_what_is_done_is_not_done_again_unless_it_has_changed(copy, tmp_path, capsys):
    bags, params = copy
    robot = tmp_path / 'robot.yaml'
    shutil.copy(params, robot)
    words = [bags, '--params', robot, '--dataset', tmp_path / 'out']
    assert analyze(*words) == 0
    first = {path: path.stat().st_mtime_ns for path in tmp_path.rglob('*.parquet')}

    def again(*more):
        capsys.readouterr()
        assert analyze(*words, *more) == 0
        found = {path: path.stat().st_mtime_ns for path in tmp_path.rglob('*.parquet')}
        changed = {path.name.partition('-')[0] for path in found if found[path] != first.get(path)}
        first.update(found)
        return changed, capsys.readouterr().out.splitlines()[-1]

    assert again() == (set(), f'2 bags: 2 done before; written to {tmp_path / "out"}')
    os.utime(bags / 'drive_1' / 'drive_1_0.mcap')
    assert again()[0] == {'drive_1'}
    robot.write_text(params.read_text().replace('0.087', '0.088'))
    assert again()[0] == {'drive_0', 'drive_1'}
    assert again()[0] == set()
    assert again('--force')[0] == {'drive_0', 'drive_1'}
    assert again('--reports')[0] == {'drive_0', 'drive_1'}
    page = (tmp_path / 'out' / 'index.html').read_text()
    links = re.findall(r'<a href="(reports/drive_\d-\w+.html)">drive_', page)
    assert len(links) == 2
    assert all('<h1>drive_' in (tmp_path / 'out' / link).read_text() for link in links)


def test_another_version_does_all_again(copy, tmp_path, monkeypatch):
    bags, params = copy
    words = [bags / 'drive_0', '--params', params, '--dataset', tmp_path / 'out']
    assert analyze(*words) == 0
    before, = (tmp_path / 'out').glob('drives/*/*/*.parquet')
    monkeypatch.setattr('smart_tire.__version__', '99.0')
    assert analyze(*words) == 0
    after, = (tmp_path / 'out').glob('drives/*/*/*.parquet')
    assert after == before and rows(tmp_path / 'out')[0]['version'] == '99.0'


def test_bags_that_cannot_be_read_are_rows_and_do_not_stop_the_others(copy, tmp_path, capsys):
    bags, params = copy
    (bags / 'damaged.mcap').write_text('no bag')
    write_bag(bags / 'empty', [])
    out = tmp_path / 'out'
    assert analyze(bags, '--params', params, '--dataset', out) == 2
    lines = capsys.readouterr().out.splitlines()
    assert f'{bags}/damaged.mcap: unreadable: {bags}/damaged.mcap: not an MCAP file' in '\n'.join(
        lines)
    assert lines[-1].startswith('4 bags: 2 estimated, 1 ')
    found = {row['drive'].partition('-')[0]: row for row in rows(out)}
    assert found['damaged']['status'] == 'unreadable' and found['damaged']['robot'] is None
    assert 'not an MCAP file' in found['damaged']['error']
    assert found['empty']['status'] == 'nothing'
    page = (out / 'index.html').read_text()
    assert 'unreadable: ' in page and '2 without estimates' in page
    # a bag that is damaged now keeps what was computed of it; one that is mended is read
    shutil.copy(bags / 'drive_0' / 'drive_0_0.mcap', bags / 'damaged.mcap')
    (bags / 'drive_1' / 'drive_1_0.mcap').write_text('no bag')
    assert analyze(bags, '--params', params, '--dataset', out) == 2
    found = {row['drive'].partition('-')[0]: row['status'] for row in rows(out)}
    assert found == {'damaged': 'estimated', 'drive_0': 'estimated', 'drive_1': 'estimated',
                     'empty': 'nothing'}


def test_a_bag_of_another_robot_is_refused_by_name(fleet, tmp_path, capsys):
    assert analyze(fleet[0] / 'alpha' / 'drive_0', fleet[0] / 'beta' / 'drive_0', '--params',
                   fleet[1], '--robot', 'alpha', '--dataset', tmp_path / 'out') == 2
    assert 'drive_0: of robot beta, expected alpha (--robot)' in capsys.readouterr().out
    assert sorted((row['robot'], row['status']) for row in rows(tmp_path / 'out')) == [
        ('alpha', 'estimated'), ('alpha', 'unreadable')]


def test_a_full_disk_is_one_line_and_what_was_written_is_kept(fleet, done, tmp_path):
    out = tmp_path / 'out'
    of_beta = [f'{path.stem}.*' for path in done.glob('drives/robot=beta/*/*')]
    shutil.copytree(done, out, ignore=shutil.ignore_patterns(*of_beta))
    before = files(out)
    assert 0 < len(before) < len(files(done))
    limit = min(map(len, before.values())) + 100  # bytes of a file

    def limited():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    words = ['-m', 'smart_tire.cli.main', 'analyze', fleet[0], '--params', fleet[1],
             '--dataset', out]
    ended = subprocess.run([sys.executable, *map(str, words)], capture_output=True, text=True,
                           preexec_fn=limited)
    assert ended.returncode == 2
    error = [line for line in ended.stderr.splitlines() if 'cannot be written' in line]
    assert len(error) == 1 and 'Traceback' not in ended.stderr
    assert error[0].startswith('smart_tire analyze: ')
    assert 'File too large' in error[0] and error[0].endswith('computed before is kept')
    assert before.items() <= files(out).items()
    assert not list(out.rglob('.*'))
    assert subprocess.run([sys.executable, *map(str, words)], check=False).returncode == 0
    assert files(out) == files(done)


def test_urls_are_in_the_results_by_their_names(copy, tmp_path, monkeypatch, capsys):
    pytest.importorskip('fsspec', reason='needs fsspec')
    pytest.importorskip('aiohttp', reason='needs fsspec')
    bags, params = copy
    monkeypatch.chdir(tmp_path)
    with serving(bags) as server:
        common = [f'{server.url}/drive_0', '--params', params]
        assert analyze(*common, '--dataset', 'out') == 0
        assert rows('out')[0]['bag'] == f'{server.url}/drive_0'
        assert analyze(*common, '--no-figures') == 0
        summary = json.loads(Path('drive_0_analyzed/summary.json').read_text())
        assert summary['bag'] == f'{server.url}/drive_0'
        assert f'{server.url}/drive_0: 4.' in capsys.readouterr().out
        assert main(['report', *map(str, common)]) == 0
        assert f'<dd>{server.url}/drive_0</dd>' in Path('drive_0_report.html').read_text()
        assert main(['doctor', server.url, '--params', str(params), '--json']) == 0
        out = capsys.readouterr().out
        found = json.loads(out[out.index('\n{'):])
        assert sorted(found) == [f'{server.url}/drive_0', f'{server.url}/drive_1']


def test_doctor_heads_the_findings_of_each_of_many_bags(fleet, capsys):
    assert main(['doctor', str(fleet[0] / 'alpha'), '--params', str(fleet[1])]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert {f'{fleet[0]}/alpha/drive_{n}:' for n in range(2)} <= {*lines}
    assert sum(line.startswith('0 errors') for line in lines) == 2


@pytest.mark.parametrize('words', [
    ['--smooth'], ['--csv'], ['--no-figures'], ['--out', 'x'], ['--jobs', '0']])
def test_options_that_do_not_fit_are_refused(words, fleet, tmp_path, capsys):
    try:
        status = analyze(fleet[0], '--dataset', tmp_path / 'out', *words)
    except SystemExit as ended:
        status = ended.code
    assert status == 2 and not (tmp_path / 'out').exists()


def test_an_unreachable_cluster_and_an_empty_folder_are_one_line(
        fleet, tmp_path, capsys, monkeypatch):
    pytest.importorskip('distributed', reason='needs dask.distributed')
    monkeypatch.setattr('smart_tire.fleet.running.CONNECT_TIMEOUT', 0.5)
    assert analyze(fleet[0], '--dataset', tmp_path / 'out', '--dask', 'tcp://127.0.0.1:9') == 2
    error, = (line for line in capsys.readouterr().err.splitlines() if 'cluster' in line)
    assert error.startswith('smart_tire analyze: cluster tcp://127.0.0.1:9: not reached in ')
    (tmp_path / 'empty').mkdir()
    assert analyze(tmp_path / 'empty', '--dataset', tmp_path / 'out') == 2
    assert 'empty: not a rosbag2 directory' in capsys.readouterr().err


def test_the_queries_of_the_how_to_run_and_give_its_columns(done, monkeypatch):
    duckdb = pytest.importorskip('duckdb', reason='needs duckdb')
    monkeypatch.chdir(done.parent)
    text = HOW_TO.read_text(encoding='utf-8')
    queries = re.findall(r'```sql\n(.*?)```\n+```text\n(.*?)```', text, re.DOTALL)
    assert len(queries) == 3
    for query, shown in queries:
        found = duckdb.sql(query)
        assert re.findall(r'\w+', shown.splitlines()[0]) == found.columns
        assert found.fetchall()


def test_the_how_to_lists_all_columns_of_the_drives():
    from smart_tire.fleet.dataset import COLUMNS
    listed = re.findall(r'^\| `(\w+)` \| (.*?) \| (.*) \|$', HOW_TO.read_text(encoding='utf-8'),
                        re.MULTILINE)
    assert listed == [(name, unit, meaning) for name, (_, unit, meaning) in COLUMNS.items()]


def test_the_rows_of_all_drives_have_their_robots_and_dates(tmp_path):
    from smart_tire.fleet.dataset import Dataset
    dataset = Dataset(tmp_path)
    for name, robot, date in (('c', '', ''), ('b', 'fleet/r7', '2026-01-02'), ('a', 'x', '')):
        dataset.write(name, 'key', robot, date, {'bag': name, 'warnings': ['w']}, {})
    assert [(row['drive'], row['robot'], row['date'], row['warnings'], row['friction'])
            for row in dataset.drives()] == [
        ('c', None, None, ['w'], None), ('b', 'fleet/r7', '2026-01-02', ['w'], None),
        ('a', 'x', None, ['w'], None)]
