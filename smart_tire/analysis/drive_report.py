# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Evaluation of recorded runs of the stack: a drive, and the demo with its known disturbances."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import csv
from dataclasses import asdict, dataclass
import math
from pathlib import Path

import numpy as np

from smart_tire.analysis.dead_reckoning import baselines
from smart_tire.analysis.drawing import save
from smart_tire.analysis.driven_paths import (
    driven_lines, driven_tree, DrivenPath, Grounds, load_grounds, PATH_TOPICS, PathLog)
from smart_tire.analysis.figures import write_figures
from smart_tire.analysis.metrics import Intervals, score as score_of, stamp_score
from smart_tire.analysis.motion_figures import path_figure, tracking_figure
from smart_tire.analysis.pipeline import (
    bag_params, ESTIMATES, EstimatorParams, INPUTS, OVERHEAD, TRUTHS)
from smart_tire.analysis.result import Result
from smart_tire.analysis.summary import errors_in, evaluation, plain, Tree
from smart_tire.analysis.tables import error_tables, estimate_tables
from smart_tire.arrays import Instants
from smart_tire.bags import Bag
from smart_tire.estimates import at
from smart_tire.host_load import HostLoad, pace_lines, worst_of
from smart_tire.recording import SampleArrays
from smart_tire.rotation import wrapped

CLEAR_SIGMA = 0.02  # of slip by the overhead camera; starts and stops have larger ones
REFERENCE_STAMP_SIGMA = 0.5e-3  # s, standard deviation for normalized timestamp errors


@dataclass(frozen=True)
class Run:
    """A recorded run: inputs, estimates, truth, paths, and how busy the host was."""

    path: Path
    result: Result
    log: PathLog
    span_ns: tuple[int, int]
    counts: dict[str, int]  # topic -> number of messages
    host: HostLoad | None  # the greatest lateness of timers in the diagnostics of the nodes
    simulated: list[str]   # what the simulator says of the host

    @property
    def drives(self) -> list[DrivenPath]:
        """Return the paths that were followed."""
        return self.log.driven(self.result.estimates.poses(), self.result.truth.poses())

    @property
    def tree(self) -> Tree:
        """Return the part of the summary that is common to all runs."""
        begin, end = self.span_ns
        return {'bag': str(self.path), 'duration_s': (end - begin) * 1e-9,
                'host': None if self.host is None else {'late': self.host.late,
                                                        **asdict(self.host)},
                'simulated': self.simulated,
                **evaluation(self.result.filtered, self.result.intervals)}


def read_run(path: Path, intervals: Intervals | None = None) -> Run:
    """Return the run in the bag at ``path``; raise BagError."""
    log, groups = PathLog(), (INPUTS, ESTIMATES, TRUTHS, OVERHEAD)
    inputs, estimates, truth, camera = parts = [SampleArrays() for _ in groups]
    part_of = {topic: part for topics, part in zip(groups, parts) for topic in topics}
    with Bag(path) as bag:
        for receive_ns, topic, sample in bag.samples((*part_of, *PATH_TOPICS)):
            log.add_message(receive_ns, sample)
            if topic in part_of:
                part_of[topic].add_sample(sample)
        counts = {name.lstrip('/'): topic.messages for name, topic in bag.topics.items()}
        result = Result(estimates, inputs, truth, camera,
                        dead_reckoning=baselines(inputs, bag_params(bag).params.robot),
                        wanted=log.wanted(), intervals=intervals or {})
        statuses = [status.values for _, status in bag.statuses()]
        return Run(path, result, log, bag.span_ns, counts, worst_of(statuses),
                   list(pace_lines(statuses)))


def evaluate_drive(bag_path: Path, name: str, figure: Path,
                   grounds: Grounds | None = None) -> Tree:
    """
    Return the summary of a drive and draw its ``figure``.

    The figure shows the last path that was followed, or the driven path alone if there is none;
    it is not drawn without poses. ``grounds`` are those of the simulation.
    """
    run = read_run(bag_path)
    drives = run.drives
    drawn = tracking_figure(drives[-1], grounds) if drives else path_figure(run.result)
    if drawn is not None:
        save(drawn, figure)
    return plain({**run.tree, 'drive': name,
                  'tracking': driven_tree(drives[-1]) if drives else None})


def drive_lines(tree: Tree) -> Iterator[str]:
    """Yield the summary of ``evaluate_drive`` as lines of text."""
    yield from host_lines(tree)
    if tree['tracking'] is not None:
        yield from driven_lines(tree['drive'], tree['tracking'])
    for table in estimate_tables(tree['estimates']):
        yield from table.lines()
    if pose := errors_in(tree)[1].get('pose'):
        yield (f'odom error at the end: {pose["position_end_m"]:.2f} m, '
               f'{pose["yaw_end_rad"]:+.3f} rad')


