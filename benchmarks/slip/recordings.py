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
Slip estimator on recordings of other robots, whole and from the middle of a drive on.

Nothing is fitted: parameters are those of the data sheets and the wheel lag of the recording, and
the methods it is compared with are given the same. These are path by wheels and gyroscope, heading
by the gyroscope alone, forward speed by the wheels, no lateral speed and no slip. True velocities
are derivatives of the true poses over ``DERIVATIVE_WINDOW``. Their standard errors, by the scatter
of these poses, are part of the sigmas that errors are compared with: stamps of lidars jitter.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
import math
from pathlib import Path

from benchmarks.harness import Column, Job, percent, Rows
from benchmarks.scoring import Errors, Figures, part_of, Run
import numpy as np
from smart_tire.analysis.dead_reckoning import as_inputs, gyro_odometry
from smart_tire.analysis.metrics import rotated
from smart_tire.analysis.pipeline import smooth
from smart_tire.arrays import Array, Instants
from smart_tire.bags import Bag
from smart_tire.estimates import at
from smart_tire.parameters import build, RobotParams, SlipEstimatorParams
from smart_tire.recording import SampleArrays
from smart_tire.samples import NS_PER_S, Sample

TRUTH = 'ground_truth/odom'
TOPICS = ('imu/data', 'wheel_states', TRUTH)
DERIVATIVE_WINDOW = 0.6  # s, of the true velocity
ALIGNMENT = 1.0          # s, over which the paths are aligned at the start
WINDOW = 2.0             # s, of displacements where the true path is only chained
MIN_ROLLING_SPEED = 0.3  # m/s, for slip
CUT_SHARE = 0.4          # of the distance, where a cut recording begins
IMU_POSITION_SHARE = 0.25  # sigma of the IMU's x over the wheelbase: its place is not known

WARTHOG = {'wheel_radius': 0.30, 'track_width': 1.08, 'wheelbase': 1.05}
HUSKY = {'wheel_radius': 0.1651, 'track_width': 0.555, 'wheelbase': 0.540}
# folder -> data sheet, wheel lag [s] beyond half a period, whether the true path is one
RECORDINGS: dict[str, tuple[dict[str, float], float, bool]] = {
    'warthog_asphalt': (WARTHOG, 0.045, True),
    'warthog_grass_0808c': (WARTHOG, 0.04, True),
    'warthog_grass_0729a': (WARTHOG, 0.04, True),
    'husky_rectangle': (HUSKY, -0.05, True),
    'husky_mair_6': (HUSKY, -0.05, True),
    'warthog_gravel_0': (WARTHOG, 0.0, False),
    'warthog_ice_1': (WARTHOG, 0.0, False)}
QUANTITIES = ('path', 'heading', 'v_x', 'v_y', 'slip')
BASELINE, METHODS = 'baseline', ('live', 'smoothed')
RECORDING_COLUMNS = tuple(column for name in QUANTITIES for column in (
    Column(f'{name}\nrms', f'{name}.rms', 3), Column('\nratio', f'{name}.ratio', 2), *(
        [percent('\n2 s.', f'{name}.within_two', 0)] if name in QUANTITIES[2:] else [])))


@dataclass(frozen=True)
class RecordedTruth:
    """True motion on its stamps."""

    stamp_ns: Instants
    pose: Array   # (n, 3), yaw unwrapped
    twist: Array  # (n, 3), v_x, v_y, yaw rate
    sigma: Array  # (n, 3), standard errors of the twist

    def after(self, begin_ns: int) -> RecordedTruth:
        """Return the part from ``begin_ns`` on."""
        later = self.stamp_ns >= begin_ns
        return RecordedTruth(
            self.stamp_ns[later], self.pose[later], self.twist[later], self.sigma[later])


def recording_jobs(folder: Path) -> list[Job]:
    """Return the jobs of the recordings in ``folder``; print which are missing."""
    for name in RECORDINGS:
        if not (folder / name).exists():
            print(f'{name}: not in {folder}, skipped (--data DIR)')
    return [partial(run_recording, folder / name) for name in RECORDINGS
            if (folder / name).exists()]


