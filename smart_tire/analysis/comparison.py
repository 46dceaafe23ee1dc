# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Runs next to each other: analyses read again, their errors in one table, files of both."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import csv
from dataclasses import asdict, replace
import io
from pathlib import Path

from smart_tire.analysis.dead_reckoning import baselines
from smart_tire.analysis.drawing import save
from smart_tire.analysis.friction_metrics import friction_score
from smart_tire.analysis.metrics import ComparedPoses, pose_score, score
from smart_tire.analysis.motion_figures import comparison_figure
from smart_tire.analysis.pipeline import bag_params, ESTIMATES, OVERHEAD, TRUTHS
from smart_tire.analysis.result import Comparison, Result
from smart_tire.analysis.summary import estimates_tree, plain, Tree
from smart_tire.analysis.tables import cells, Columns, Table, value_of
from smart_tire.bags import Bag, STANDARD_NAMES, TopicNames
from smart_tire.errors import BagError
from smart_tire.paths import analyzed_bag, write_text
from smart_tire.recording import SampleArrays

MOTION = 'imu/data', 'wheel_states'  # inputs of dead reckoning
ESTIMATE = 'estimate'                # the method of a run that is no baseline
CSV, LATEX, FIGURE = 'comparison.csv', 'comparison.tex', 'comparison.png'
UNKNOWN = dict.fromkeys(('odom', 'wheel_slip', 'ground_state'))  # what is not estimated
ENDS: Columns = (
    ('distance [m]', 'odom.distance_m', '.2f'), ('x at the end [m]', 'odom.end.x_m', '.3f'),
    ('y [m]', 'odom.end.y_m', '.3f'), ('yaw [rad]', 'odom.end.yaw_rad', '.3f'),
    ('mean slip, left [-]', 'wheel_slip.left.mean', '.4f'),
    ('right [-]', 'wheel_slip.right.mean', '.4f'),
    ('median friction of the ground [-]', 'ground_state.friction_coefficient.median', '.3f'))
ERRORS: Columns = (
    ('position, rms [m]', 'pose.position_rms_m', '.3f'), ('end [m]', 'pose.position_end_m', '.3f'),
    ('end [%]', 'pose.end_percent_of_distance', '.2f'),
    ('in one meter [m]', 'pose.drift_per_meter_m', '.4f'),
    ('in 2 σ', 'pose.position_within_two', '.0%'), ('NEES', 'nees', '.2f'),
    ('heading, rms [rad]', 'pose.yaw.rms', '.4f'), ('in 2 σ', 'pose.yaw.within_two', '.0%'),
    ('slip, rms [-]', 'slip.rms', '.4f'), ('in 2 σ', 'slip.within_two', '.0%'),
    ('friction, median', 'friction.median_relative_error', '.0%'),
    ('in 2 σ', 'friction.within_two', '.0%'))
NOTE = ('Position, end: error, at the end, in % of the distance of the reference. In one meter: '
        'rms error of the displacement in each meter of the path. NEES: mean of the squared '
        'position errors over their covariances, 1 if these are right. Slip of all wheels; '
        'friction of informative single crossings, relative.')


def read_analysis(folder: Path) -> Result:
    """
    Return the result in the output ``folder`` of an analysis; raise BagError.

    References and inputs are those in its bag, if that is still where it was.
    """
    source = analyzed_bag(folder)  # first: it may be no analysis
    with Bag(folder / 'estimates') as bag:
        estimates, robot = bag.recording(ESTIMATES), bag_params(bag).params.robot
    smoothed = None
    if (folder / 'smoothed').is_dir():
        with Bag(folder / 'smoothed') as bag:
            smoothed = bag.recording(ESTIMATES)
    found = Result(estimates, smoothed=smoothed)
    if source is None:
        return found
    path, remap = source
    with Bag(path, TopicNames(remap), robot.joints) as bag:
        motion = bag.recording(MOTION)
        return with_references(replace(
            found, inputs=motion, dead_reckoning=baselines(motion, robot)), bag)


