# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The examples run, and give the results that their texts promise."""

from __future__ import annotations

import json
from pathlib import Path
import re
import runpy
from typing import Any

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest

FOLDER = Path(__file__).resolve().parents[2] / 'examples'
NOTEBOOKS = sorted(path.stem for path in FOLDER.glob('*.ipynb'))
MAX_SIZE = 100_000  # bytes


def cells(name: str) -> list[dict[str, Any]]:
    """Return the cells of a notebook."""
    return json.loads((FOLDER / f'{name}.ipynb').read_text(encoding='utf-8'))['cells']


def executed(name: str) -> dict[str, Any]:
    """Execute the code of a notebook; return its names and the number of its figures."""
    matplotlib.use('Agg')
    names: dict[str, Any] = {'__name__': name}
    for cell in cells(name):
        if cell['cell_type'] == 'code':
            exec(compile(''.join(cell['source']), f'{name} {cell["id"]}', 'exec'), names)
    names['figures'] = len(plt.get_fignums())
    plt.close('all')
    return names


@pytest.mark.parametrize('name', NOTEBOOKS)
def test_a_notebook_is_stored_without_results(name):
    assert (FOLDER / f'{name}.ipynb').stat().st_size < MAX_SIZE
    code = [cell for cell in cells(name) if cell['cell_type'] == 'code']
    assert code and all(cell['outputs'] == [] and cell['execution_count'] is None
                        for cell in code)
    assert max(len(line.rstrip()) for cell in code for line in cell['source']) <= 99
    assert re.match('# ', cells(name)[0]['source'][0])


def test_there_are_three_notebooks():
    assert NOTEBOOKS == ['bag_to_friction', 'film_charge_and_hysteresis',
                         'one_contact_to_friction']


def test_the_film_measures_within_its_standard_deviation():
    names = executed('film_charge_and_hysteresis')
    assert names['figures'] == 3
    assert names['rms'] < 2.0 * np.median(names['measured'].sigma) < 20e-6
    assert names['loop_width'] > 0.03e-9


def test_one_crossing_gives_the_friction_coefficient(capsys):
    names = executed('one_contact_to_friction')
    assert names['figures'] == 2 and names['true_friction'] == pytest.approx(0.47)
    assert names['friction'] == pytest.approx(0.47, rel=0.2)
    assert names['inside'].sum() > 25
    assert '0.47 true' in capsys.readouterr().out


@pytest.mark.long
def test_the_bag_gives_friction_on_concrete_and_sand():
    names = executed('bag_to_friction')
    friction = names['estimates'].friction.friction_coefficient
    assert names['figures'] == 1 and len(friction.value) >= 15
    assert np.nanmean(friction.value[5:8]) == pytest.approx(0.47, rel=0.15)
    assert np.nanmean(friction.value[-4:]) == pytest.approx(0.35, rel=0.2)


def test_an_estimator_of_your_own_is_good_on_concrete_and_not_on_sand(capsys):
    errors = runpy.run_path(str(FOLDER / 'custom_estimator.py'))['main']()
    assert errors['concrete']['own'] < 0.05
    assert errors['sand']['own'] > 2.0 * errors['sand']['package']
    assert len(capsys.readouterr().out.splitlines()) == 3
