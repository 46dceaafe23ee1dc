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
Friction maps of drawn robots, and a drive that slows down before ice which an earlier one met.

Run ``python -m benchmarks.friction_map [--drives N] [--first SEED] [--out DIR]``. The robots cross
fields of concrete, sand and gravel, whose friction is that of the simulation's surfaces.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import replace
import math
from pathlib import Path

from benchmarks.control.closed_loop import run_closed_loop
from benchmarks.control.robot_stack import PathStack, StackParams
from benchmarks.events import inputs_of, truth_of
from benchmarks.grounds import ground
from benchmarks.harness import new_table
from benchmarks.robots.draws import draw, GROUNDS, ROWS
from benchmarks.robots.scoring import estimates_of
from benchmarks.scoring import mean, standard_error
import numpy as np
from rich.console import Console
from rich.table import Table
from smart_tire.analysis.drawing import save
from smart_tire.analysis.friction_map import in_map, map_figure
from smart_tire.analysis.pipeline import EstimatorParams, Pipeline
from smart_tire.arrays import Array
from smart_tire.control.ground_knowledge import LowerBound
from smart_tire.mapping.grid import friction_map, FrictionMap
from smart_tire.mapping.track import friction_track, FrictionTrack
from smart_tire.parameters import TrajectoryControllerParams, WheelControllerParams
from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import NAN, PlannedPath, Sample
from smart_tire.simulation.plant import Plant

ROW = 'jumps'
SURFACES_OF_ALL = 'friction', 'stiffness', 'drag'  # not drawn: the place is the same
BORDER_WIDTH = 0.3          # m from a border, within which cells are not scored
BORDER_RANGE = 1.0          # m to both sides, where it is looked for
BORDER_CELLS = 6            # known cells on each side, at least
MAX_DURATION = 60.0   # s, of a drive along the path
ICE_BEGIN = 3.0       # m along x, where the bend begins
BEND = 1.2            # m, radius of the bend on the ice
LATER = 1000         # after the seed of a drive: that of the one with its map
CAMERA_SIGMA = 0.01  # m and rad, of the localization


def drawn_track(seed: int) -> FrictionTrack:
    """
    Return the friction on the tracks of a drawn robot, localized by a camera.

    All robots get the wheel speeds of the first one.
    """
    one = replace(draw(ROW, seed, SURFACES_OF_ALL), legs=draw(ROW, 1).legs,
                  duration=draw(ROW, 1).duration)
    events = one.events()
    return track_of(estimates_of(one, inputs_of(events)), SampleArrays(truth_of(events)),
                    one.params, str(seed))


def track_of(estimates: Sequence[Sample], truth: SampleArrays, params: EstimatorParams, name: str
             ) -> FrictionTrack:
    """Return the friction on the tracks of estimates; each robot has its own errors."""
    seen = truth.poses()
    errors = np.broadcast_to(CAMERA_SIGMA ** 2 * np.eye(3), seen.covariance.shape)
    found = SampleArrays(estimates)
    return friction_track(in_map(found.poses(), replace(seen, covariance=errors)),
                          found.grounds(), found.frictions(), params.robot, frame='map',
                          drive=name, name=name)


def true_friction(x: Array, row: str = ROW) -> tuple[Array, Array]:
    """Return mu at ``x`` [m], and the distance [m] from the next border."""
    surfaces = ROWS[row].surfaces
    mu = np.full(len(x), surfaces[ROWS[row].base][0])
    away = np.full(len(x), math.inf)
    for name, begin, end in ROWS[row].fields:
        mu[(x >= begin) & (x < end)] = surfaces[name][0]
        away = np.minimum(away, np.minimum(np.abs(x - begin), np.abs(x - end)))
    return mu, away


def borders(found: FrictionMap, row: str = ROW) -> Iterator[tuple[float, Array]]:
    """
    Yield each border [m] along x, and where it is in each row of cells of the map that shows it.

    That is where a step between mu of both grounds has the fewest cells on its wrong side.
    """
    raster = found.raster
    x = raster.origin[0] + (np.arange(raster.friction.shape[1]) + 0.5) * raster.resolution
    for edge in sorted({edge for _, *edges in ROWS[row].fields for edge in edges}):
        (low, high), _ = true_friction(np.array([edge - 0.01, edge + 0.01]), row)
        middle, near = 0.5 * (low + high), np.abs(x - edge) < BORDER_RANGE
        places = []
        for values in raster.friction[:, near]:
            known = np.isfinite(values)
            at = x[near][known]
            if min((at < edge).sum(), (at > edge).sum()) >= BORDER_CELLS:
                after = (values[known] - middle) * (high - low) > 0.0
                wrong = np.append(0, np.cumsum(after)) + np.append(
                    np.cumsum(~after[::-1])[::-1], 0)
                steps = np.append(np.append(at[0], 0.5 * (at[1:] + at[:-1])), at[-1])
                places.append(steps[wrong == wrong.min()].mean())
        yield edge, np.array(places)


def bend_on_ice() -> PlannedPath:
    """Return 3 m straight, and a bend of 90 degrees."""
    straight = [(x, 0.0, NAN) for x in np.arange(0.0, 3.0, 0.05).tolist()]
    bend = [(3.0 + BEND * math.sin(a), BEND * (1.0 - math.cos(a)), NAN)
            for a in np.linspace(0.0, 0.5 * math.pi, 40).tolist()]
    return PlannedPath(0, 'odom', (*straight, *bend))