def with_references(result: Result, bag: Bag) -> Result:
    """Return ``result`` with ground truth and overhead camera in ``bag``."""
    return replace(result, truth=bag.recording(TRUTHS), camera=bag.recording(OVERHEAD))


def read_references(path: Path, names: TopicNames = STANDARD_NAMES) -> Result:
    """
    Return the references in the bag at ``path``; raise BagError if it has none.

    ``names`` are those that are named differently there.
    """
    with Bag(path, names) as bag:
        found = with_references(Result(SampleArrays()), bag)
    if not found.references:
        raise BagError(f'{path}: none of {", ".join((*TRUTHS, *OVERHEAD))} in the bag')
    return found


def named(results: Mapping[str, Result]) -> dict[str, Comparison]:
    """Return the comparisons of all ``results``; those of one with several have both names."""
    return {name if len(result.comparisons) == 1 else f'{name}, {label}': one
            for name, result in results.items() for label, one in result.comparisons.items()}


def rows_of(runs: Mapping[str, Comparison]) -> Iterator[tuple[str, str, Tree]]:
    """Yield label, method and errors of runs and of dead reckoning; None where unknown."""
    reckoned = None
    for label, one in runs.items():
        slips = one.slips
        yield label, ESTIMATE, _errors(one.poses) | plain({
            'slip': score(slips.error.ravel(), slips.sigma.ravel()) if len(slips.stamp_ns)
            else None,
            'friction': friction_score(one.matches.pairs) if one.reference.crossings else None})
        if one.dead_reckoning is not reckoned:  # filter and smoother have the same
            reckoned = one.dead_reckoning
            yield from ((label, method, _errors(poses) | {'slip': None, 'friction': None})
                        for method, poses in one.baselines.items())


def _errors(poses: ComparedPoses) -> Tree:
    pose = pose_score(poses)
    return plain({'pose': pose and asdict(pose),
                  'nees': None if pose is None else pose.position_normalized_rms ** 2})


def comparison_tables(runs: Mapping[str, Comparison]) -> list[Table]:
    """Return the estimates of ``runs`` and, with a reference, their errors."""
    trees = {label: {**UNKNOWN, **estimates_tree(one.estimates)} for label, one in runs.items()}
    ends = Table('Estimates', ['run', *(head for head, _, _ in ENDS)],
                 [[label, *cells(tree, ENDS)] for label, tree in trees.items()])
    if not any(len(one.reference) for one in runs.values()):
        return [ends]
    alignment = next(iter(runs.values())).align
    return [ends, Table(
        f'Errors of the runs; alignment of the paths: {alignment}',
        ['run', 'method', *(head for head, _, _ in ERRORS)],
        [[label, method, *cells(tree, ERRORS)] for label, method, tree in rows_of(runs)], 2,
        NOTE)]


def comparison_csv(runs: Mapping[str, Comparison]) -> str:
    """Return the errors as CSV; a column is named by its place in ``summary.json``."""
    file = io.StringIO()
    writer = csv.writer(file, lineterminator='\n')
    writer.writerow(['run', 'method', *(key for _, key, _ in ERRORS)])
    for label, method, tree in rows_of(runs):
        writer.writerow([label, method, *(value_of(tree, key) for _, key, _ in ERRORS)])
    return file.getvalue()


def write_comparison(folder: Path, runs: Mapping[str, Comparison], *, figure: bool = True
                     ) -> None:
    """Write the errors as CSV and LaTeX, and a figure of the paths; raise ParameterError."""
    write_text(folder / CSV, comparison_csv(runs))
    write_text(folder / LATEX, comparison_tables(runs)[-1].latex())
    drawn = comparison_figure(runs) if figure else None
    if drawn is not None:
        save(drawn, folder / FIGURE)
