# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Errors of exported paths by evo, which are ours."""

import json
import os
from pathlib import Path
import shutil
import subprocess
import sys
import zipfile

import pytest

from smart_tire.analysis.export import export
from smart_tire.analysis.metrics import pose_score
from smart_tire.analysis.offline import analyze
from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.analysis.result import Result

EVO = shutil.which('evo_ape', path=Path(sys.executable).parent) or shutil.which('evo_ape')
pytestmark = [pytest.mark.processes, pytest.mark.long, pytest.mark.skipif(
    EVO is None, reason='needs evo: pip install evo')]


def rmse(program, form, folder, *options):
    """Return the rmse that a program of evo prints for the exported files."""
    result = folder / 'result.zip'
    result.unlink(missing_ok=True)
    subprocess.run([Path(EVO).with_name(program), form, folder / f'reference.{form}',
                    folder / f'odom.{form}', *options, '--save_results', result, '--no_warnings'],
                   env={**os.environ, 'HOME': str(folder)}, check=True, capture_output=True)
    with zipfile.ZipFile(result) as file:
        return json.loads(file.read('stats.json'))['rmse']


@pytest.mark.parametrize('align, option', [
    ('start', ['--align_origin']), ('se2', ['--align']), ('none', [])])
def test_evo_finds_the_same_errors(align, option, drive_bag, tmp_path):
    """Absolute errors of position and heading, and the displacements in each meter."""
    own = analyze(drive_bag, None, EstimatorParams()).result
    result = Result(own.estimates, truth=own.truth, align=align)
    export(tmp_path, result.comparisons, ['tum', 'kitti'])
    score = pose_score(result.filtered.poses)
    for form in ('tum', 'kitti'):
        found = rmse('evo_ape', form, tmp_path, *option)
        assert found == pytest.approx(score.position_rms_m, rel=1e-5), form
    found = rmse('evo_ape', 'tum', tmp_path, *option, '--pose_relation', 'angle_rad')
    assert found == pytest.approx(score.yaw.rms, rel=1e-4)
    found = rmse('evo_rpe', 'tum', tmp_path, '--delta', '1', '--delta_unit', 'm')
    assert found == pytest.approx(score.drift_per_meter_m, rel=1e-5)
    shown = subprocess.run(
        [Path(EVO).with_name('evo_traj'), 'tum', tmp_path / 'odom.tum', '--full_check'],
        env={**os.environ, 'HOME': str(tmp_path)}, check=True, capture_output=True, text=True)
    assert f'{len(result.filtered.poses.stamp_ns)}' in shown.stdout.split('nr. of poses')[1]
