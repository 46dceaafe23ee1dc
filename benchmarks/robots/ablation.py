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
What each constant of the estimators contributes: figures of drawn robots with other values of it.

Constants are the numbers of ``smart_tire.estimation`` under a name in capitals, in all modules
that are not compiled. A value is multiplied before anything is derived from it, in a process of
its own; counts stay whole, of an estimate it is the sigma, of a grid the number of points.
Constants of the slip filter vary with the ``ground_state`` of the estimators as they are.

Run ``python -m benchmarks.robots.ablation [CONSTANT ...]``, e.g. ``slip.`` for those of a part.
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterator, Sequence
from importlib import import_module
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from itertools import chain
import math
from multiprocessing import get_context
from pathlib import Path
import sys
import time
from types import CodeType, ModuleType
from typing import Any, NamedTuple

from benchmarks.scoring import Run
import numpy as np
from smart_tire import samples
from smart_tire.uncertain import Uncertain

ROOM = 'smart_tire.estimation'
FOLDER = Path(samples.__file__).parent / 'estimation'
ROWS = 'sand_straight', 'jumps', 'pushes'
SEED, PROCESSES = 1, 2
FACTORS = 1.0 / 3.0, 3.0
FIGURES = {'mu': ('median', 'nees'), 'slip': ('rms', 'nees'), 'u': ('rms', 'nees'),
           'v_y': ('rms', 'nees')}
GRID = 4  # points; a shorter array is no grid
INDICES = 'range', 'slice', 'outer', 'SIDE_SIGNS'  # make indices and signs
SLIP = 'slip.'  # constants of the slip filter


class Drive(NamedTuple):
    """A drawn robot, without the modules that vary."""

    name: tuple[str, int]  # row and seed
    inputs: list[samples.Sample]
    given: list[samples.Sample]  # inputs of the slip filter, with ground_state, and friction
    truth: list[samples.Sample]


DRIVES: list[Drive] = []  # of the processes that measure


def constants() -> Iterator[str]:
    """Yield the constants, as ``slip.state.PUSH_SIGMAS``."""
    for path in sorted(FOLDER.rglob('*.py')):
        if not any(path.parent.glob(f'{path.stem}.*.so')):
            module = '.'.join(path.relative_to(FOLDER).with_suffix('').parts)
            yield from (f'{module}.{name}' for node in ast.parse(path.read_text('utf-8')).body
                        for name in _assigned(node))


def _assigned(node: ast.stmt) -> Iterator[str]:
    """Yield the constants that a statement assigns: numbers that are no indices."""
    if not isinstance(node, ast.Assign):
        return
    values = list(ast.walk(node.value))
    numbers = any(isinstance(one, ast.Constant) and type(one.value) in (int, float)
                  for one in values)
    if numbers and not any(getattr(one, 'id', getattr(one, 'attr', '')) in INDICES
                           for one in values):
        for target in node.targets:
            yield from (one.id for one in (
                target.elts if isinstance(target, ast.Tuple) else [target])
                if isinstance(one, ast.Name) and one.id.isupper())


def varied(value: Any, factor: float) -> Any:
    """Return ``value`` times ``factor``: each part of a tuple, a sigma, the points of a grid."""
    if isinstance(value, Uncertain):
        return value._replace(sigma=factor * value.sigma)
    if isinstance(value, np.ndarray):
        if len(value) < GRID:
            return factor * value
        points = np.linspace(value[0], value[-1], max(round(factor * len(value)), 2))
        return np.unique(points.round().astype(int)) if value.dtype.kind == 'i' else points
    if isinstance(value, tuple):
        return tuple(varied(one, factor) for one in value)
    return max(round(factor * value), 1) if isinstance(value, int) else factor * value


class Variation(MetaPathFinder):
    """Imports the module of a constant with another value of it."""

    def __init__(self, constant: str, factor: float) -> None:
        module, self._constant = f'{ROOM}.{constant}'.rsplit('.', 1)
        self._module, self._factor = module, factor

    def find_spec(self, name: str, path: Sequence[str] | None = None,
                  target: ModuleType | None = None) -> ModuleSpec | None:
        """Return how ``name`` is imported, if it is the module of the constant."""
        spec = PathFinder.find_spec(name, path) if name == self._module else None
        if spec is not None:
            assert spec.origin is not None
            spec.loader = _Loader(name, spec.origin, self._constant, self._factor)
        return spec


