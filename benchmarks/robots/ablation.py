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
What each part of window and slip filter contributes: errors on drawn robots without it.

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
from benchmarks.robots.scoring import LATERAL, MU, run_robot, SPEED
import numpy as np
from smart_tire.estimation.ground import unknowns, window

ROWS = 'concrete', 'sand_turn', 'jumps', 'border', 'split', 'pushes', 'lifted', 'straight'
SEEDS = 1, 2
NEGLIGIBLE = 1e-4  # standard deviation of an unknown that is fixed
# part -> name of a constant of the window (unknowns) or the filter (state), and its value without
CONSTANTS: dict[str, tuple[str, Any]] = {
    'outlier weights': ('FREEDOM', 1e6),
    'lasting model errors': ('MODEL_ERROR', 0.005),
    'timing errors': ('TIMING_ERROR', 0.0),
    'relaxation length': ('RELAXATION_ERROR', 0.0),
    'errors of film slips': ('FILM_SLIP_ERROR', (0.0, 0.0)),
    'errors of normalized slips': ('FILM_NORMALIZED_ERROR', 0.0),
    'lasting errors of films': ('FILM_SHAPE_ERROR', 1e-6),
    'noise of derivatives': ('NOISE_SIGMAS', 0.0),
    'transients of torques': ('TRANSIENT_SHARE', 0.0),
    'errors of the tire curve': ('CURVE_ERROR', 0.0),
    'different sides': ('SIDES_DIFFER', math.inf),
    'tension': ('TENSION', math.inf),
    'events': ('TRIED_EVIDENCE', math.inf),
    'disturbances': ('DISTURBANCE_TIME', -1.0),
    'filter: changes of ground': ('EVIDENCE', math.inf),
    'filter: pushes': ('PUSH_SIGMAS', math.inf),
    'filter: errors of torques': ('FORCE_ERROR', 0.0),
    'filter: errors of the balance': ('BALANCE_SIGMA', 0.003)}
UNKNOWNS = (unknowns.Unknown.LATERAL_SHARE, unknowns.Unknown.LATERAL_RATIO,
            unknowns.Unknown.RADIUS, unknowns.Unknown.SLOPE_X, unknowns.Unknown.BEND_X,
            unknowns.Unknown.FALL, unknowns.Unknown.DELAY, unknowns.Unknown.COM_X,
            unknowns.Unknown.TORQUE_SCALE, unknowns.Unknown.MOTOR_FRICTION,
            unknowns.Unknown.MOTOR_INERTIA, unknowns.Unknown.FILM_GAIN)
PAIRS = {unknowns.Unknown.SLOPE_X: 2, unknowns.Unknown.BEND_X: 2, unknowns.Unknown.COM_X: 2,
         unknowns.Unknown.FILM_GAIN: 4}


@contextmanager
def without(part: str) -> Iterator[None]:
    """Leave out a part: a constant of ``CONSTANTS``, or an unknown by its name."""
    if part in CONSTANTS:
        name, value = CONSTANTS[part]
        modules = [module for path, module in sys.modules.items()
                   if path.startswith('smart_tire.estimation') and hasattr(module, name)]
        if not modules:
            raise KeyError(f'{part}: no module of smart_tire.estimation has {name}')
    elif part:
        first = unknowns.Unknown[part.upper()]
        rows = range(first, first + PAIRS.get(first, 1))
        known = unknowns.priors

        def fixed(robot: Any) -> list[unknowns.Row]:
            return [row._replace(sigma=NEGLIGIBLE, walk=0.0, ground=0.0) if i in rows else row
                    for i, row in enumerate(known(robot))]
        modules, name, value = [window], 'priors', fixed
    else:
        yield
        return
    before = [(module, getattr(module, name)) for module in modules]
    for module in modules:
        setattr(module, name, value)
    try:
        yield
    finally:
        for module, old in before:
            setattr(module, name, old)


def score(part: str, job: tuple[str, int]) -> tuple[float, ...]:
    """Return median and NEES of friction, RMS [m/s] and NEES of both speeds, without a part."""
    with without(part):
        figures = run_robot(draw(*job)).figures
    return (figures[MU]['median'], figures[MU]['nees'],
            *(figures[name][one] for name in (SPEED, LATERAL) for one in ('rms', 'nees')))


def main(rows: tuple[str, ...]) -> None:
    """Print the table: means over the robots."""
    parts = ['', *CONSTANTS, *(one.name.lower() for one in UNKNOWNS)]
    jobs = [(row, seed) for row in rows for seed in SEEDS]
    print('| without | mu, median | NEES | u [mm/s] | NEES | v_y [mm/s] | NEES |\n'
          '| --- | --- | --- | --- | --- | --- | --- |')
    with Pool() as pool:
        for part in parts:
            mu, own, u, of_u, v, of_v = np.nanmean(
                pool.map(partial(score, part), jobs), axis=0)
            print(f'| {part or "(whole)"} | {100.0 * mu:.1f} % | {own:.2f} | {1e3 * u:.1f} | '
                  f'{of_u:.2f} | {1e3 * v:.1f} | {of_v:.2f} |', flush=True)


if __name__ == '__main__':
    main(tuple(sys.argv[1:]) or ROWS)
