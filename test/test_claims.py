# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Figures of the README are those of the tables in the docs, and each claim is held."""

from __future__ import annotations

from pathlib import Path
import re

from benchmarks import calibration, capacity, load, offline, start
import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / 'docs' / 'benchmarks.md').read_text(encoding='utf-8')
README = ' '.join((ROOT / 'README.md').read_text(encoding='utf-8').split())


def rows(head, page=PAGE):
    """Return the cells of the first table in ``page`` whose head begins with ``head``."""
    lines = iter(page.splitlines())
    assert next((line for line in lines if line.startswith(f'| {head}')), ''), head
    next(lines)
    found = []
    for line in lines:
        if not line.startswith('|'):
            return found
        found.append([cell.strip() for cell in line.strip('|').split('|')])
    return found


def number(cell):
    """Return the first number in a cell."""
    return float(re.search(r'-?\d+(\.\d+)?', cell)[0])


def test_friction_and_slip_of_drawn_robots_are_those_of_the_table():
    table = rows('row | mu median / 90 % [%]')
    medians, shares = ([number(row[column]) for row in table] for column in (1, 4))
    slips = {row[0]: number(row[6]) for row in table}
    ice = slips.pop('ice')
    assert (f'median error: {min(medians):.0f} to {max(medians):.0f} % in all {len(table)} rows; '
            f'{min(shares):.0f} to {max(shares):.0f} % of the values within two standard '
            'deviations') in README
    assert f'steady: {min(slips.values()):.3f} to {max(slips.values()):.3f} RMS; ice {ice:.2f}.' \
        in README


def test_path_tracking_is_the_ratio_of_the_table():
    ratios = [number(row[1]) / number(row[2]) for row in rows('path | ours, most')]
    assert f'{100.0 * min(ratios):.0f} to {100.0 * max(ratios):.0f} % of the error of ideal ' \
        'kinematics' in README


def test_recordings_of_other_robots_are_those_of_the_table():
    table = rows('recording | distance')
    distances, errors, ratios = ([number(row[column]) for row in table] for column in (1, 2, 3))
    assert (f'{min(distances):.0f} to {max(distances):.0f} m: {min(errors):.2f} to '
            f'{max(errors):.2f} m RMS ({min(ratios):.2f} to {max(ratios):.2f} of gyroscope and '
            'wheels)') in README


def test_the_position_of_the_demo_is_that_of_the_table():
    ours, gyro = ([number(part) for part in row[1].split(' to ')]
                  for row in rows('method | position error, RMS')[:2])
    assert (f'{ours[0]:.2f} to {ours[1]:.2f} m RMS (gyroscope and wheels: {gyro[0]:.2f} to '
            f'{gyro[1]:.2f} m)') in README


def test_the_ranges_are_those_that_make_bench_checks():
    modules = calibration, capacity, load, offline, start
    recipe = re.search(r'^bench:.*?\n\n', (ROOT / 'Makefile').read_text(encoding='utf-8'),
                       re.MULTILINE | re.DOTALL)[0]
    assert sorted(re.findall(r'run ([a-z]+)', recipe)) == sorted(
        module.__name__.removeprefix('benchmarks.') for module in modules)
    assert sorted(rows('figure | range')) == sorted(
        [one.figure, one.text] for module in modules for one in module.RANGES)


def holders():
    """Return what holds each claim: the last cells of the table."""
    return [row[-1] for row in rows('claim | held by')]


@pytest.mark.parametrize('holder', holders())
def test_a_claim_is_held_by_a_test_or_a_command_that_exists(holder):
    found = re.findall(r'`([^`]+)`', holder)
    assert found
    for one in found:
        file, _, name = one.partition('::')
        if file.startswith('test/'):
            assert f'def {name}' in (ROOT / file).read_text(encoding='utf-8') if name else (
                ROOT / file).exists()
        elif file.startswith('benchmarks.'):
            path = ROOT / file.replace('.', '/')
            assert path.with_suffix('.py').exists() or (path / '__main__.py').exists()
        else:
            target = file.removeprefix('make ').split()[0]
            assert re.search(rf'^{target}:', (ROOT / 'Makefile').read_text(encoding='utf-8'),
                             re.MULTILINE), one