def on_ice(seed: int, bound: LowerBound | None = None) -> tuple[Array, FrictionTrack]:
    """
    Return time, x, y, v_x of a drive along ``bend_on_ice``, and its friction.

    The estimators, the controllers and the plant are those that ship; ``bound`` is of a map.
    """
    simulator = SimulatorParams(seed=seed, ground=ground(
        'concrete', GROUNDS, (('ice', ICE_BEGIN, 100.0),)))
    estimators = EstimatorParams()
    stack = PathStack(StackParams(
        estimators, TrajectoryControllerParams(max_speed=0.8), WheelControllerParams(),
        estimated=True), bend_on_ice())
    stack.trajectory.lower_bound = bound
    rows: list[tuple[float, ...]] = []

    def watch(plant: Plant) -> None:
        rows.append((plant.time_ns * 1e-9, plant.x, plant.y, plant.v_x))

    events = run_closed_loop(simulator, stack, MAX_DURATION, watch=watch)
    pipeline = Pipeline(estimators)
    estimates = [one for sample in inputs_of(events) for one in pipeline.update(sample)]
    truth = SampleArrays(truth_of(events))
    return np.array(rows), track_of([*estimates, *pipeline.finish()], truth, estimators, str(seed))


def bound_of(track: FrictionTrack) -> LowerBound:
    """Return the lower bound of the friction in the map of a drive, as the controller uses it."""
    params = TrajectoryControllerParams()
    return friction_map([track]).raster.widened(
        params.friction_map_margin, params.friction.sigmas).lower_bound


def by_drives(maps: Sequence[FrictionMap], row: str = ROW) -> Table:
    """Return the errors of the cells of all maps, by the number of drives in them."""
    made = new_table('Cells', 'drives', 'cells', 'mu rms [%]', 'sigma [%]', 'NEES')
    x, friction, sigma, drives, current = (np.concatenate([
        getattr(one.cells, name) for one in maps]) for name in (
            'x', 'friction', 'sigma', 'drives', 'current'))
    mu, away = true_friction(x, row)
    error, sigma, off = (friction - mu) / mu, sigma / mu, away > BORDER_WIDTH
    for name, chosen in (*((f'{low} to {high}', off & (drives >= low) & (drives <= high))
                           for low, high in ((1, 1), (2, 3), (4, 6), (7, 99))),
                         (f'all within {BORDER_WIDTH:g} m of a border', ~off)):
        rows = chosen & (current == 1)
        sizes = [float(np.sqrt(np.mean(one[rows] ** 2))) for one in (error, sigma)]
        made.add_row(name, str(rows.sum()), *(f'{1e2 * one:.1f}' for one in sizes),
                     f'{float(np.mean((error / sigma)[rows] ** 2)):.2f}')
    return made


def main() -> None:
    """Print the tables, draw the map."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--drives', type=int, default=10, help='robots of a map')
    parser.add_argument('--maps', type=int, default=3, help='each of other robots')
    parser.add_argument('--first', type=int, default=1, help='seed of the first robot')
    parser.add_argument('--out', type=Path, default=Path('bench_output/friction_map'))
    parser.add_argument('--bends', type=int, default=8, help='number of pairs of drives on ice')
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    seeds = range(args.first, args.first + args.maps * args.drives)
    tracks = [drawn_track(seed) for seed in seeds]
    groups = [tracks[begin:begin + args.drives] for begin in range(0, len(tracks), args.drives)]
    maps = [friction_map(group) for group in groups]
    console = Console(width=110)
    console.print(by_drives(maps))
    for same in zip(*map(borders, maps)):
        (edge, _), places = same[0], np.concatenate([one for _, one in same])
        console.print(f'border at {edge:g} m: {np.median(places):.2f} m in the maps, 90 % of '
                      f'{len(places)} rows within {np.quantile(np.abs(places - edge), 0.9):.2f} m')
    save(map_figure(maps[0], groups[0]), args.out / 'drives.png')
    made = new_table('Bends on ice', 'drives', 'speed before the ice [m/s]',
                     'speed in the bend [m/s]', 'off the path [m]')
    scores = [on_ice_twice(seed) for seed in range(args.first, args.first + args.bends)]
    for name, rows in zip(('without a map', 'with the map of the first'), zip(*scores)):
        made.add_row(name, *(f'{mean(one):.2f} ± {standard_error(one):.2f}'
                             for one in zip(*rows)))
    console.print(made)


def ice_scores(rows: Array) -> tuple[float, float, float]:
    """Return speeds [m/s] before the ice and in the bend, and the largest error [m] there."""
    _, x, y, speed = rows.T
    moving = speed > 0.05
    before = float(speed[np.argmax(x >= ICE_BEGIN - 0.1)])
    bend = moving & (x > 3.0)
    off = np.abs(np.hypot(x[bend] - 3.0, y[bend] - BEND) - BEND)
    return before, float(speed[bend].max()), float(off.max())


def on_ice_twice(seed: int) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Return the scores of a drive without a map, and of a later one with its map."""
    first, track = on_ice(seed)
    later, _ = on_ice(seed + LATER, bound_of(track))
    return ice_scores(first), ice_scores(later)


if __name__ == '__main__':
    main()
