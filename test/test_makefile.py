# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The progress of an installation by the Makefile."""

from pathlib import Path
import shutil
import subprocess

import pytest

MAKEFILE = Path(__file__).resolve().parents[1] / 'Makefile'

pytestmark = [pytest.mark.processes, pytest.mark.skipif(
    shutil.which('make') is None, reason='needs make')]


@pytest.mark.parametrize(('log', 'packages', 'share'), [
    ('Collecting a\n  Collecting\nProcessing ./b\n', '10', '25 %'),
    ('Collecting a\n' * 9, '2', '99 %'), ('', '10', '15 %'), (None, '10', '15 %'),
    ('Collecting a\n', '', '')])
def test_the_share_of_an_installation(log, packages, share, tmp_path):
    if log is not None:
        (tmp_path / 'install.log').write_text(log)
    for name in 'a-1.dist-info', 'b-2.dist-info':
        (tmp_path / 'lib' / 'python3.11' / 'site-packages' / name).mkdir(parents=True)
    (tmp_path / 'share.mk').write_text(
        f'include {MAKEFILE}\nshare:\n\t@present=1; echo "$(SHARE)"\n')
    done = subprocess.run(
        ['make', '--no-print-directory', '-f', tmp_path / 'share.mk', 'share', f'VENV={tmp_path}',
         f'PACKAGES={packages}'], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == share
