# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Estimates as files of other tools."""

import sys

import numpy as np
import pytest

from smart_tire.analysis.export import export, FORMATS
from smart_tire.analysis.offline import analyze
from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.analysis.result import Result
from smart_tire.errors import ParameterError
from smart_tire.recording import SampleArrays
from smart_tire.rotation import euler
from support.driving import driven

EPOCH = 1_700_000_000_012_345_678


def test_paths_have_one_row_per_timestamp_of_the_reference(tmp_path):
    result = Result(driven(400, begin_ns=EPOCH, speed=0.6),
                    truth=driven(30, 10.0, begin_ns=EPOCH, speed=0.5))
    export(tmp_path, result.comparisons, ['tum', 'kitti'])
    own, true = (np.loadtxt(tmp_path / f'{name}.tum') for name in ('odom', 'reference'))
    assert own.shape == true.shape == (30, 8)
    assert (tmp_path / 'odom.tum').read_text().startswith('1700000000.012345678 ')
    assert own[:, 1] == pytest.approx(0.6 * 0.1 * np.arange(30))
    assert true[:, 1] == pytest.approx(0.5 * 0.1 * np.arange(30))
    rows = np.loadtxt(tmp_path / 'odom.kitti').reshape(30, 3, 4)
    assert rows[:, :, :3] == pytest.approx(np.broadcast_to(np.eye(3), (30, 3, 3)))
    assert rows[:, 0, 3] == pytest.approx(own[:, 1])


def test_headings_are_the_same_in_both_formats(drive_bag, tmp_path):
    found = analyze(drive_bag, None, EstimatorParams()).result
    export(tmp_path, found.comparisons, ['tum', 'kitti'])
    quaternions = np.loadtxt(tmp_path / 'odom.tum')[:, 4:]
    matrices = np.loadtxt(tmp_path / 'odom.kitti').reshape(-1, 3, 4)
    yaw = np.array([euler(tuple(row))[2] for row in quaternions.tolist()])
    assert np.unwrap(yaw) == pytest.approx(found.filtered.poses.estimated[:, 2], abs=1e-7)
    assert np.cos(yaw) == pytest.approx(matrices[:, 0, 0], abs=1e-7)
    assert np.sin(yaw) == pytest.approx(matrices[:, 1, 0], abs=1e-7)
    assert matrices[:, 0, 1] == pytest.approx(-matrices[:, 1, 0])


def test_without_a_reference_the_path_is_that_of_the_estimates(tmp_path):
    export(tmp_path, Result(driven(40)).comparisons, FORMATS[:2])
    assert sorted(path.name for path in tmp_path.iterdir()) == ['odom.kitti', 'odom.tum']
    assert len(np.loadtxt(tmp_path / 'odom.tum')) == 40
    export(tmp_path / 'empty', Result(SampleArrays()).comparisons, FORMATS)
    assert not (tmp_path / 'empty').exists()


def test_tables_have_all_estimates(tmp_path):
    pandas = pytest.importorskip('pandas')
    result = Result(driven(40, begin_ns=EPOCH), smoothed=driven(30, begin_ns=EPOCH))
    export(tmp_path, result.comparisons, ['csv'])
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        'odom.csv', 'smoothed_odom.csv', 'smoothed_wheel_slip.csv', 'wheel_slip.csv']
    read = pandas.read_csv(tmp_path / 'odom.csv', index_col='stamp_ns')
    pandas.testing.assert_frame_equal(read, result.estimates.poses().to_pandas(),
                                      check_exact=True)
    assert len(pandas.read_csv(tmp_path / 'smoothed_odom.csv')) == 30


def test_parquet_needs_pyarrow(tmp_path, monkeypatch):
    result = Result(driven(40, begin_ns=EPOCH))
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    with pytest.raises(ModuleNotFoundError, match='pyarrow'):
        export(tmp_path, result.comparisons, ['parquet'])
    monkeypatch.undo()
    pandas = pytest.importorskip('pandas')
    pytest.importorskip('pyarrow')
    export(tmp_path, result.comparisons, ['parquet'])
    pandas.testing.assert_frame_equal(pandas.read_parquet(tmp_path / 'wheel_slip.parquet'),
                                      result.estimates.slips().to_pandas())


def test_a_path_that_cannot_be_written_is_an_error(tmp_path):
    (tmp_path / 'odom.csv').mkdir()
    with pytest.raises(ParameterError, match='odom.csv: cannot be written'):
        export(tmp_path, Result(driven(40)).comparisons, ['csv'])