class _Loader(SourceFileLoader):

    def __init__(self, name: str, path: str, constant: str, factor: float) -> None:
        super().__init__(name, path)
        self._constant, self._factor = constant, factor

    def get_code(self, fullname: str) -> CodeType:
        """Return the code of the module, with a change after the constant."""
        body = ast.parse(self.get_data(self.path)).body
        at = 1 + next(i for i, node in enumerate(body) if self._constant in _assigned(node))
        body[at:at] = ast.parse(
            f'from {__spec__.name} import varied\n'
            f'{self._constant} = varied({self._constant}, {self._factor!r})').body
        return compile(ast.Module(body, []), self.path, 'exec')


def drives(names: Sequence[tuple[str, int]]) -> list[Drive]:
    """Return the drives of the robots with these rows and seeds."""
    return [_drive(*name) for name in names]


def _drive(row: str, seed: int) -> Drive:
    one = import_module('benchmarks.robots.draws').draw(row, seed)
    pipeline = import_module('smart_tire.analysis.pipeline')
    inputs, friction = one.inputs(), pipeline.FrictionEstimator(one.params.friction)
    given = [item for sample in inputs for item in pipeline.forwarded(friction, sample)]
    return Drive((row, seed), inputs, [*given, *friction.finish()], one.truth())


def measure(variation: tuple[str, float]) -> list[float]:
    """
    Return ``FIGURES`` with a constant times a factor, means over ``DRIVES``, and CPU time [s].

    NaN if the estimators fail with it.
    """
    if variation[1] != 1.0:
        sys.meta_path.insert(0, Variation(*variation))
    try:
        return _measured(variation[0])
    except (ArithmeticError, LookupError, ValueError):
        return [math.nan] * (sum(map(len, FIGURES.values())) + 1)


def _measured(constant: str) -> list[float]:
    draws, scoring, pipeline = (import_module(name) for name in (
        'benchmarks.robots.draws', 'benchmarks.robots.scoring', 'smart_tire.analysis.pipeline'))
    found = []
    for drive in DRIVES:
        one, items = draws.draw(*drive.name), drive.given
        slip, begin = pipeline.SlipEstimator(one.params.slip), time.thread_time()
        if not constant.startswith(SLIP):
            friction = pipeline.FrictionEstimator(one.params.friction)
            items = [item for sample in drive.inputs
                     for item in pipeline.forwarded(friction, sample)] + friction.finish()
        estimates = [estimate for item in items for estimate in pipeline.estimates_of(slip, item)]
        spent = time.thread_time() - begin
        scores = Run(*drive.name, scoring.score_robot(estimates, drive.truth, one.true)).figures
        found.append([scores[name][one] for name, own in FIGURES.items() for one in own]
                     + [spent])
    return np.nanmean(found, axis=0).tolist()


def main() -> None:
    """Print how the figures change with each constant, relative; NEES as it is."""
    parser = argparse.ArgumentParser(prog='python -m benchmarks.robots.ablation',
                                     description=__doc__.splitlines()[1])
    parser.add_argument('constants', nargs='*', default=[''], metavar='CONSTANT',
                        help='beginning of the names (default: all)')
    parser.add_argument('--rows', nargs='+', default=ROWS, metavar='ROW')
    parser.add_argument('--seed', type=int, default=SEED)
    parser.add_argument('--factors', nargs='+', type=float, default=FACTORS, metavar='FACTOR')
    parser.add_argument('--processes', type=int, default=PROCESSES, metavar='N')
    args = parser.parse_args()
    fork = get_context('fork')  # with the drives, and without modules that vary
    with fork.Pool(1) as one:
        DRIVES[:] = one.apply(drives, ([(row, args.seed) for row in args.rows],))
    chosen = [name for name in constants() if name.startswith(tuple(args.constants))]
    variations = [(SLIP, 1.0), ('', 1.0), *(
        (name, factor) for name in chosen for factor in args.factors)]
    names = [f'{name} {one}' for name, own in FIGURES.items() for one in own]
    print(f'| constant | times | {" | ".join(names)} | CPU |\n{"| --- " * (len(names) + 3)}|')
    with fork.Pool(args.processes, maxtasksperchild=1) as pool:
        results = pool.imap(measure, variations)
        slip, whole = next(results), next(results)
        for (name, factor), found in zip([('', 1.0), *variations[2:]], chain([whole], results)):
            reference = slip if name.startswith(SLIP) else whole
            cells = [f'{new:.2f}' if what.endswith('nees') else f'{new / old - 1.0:+.1%}'
                     for what, new, old in zip([*names, ''], found, reference)]
            print(f'| {name} | {factor:.3g} | {" | ".join(cells)} |', flush=True)


if __name__ == '__main__':
    main()
