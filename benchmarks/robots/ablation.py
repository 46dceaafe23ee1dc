# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
What each part of the window contributes: errors of friction without it, on drawn robots.

Run ``python -m benchmarks.robots.ablation [ROW ...]``; seeds are those of tests.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
import math
from multiprocessing import Pool
import sys
from typing import Any

from benchmarks.robots.draws import draw
from benchmarks.robots.scoring import MU, run_robot
import numpy as np
from smart_tire.estimation.ground import measurements, unknowns, window

ROWS, SEEDS = ('concrete', 'sand_turn', 'gravel', 'center_of_mass', 'jumps', 'split'), (1, 2)
NEGLIGIBLE = 1e-4  # standard deviation of an unknown that is fixed
# part -> module, name and value of a constant
CONSTANTS: dict[str, tuple[Any, str, Any]] = {
    'outlier weights': (window, 'FREEDOM', 1e6),
    'lasting model errors': (measurements, 'MODEL_ERROR', 0.005),
    'timing errors': (measurements, 'TIMING_ERROR', 0.0),
    'errors of film slips': (measurements, 'FILM_SLIP_ERROR', (0.0, 0.0)),
    'errors of normalized slips': (measurements, 'FILM_RATIO_ERROR', 0.0),
    'transients of torques': (measurements, 'TRANSIENT_SHARE', 0.0),
    'different sides': (window, 'SIDES_DIFFER', math.inf),
    'changes of ground': (window, 'TRIED_EVIDENCE', math.inf),
    'disturbances': (window, 'DISTURBANCE_TIME', -1.0)}
UNKNOWNS = (unknowns.Unknown.LATERAL_SHARE, unknowns.Unknown.LATERAL_RATIO,
            unknowns.Unknown.RADIUS, unknowns.Unknown.SLOPE_X, unknowns.Unknown.BEND_X,
            unknowns.Unknown.FALL, unknowns.Unknown.DELAY, unknowns.Unknown.COM_X,
            unknowns.Unknown.TORQUE_SCALE, unknowns.Unknown.FILM_GAIN)
PAIRS = {unknowns.Unknown.SLOPE_X: 2, unknowns.Unknown.BEND_X: 2, unknowns.Unknown.COM_X: 2,
         unknowns.Unknown.FILM_GAIN: 4}


@contextmanager
def without(part: str) -> Iterator[None]:
    """Leave out a part: a constant of ``CONSTANTS``, or an unknown by its name."""
    if part in CONSTANTS:
        module, name, value = CONSTANTS[part]
    elif part:
        first = unknowns.Unknown[part.upper()]
        rows = range(first, first + PAIRS.get(first, 1))
        known = unknowns.priors

        def fixed(robot: Any) -> list[unknowns.Row]:
            return [row._replace(sigma=NEGLIGIBLE, walk=0.0, ground=0.0) if i in rows else row
                    for i, row in enumerate(known(robot))]
        module, name, value = window, 'priors', fixed
    else:
        yield
        return
    before = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, before)


def score(part: str, job: tuple[str, int]) -> tuple[float, float, float]:
    """Return median, 90 % and NEES of friction of one robot without a part."""
    with without(part):
        figures = run_robot(draw(*job)).figures[MU]
    return figures['median'], figures['q90'], figures['nees']


def main(rows: tuple[str, ...]) -> None:
    """Print the table: means over the robots."""
    parts = ['', *CONSTANTS, *(one.name.lower() for one in UNKNOWNS)]
    jobs = [(row, seed) for row in rows for seed in SEEDS]
    print('| without | mu, median | 90 % | NEES |\n| --- | --- | --- | --- |')
    with Pool() as pool:
        for part in parts:
            median, worst, nees = np.mean(pool.map(partial(score, part), jobs), axis=0)
            print(f'| {part or "(whole)"} | {100.0 * median:.1f} % | {100.0 * worst:.1f} % | '
                  f'{nees:.2f} |', flush=True)


if __name__ == '__main__':
    main(tuple(sys.argv[1:]) or ROWS)