def run_recording(path: Path) -> list[Run]:
    """Return the errors on a recording, and on it from the middle of a drive on."""
    samples, truth = read(path)
    steps = np.linalg.norm(np.diff(truth.pose[:, :2], axis=0), axis=1)
    share, v_x = np.cumsum(steps) / steps.sum(), truth.twist[:, 0]
    begin_ns = int(truth.stamp_ns[int(np.argmax(
        (share > CUT_SHARE) & (np.abs(v_x[1:]) > 0.5 * np.nanmax(v_x))))])
    later = [one for one in samples if one.stamp_ns >= begin_ns]
    return [score_recording(path.name, path.name, samples, truth),
            score_recording(path.name, f'{path.name} cut', later, truth.after(begin_ns))]


def read(path: Path) -> tuple[list[Sample], RecordedTruth]:
    """Return the inputs in order of reception, and the true motion."""
    samples, truth = list[Sample](), SampleArrays()
    with Bag(path) as bag:
        for _, topic, sample in bag.samples(TOPICS):
            if topic == TRUTH:
                truth.add_sample(sample)
            else:
                samples.append(sample)
    poses = truth.poses()
    return samples, truth_from(poses.stamp_ns, poses.pose)


def truth_from(stamp_ns: Instants, pose: Array) -> RecordedTruth:
    """Return poses with velocities by linear fits over ``DERIVATIVE_WINDOW``."""
    time = (stamp_ns - stamp_ns[0]) / NS_PER_S
    pose = np.column_stack([pose[:, :2], np.unwrap(pose[:, 2])])
    twist, sigma = np.full((2, len(time), 3), math.nan)
    half = 0.5 * max(DERIVATIVE_WINDOW, 4.5 * float(np.median(np.diff(time))))
    for i, t in enumerate(time):
        a, b = np.searchsorted(time, [t - half, t + half])
        if b - a >= 4 and time[b - 1] - time[a] > 1.3 * half:
            tau = time[a:b] - time[a:b].mean()
            moved = pose[a:b] - pose[a:b].mean(axis=0)
            moved[:, :2] = rotated(moved[:, :2], -pose[i, 2])
            twist[i] = tau @ moved / (tau @ tau)
            # a steady acceleration is no scatter
            _, squares, *_ = np.linalg.lstsq(np.vander(tau, 3), moved)
            sigma[i] = np.sqrt(squares / max(b - a - 3, 1) / (tau @ tau)) if len(squares) else 0.0
    return RecordedTruth(stamp_ns, pose, twist, sigma)


def score_recording(name: str, row: str, samples: list[Sample], truth: RecordedTruth) -> Run:
    """Return the errors of live and smoothed estimates, and of the baseline."""
    known, lag, _ = RECORDINGS[name]
    params = build(SlipEstimatorParams, {
        **known, 'imu.position': [0.0, 0.0, 0.0], 'encoder.latency': lag,
        'imu.position_sigma': IMU_POSITION_SHARE * known['wheelbase']})
    base = baseline(samples, truth.stamp_ns, params.robot)
    errors: dict[str, Errors] = {}
    for method, series in zip(METHODS, smooth(params, samples)):
        errors |= _errors(name, method, base, truth, series)
    return Run(row, 0, errors)


def _errors(name: str, method: str, reckoned: tuple[Array, Array, Array], truth: RecordedTruth,
            estimates: SampleArrays) -> dict[str, Errors]:
    """Return the errors of a method, and of the baseline at the same times."""
    known, _, chained = RECORDINGS[name]
    poses, slips, stamps = estimates.poses(), estimates.slips(), truth.stamp_ns
    pose, twist = at(stamps, poses.stamp_ns, poses.pose), at(stamps, poses.stamp_ns, poses.twist)
    sigma = np.sqrt(at(stamps, poses.stamp_ns, poses.twist_sigma ** 2))
    base, wheels, sides = reckoned[0].copy(), *reckoned[1:]
    ok = np.isfinite(pose[:, 0]) & np.isfinite(base[:, 0]) & np.isfinite(truth.twist[:, 0])
    pose[~ok], base[~ok] = math.nan, math.nan
    v_x, v_y, yaw_rate = truth.twist.T
    mean_only = name.startswith('husky')  # only the mean wheel speed is known
    lever = 0.0 if mean_only else 0.5 * known['track_width']
    half = lever * yaw_rate
    with np.errstate(invalid='ignore', divide='ignore'):
        true = np.clip((sides - np.column_stack([v_x - half, v_x + half])) / sides, -1.0, 1.0)
        true_sigma = np.hypot(truth.sigma[:, :1], lever * truth.sigma[:, 2:]) / sides
    slip = at(stamps, slips.stamp_ns, slips.ratio)[:, :2]
    slip_sigma = np.hypot(at(stamps, slips.stamp_ns, slips.sigma)[:, :2], true_sigma)
    sigma = np.hypot(sigma[:, :2], truth.sigma[:, :2])
    if mean_only:
        slip = np.repeat(slip.mean(axis=1), 2).reshape(-1, 2)
    valid = (np.abs(sides) > MIN_ROLLING_SPEED) & ok[:, np.newaxis]
    valid &= np.isfinite(slip) & np.isfinite(true)
    path = path_errors if chained else displacement_errors
    own = {**path(truth, pose), 'v_x': Errors((twist[:, 0] - v_x)[ok], sigma[ok, 0]),
           'v_y': Errors((twist[:, 1] - v_y)[ok], sigma[ok, 1]),
           'slip': Errors((slip - true)[valid], slip_sigma[valid])}
    others = {**path(truth, base), **{what: Errors.without_sigma(error) for what, error in (
        ('v_x', (wheels - v_x)[ok]), ('v_y', v_y[ok]), ('slip', true[valid]))}}
    return ({f'{method}.{what}': one for what, one in own.items()}
            | {f'{method}.{BASELINE}.{what}': one for what, one in others.items()})