def evaluate_demo(bag_path: Path, params: Path, intervals: Intervals, expected: Sequence[str],
                  conversions: Path, figures: Path, paths: Sequence[str] = ()) -> Tree:
    """
    Return the summary of a recorded run of the full stack and draw its figures.

    ``intervals`` are also evaluated separately, ``expected`` are the topics that must have
    messages, ``conversions`` is the simulator's log of the true conversion times, ``paths`` are
    names for the paths that were followed, the last of which is drawn.
    """
    run, batches = read_run(bag_path, intervals), read_conversions(conversions)
    write_figures(figures, run.result, EstimatorParams.load([params]).robot)
    drives = dict(zip(paths, run.drives))
    if drives:
        save(tracking_figure(list(drives.values())[-1], load_grounds([params])),
             figures / 'tracking.png')
    return plain({
        **run.tree, 'camera': camera_errors(run.result), 'messages': run.counts,
        'silent': [name for name in expected if not run.counts.get(name.lstrip('/'))],
        'radio': radio_counts(run.result.inputs, batches),
        'stamps': stamp_errors(run.result.inputs, batches),
        'tracking': {name: driven_tree(drive) for name, drive in drives.items()}})


def camera_errors(result: Result) -> Tree | None:
    """
    Return the errors of the overhead camera, at its timestamps; None without its poses.

    Those of the slip count where its standard deviation is at most ``CLEAR_SIGMA``.
    """
    poses, true = result.camera.poses(), result.truth.poses()
    slips, true_slips = result.camera.slips(), result.truth.slips()
    if not len(poses.stamp_ns):
        return None
    error = poses.pose - at(poses.stamp_ns, true.stamp_ns, true.pose)
    error[:, 2] = wrapped(error[:, 2])
    sigma = np.sqrt(np.diagonal(poses.covariance, axis1=1, axis2=2))
    slip = slips.ratio - at(slips.stamp_ns, true_slips.stamp_ns, true_slips.ratio)
    sharp = slips.sigma <= CLEAR_SIGMA
    return {'position': asdict(score_of(error[:, :2].ravel(), sigma[:, :2].ravel())),
            'yaw': asdict(score_of(error[:, 2], sigma[:, 2])),
            'slip': asdict(score_of(slip[sharp], slips.sigma[sharp]))}


def host_lines(tree: Tree) -> Iterator[str]:
    """Yield lines if other programs took the cores, of a simulated robot or of a real one."""
    if tree['simulated']:
        yield from tree['simulated']
    elif (host := tree['host']) is not None and host['late']:
        yield 'host late: {}'.format(HostLoad(**{
            name: value for name, value in host.items() if name != 'late'}))


@dataclass(frozen=True)
class Batch:
    """One batch of A/D conversions from the log of the simulator."""

    wheel: str
    dropped: bool      # by the simulated radio
    stamp_ns: Instants   # true times of the conversions


def read_conversions(path: Path) -> list[Batch]:
    """Return the batches in the log of the simulator; the last line may be truncated."""
    with path.open(newline='', encoding='utf-8') as file:
        return [Batch(row['wheel'], row['dropped'] != '0',
                      np.array(row['stamps_ns'].split(), np.int64))
                for row in csv.DictReader(file) if row['stamps_ns']]


def stamp_errors(inputs: SampleArrays, batches: Sequence[Batch]) -> Tree:
    """Return wheel -> error of its sample timestamps."""
    return {wheel: stamp_score(inputs.films(wheel)[0], np.sort(np.concatenate(
                [batch.stamp_ns for batch in batches if batch.wheel == wheel])),
                REFERENCE_STAMP_SIGMA)
            for wheel in inputs.film_wheels()}


def radio_counts(inputs: SampleArrays, batches: Sequence[Batch]) -> Tree:
    """
    Return the number of batches sent, dropped by the radio, and missing for other reasons.

    Counts only batches between the first and the last received one.
    """
    counts = {'sent': 0, 'dropped': 0, 'missing': 0}
    for wheel in inputs.film_wheels():
        received = inputs.films(wheel)[0]
        for batch in batches:
            middle = batch.stamp_ns[len(batch.stamp_ns) // 2]
            if batch.wheel != wheel or not received[0] <= middle <= received[-1]:
                continue
            right = np.searchsorted(received, middle)
            nearest = np.min(np.abs(received[max(right - 1, 0):right + 1] - middle))
            counts['sent'] += 1
            counts['dropped'] += batch.dropped
            counts['missing'] += bool(nearest > batch.stamp_ns[1] - batch.stamp_ns[0]
                                      and not batch.dropped)
    return counts


def demo_lines(tree: Tree) -> Iterator[str]:
    """Yield the summary of ``evaluate_demo`` as lines of text."""
    yield f'recorded {tree["duration_s"]:.0f} s, {sum(tree["messages"].values())} messages'
    yield from host_lines(tree)
    yield ('radio batches: {sent} sent, {dropped} dropped by the simulated radio, {missing} lost '
           'after it'.format(**tree['radio']))
    for wheel, score in tree['stamps'].items():
        yield (f'timestamp error of {wheel} samples: {1e3 * score["rms"]:.2f} ms rms, '
               f'mean {1e3 * score["mean"]:+.2f} ms')
    for name, score in tree['tracking'].items():
        yield from driven_lines(name, score)
    camera = tree.get('camera') or {}
    for name, unit, factor in (('position', 'm rms per axis', 1.0),
                               ('yaw', 'deg rms', math.degrees(1.0)),
                               ('slip', f'rms where its sigma is below {CLEAR_SIGMA:g}', 1.0)):
        if camera.get(name, {}).get('count'):
            yield (f'{name} error of the overhead camera: {factor * camera[name]["rms"]:.4f} '
                   f'{unit}, {camera[name]["normalized_rms"]:.2f} of its standard deviation')
    for table in error_tables(tree):
        yield from table.lines()
