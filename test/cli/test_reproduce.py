# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""``smart_tire reproduce`` on the command line, with short drives."""

from __future__ import annotations

import base64
from contextlib import redirect_stdout
import io
import re

import pytest

from smart_tire.cli.main import main
from smart_tire.papers import runner, tire_runs

pytestmark = pytest.mark.slow

PAGES = (
    *(f'paper_a_{name}' for name in ('fig_4', 'fig_6', 'fig_7', 'fig_8', 'fig_9', 'table_1')),
    *(f'paper_b_{name}' for name in (
        'fig_8', 'fig_9', 'fig_10', 'fig_11', 'fig_12', 'fig_13', 'table_1')))


@pytest.fixture(scope='module')
def written(tmp_path_factory):
    """Return the output folder of a run with short drives; its output is in a text file."""
    out = tmp_path_factory.mktemp('reproduced') / 'deeper' / 'report'
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runner, 'OTHER_SIDE_SPEEDS', (20.0, 100.0))
        for name in ('SWEEP', 'SLIP', 'SIGNAL', 'STIFFNESS'):
            patch.setattr(runner, f'{name}_DURATION', 4.0)
        patch.setattr(tire_runs, 'IMAGE_RATE', 5.0)
        with redirect_stdout(io.StringIO()) as output:
            assert main(['reproduce', '--out', str(out)]) == 0
    out.with_suffix('.txt').write_text(output.getvalue(), encoding='utf-8')
    return out


def test_every_figure_and_table_is_a_png_file_and_there_is_one_report(written):
    assert {path.name for path in written.iterdir()} == {
        'report.html', *(f'{name}.png' for name in PAGES)}
    for name in PAGES:
        assert (written / f'{name}.png').read_bytes().startswith(b'\x89PNG')


def test_the_report_needs_no_other_file(written):
    text = (written / 'report.html').read_text(encoding='utf-8')
    assert not re.search(r'<(script|link|iframe|object)\b', text, re.IGNORECASE)
    references = re.findall(r'\s(?:src|href|srcset|data|action|poster)\s*=\s*"?(.{22})', text)
    assert len(references) >= len(PAGES)
    assert all(reference.startswith(('#', 'data:image/png;base64,')) for reference in references)
    assert '@import' not in text and 'url(' not in text


def test_the_report_contains_every_figure_with_its_text(written):
    text = (written / 'report.html').read_text(encoding='utf-8')
    sections = re.findall(r'<section aria-labelledby="(\w+)">(.*?)</section>', text, re.DOTALL)
    assert [name for name, _ in sections] == list(PAGES)
    for name, section in sections:
        (picture,) = re.findall(r'base64,([^"]+)"', section)
        assert base64.b64decode(picture) == (written / f'{name}.png').read_bytes()
        assert 'class="notes"' in section  # no figure can be matched in all
        assert section.count('<p>') >= 2
        assert 'nan' not in re.sub(r'base64,[^"]+', '', section).split()


def test_a_folder_that_cannot_be_created_is_an_error_in_one_line(tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert main(['reproduce', '--out', str(tmp_path / 'file')]) == 2
    assert 'file' in capsys.readouterr().err