def baseline(samples: list[Sample], stamps: Instants, robot: RobotParams
             ) -> tuple[Array, Array, Array]:
    """Return poses (n, 3), forward speed (n,) and side speeds (n, 2) at ``stamps``."""
    inputs = as_inputs(SampleArrays(samples), robot)
    poses, _ = gyro_odometry(inputs)
    pose, twist = (at(stamps, poses.stamp_ns, values) for values in (poses.pose, poses.twist))
    return pose, twist[:, 0], at(stamps, inputs.wheel_ns, inputs.rolling)


def path_errors(truth: RecordedTruth, pose: Array) -> dict[str, Errors]:
    """Return the distances [m] and heading errors [rad] of a path aligned at the start."""
    ok = np.isfinite(pose[:, 0])
    start = ok & (truth.stamp_ns <= truth.stamp_ns[ok][0] + ALIGNMENT * NS_PER_S)
    turn = float(np.mean(pose[start, 2] - truth.pose[start, 2]))
    moved = rotated(truth.pose[:, :2], turn)
    moved += np.mean(pose[start, :2] - moved[start], axis=0)
    return {'path': Errors.without_sigma(np.linalg.norm(pose[ok, :2] - moved[ok], axis=1)),
            'heading': Errors.without_sigma(pose[ok, 2] - truth.pose[ok, 2] - turn)}


def displacement_errors(truth: RecordedTruth, pose: Array) -> dict[str, Errors]:
    """Return the errors [m] of displacements over ``WINDOW`` in the frame of their start."""
    def moves(poses: Array) -> Array:
        later = at(truth.stamp_ns + round(WINDOW * NS_PER_S), truth.stamp_ns, poses)
        return rotated(later[:, :2] - poses[:, :2], -poses[:, 2])
    error = np.linalg.norm(moves(pose) - moves(truth.pose), axis=1)
    return {'path': Errors.without_sigma(error[np.isfinite(error)])}


def recording_rows(rows: Rows) -> list[tuple[str, Figures]]:
    """Return the lines of the table: recordings by method, median and largest ratios."""
    found = []
    for row, figures in rows.items():
        for method in METHODS:
            own = {f'{name}.{part}': figures[f'{method}.{name}.{part}'] for name in QUANTITIES
                   for part in ('rms', 'within_two') if f'{method}.{name}.rms' in figures}
            base = part_of(figures, f'{method}.{BASELINE}')
            own |= {f'{name}.ratio': own[f'{name}.rms'] / base[f'{name}.rms']
                    for name in QUANTITIES if f'{name}.rms' in own}
            found.append((f'{row}: {method}', own))
    return found + list(_summary(found)) if found else []


def _summary(lines: list[tuple[str, Figures]]) -> Iterator[tuple[str, Figures]]:
    for label, share in (('median of ratios', 0.5), ('largest ratio', 1.0)):
        for method in METHODS:
            own = [figures for row, figures in lines if row.endswith(method)]
            ratios = {name: [one[name] for one in own if name in one]
                      for name in (f'{quantity}.ratio' for quantity in QUANTITIES)}
            yield f'{label}: {method}', {name: float(np.quantile(values, share))
                                         for name, values in ratios.items() if values}
