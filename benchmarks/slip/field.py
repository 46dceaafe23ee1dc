# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
Slip estimator on seven recordings of other robots, whole and from the middle of a drive on.

Nothing is fitted: parameters are those of the data sheets and the wheel lag of the recording, and
the methods it is compared with are given the same. These are path by wheels and gyroscope, heading
by the gyroscope alone, forward speed by the wheels, no lateral speed and no slip. True velocities
are derivatives of the true poses over ``DERIVATIVE_WINDOW``.

    python -m benchmarks.slip.field [FOLDER]
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math
from pathlib import Path
import statistics
import sys

from benchmarks.slip.recordings import read
import numpy as np
from smart_tire.analysis.series import at, Floats, Series
from smart_tire.analysis.smoothing import smooth
from smart_tire.estimation.slip.estimator import SlipEstimator
from smart_tire.parameters import build, SlipEstimatorParams
from smart_tire.samples import ImuSample, NS_PER_S, Sample, WheelSample

DERIVATIVE_WINDOW = 0.6  # s, of the true velocity
ALIGNMENT = 1.0          # s, over which the paths are aligned at the start
WINDOW = 2.0             # s, of displacements where the true path is only chained
MIN_ROLLING_SPEED = 0.3  # m/s, for slip
CUT_SHARE = 0.4          # of the distance, where a cut recording begins
IMU_POSITION_SHARE = 0.25  # sigma of the IMU's x over the wheelbase: its place is not known
REST_TIME = 1.0          # s at the start with stationary wheels, for the baseline's gyro bias

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


@dataclass(frozen=True)
class Figure:
    """Error of the estimate, that of the baseline, and the share within two sigma."""

    error: float
    baseline: float
    inside: float = math.nan

    @property
    def ratio(self) -> float:
        """Return the error over that of the baseline."""
        return self.error / self.baseline


@dataclass(frozen=True)
class Truth:
    """True motion on its stamps."""

    stamp_ns: np.ndarray
    pose: Floats  # (n, 3), yaw unwrapped
    v_x: Floats
    v_y: Floats
    yaw_rate: Floats


def truth_of(stamp_ns: np.ndarray, pose: Floats) -> Truth:
    """Return poses with velocities by linear fits over ``DERIVATIVE_WINDOW``."""
    time = (stamp_ns - stamp_ns[0]) / NS_PER_S
    pose = pose.copy()
    pose[:, 2] = np.unwrap(pose[:, 2])
    rates = np.full((len(time), 3), math.nan)
    half = 0.5 * max(DERIVATIVE_WINDOW, 4.5 * float(np.median(np.diff(time))))
    for i, t in enumerate(time):
        a, b = np.searchsorted(time, [t - half, t + half])
        if b - a >= 4 and time[b - 1] - time[a] > 1.3 * half:
            tau = time[a:b] - time[a:b].mean()
            rates[i] = tau @ pose[a:b] / (tau @ tau)
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    return Truth(stamp_ns, pose, c * rates[:, 0] + s * rates[:, 1],
                 c * rates[:, 1] - s * rates[:, 0], rates[:, 2])


def wheel_speeds(samples: list[Sample], radius: float, lag: float) -> tuple[np.ndarray, Floats]:
    """Return stamps at the centers of the periods, lag removed, and r w (n, 2) of the sides."""
    wheels = [one for one in samples if isinstance(one, WheelSample)]
    stamp = np.array([one.stamp_ns for one in wheels])
    half = 0.5 * float(np.median(np.diff(stamp)))
    speed = radius * np.array([one.velocity for one in wheels])
    sides = np.column_stack([np.nanmean(speed[:, [0, 2]], 1), np.nanmean(speed[:, [1, 3]], 1)])
    return stamp - round(lag * NS_PER_S + half), sides


def baseline(samples: list[Sample], truth: Truth, radius: float, lag: float
             ) -> tuple[Floats, Floats, Floats]:
    """Return poses (n, 3), forward speed (n,) and side speeds (n, 2) at the true stamps."""
    imu = [one for one in samples if isinstance(one, ImuSample)]
    stamp = np.array([one.stamp_ns for one in imu])
    rate = np.array([one.rate[2] for one in imu])
    wheel_stamp, sides = wheel_speeds(samples, radius, lag)
    moving = np.flatnonzero(np.abs(sides).max(axis=1) > 0.01)
    rest = stamp < (wheel_stamp[moving[0]] if len(moving) else stamp[-1]) - NS_PER_S // 4
    if stamp[rest].size and stamp[rest][-1] - stamp[0] > REST_TIME * NS_PER_S:
        rate = rate - rate[rest].mean()
    dt = np.diff(stamp, prepend=stamp[0]) / NS_PER_S
    yaw = np.cumsum(rate * dt)
    v = at(stamp, wheel_stamp, sides).mean(axis=1)
    v = np.nan_to_num(v)
    x = np.column_stack([np.cumsum(v * np.cos(yaw) * dt), np.cumsum(v * np.sin(yaw) * dt), yaw])
    return (at(truth.stamp_ns, stamp, x), at(truth.stamp_ns, stamp, v[:, None])[:, 0],
            at(truth.stamp_ns, wheel_stamp, sides))


def path_errors(truth: Truth, pose: Floats) -> tuple[float, float]:
    """Return the rms errors [m, rad] of a path aligned at the start."""
    ok = np.isfinite(pose[:, 0])
    time = (truth.stamp_ns - truth.stamp_ns[ok][0]) / NS_PER_S
    start = ok & (time <= ALIGNMENT)
    turn = float(np.mean(pose[start, 2] - truth.pose[start, 2]))
    c, s = math.cos(turn), math.sin(turn)
    moved = truth.pose[:, :2] @ np.array([[c, s], [-s, c]])
    moved += np.mean(pose[start, :2] - moved[start], axis=0)
    error = pose[ok, :2] - moved[ok]
    return rms(np.linalg.norm(error, axis=1)), rms(pose[ok, 2] - truth.pose[ok, 2] - turn)


def displacement_error(truth: Truth, pose: Floats) -> float:
    """Return the rms error [m] of displacements over ``WINDOW`` in the frame of their start."""
    def moves(poses: Floats) -> Floats:
        later = at(truth.stamp_ns + round(WINDOW * NS_PER_S), truth.stamp_ns, poses)
        d = later[:, :2] - poses[:, :2]
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        return np.column_stack([c * d[:, 0] + s * d[:, 1], c * d[:, 1] - s * d[:, 0]])
    error = np.linalg.norm(moves(pose) - moves(truth.pose), axis=1)
    return rms(error[np.isfinite(error)])


def rms(values: Floats) -> float:
    """Return the root mean square of the finite values."""
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values ** 2))) if len(values) else math.nan


def inside(error: Floats, sigma: Floats) -> float:
    """Return the share of errors within two sigma."""
    ok = np.isfinite(error) & np.isfinite(sigma)
    return float(np.mean(np.abs(error[ok]) <= 2.0 * sigma[ok])) if ok.any() else math.nan


def figures(name: str, samples: list[Sample], truth: Truth, estimates: Series
            ) -> dict[str, Figure]:
    """Return the figures of one recording."""
    known, lag, chained = RECORDINGS[name]
    poses, slips = estimates.poses(), estimates.slips()
    stamps = truth.stamp_ns
    pose = at(stamps, poses.stamp_ns, poses.pose)
    twist = at(stamps, poses.stamp_ns, poses.twist)
    sigma = np.sqrt(at(stamps, poses.stamp_ns, poses.twist_variance))
    base, wheels, sides = baseline(samples, truth, known['wheel_radius'], lag)
    ok = np.isfinite(pose[:, 0]) & np.isfinite(base[:, 0]) & np.isfinite(truth.v_x)
    pose[~ok], base[~ok] = math.nan, math.nan
    result = {}
    if chained:
        (path, heading), (path_0, heading_0) = path_errors(truth, pose), path_errors(truth, base)
        result = {'path': Figure(path, path_0), 'heading': Figure(heading, heading_0)}
    else:
        result['path'] = Figure(displacement_error(truth, pose), displacement_error(truth, base))
    error = (twist[:, 0] - truth.v_x)[ok]
    result['v_x'] = Figure(rms(error), rms((wheels - truth.v_x)[ok]), inside(error, sigma[ok, 0]))
    error = (twist[:, 1] - truth.v_y)[ok]
    result['v_y'] = Figure(rms(error), rms(truth.v_y[ok]), inside(error, sigma[ok, 1]))
    half = 0.5 * known['track_width'] * truth.yaw_rate
    if name.startswith('husky'):  # only the mean wheel speed is known
        half = 0.0 * half
    ground = np.column_stack([truth.v_x - half, truth.v_x + half])
    with np.errstate(invalid='ignore', divide='ignore'):
        true = np.clip((sides - ground) / sides, -1.0, 1.0)
    valid = (np.abs(sides) > MIN_ROLLING_SPEED) & ok[:, None]
    slip = at(stamps, slips.stamp_ns, slips.ratio)[:, :2]
    slip_sigma = at(stamps, slips.stamp_ns, slips.sigma)[:, :2]
    if name.startswith('husky'):
        slip = np.repeat(slip.mean(axis=1), 2).reshape(-1, 2)
    valid &= np.isfinite(slip) & np.isfinite(true)
    error = (slip - true)[valid]
    result['slip'] = Figure(rms(error), rms(true[valid]), inside(error, slip_sigma[valid]))
    return result


def runs(folder: Path) -> Iterator[tuple[str, str, list[Sample], Truth]]:
    """Yield name, label, samples and truth of every recording and cut recording."""
    for name, (_, _, _) in RECORDINGS.items():
        if not (folder / name).exists():
            print(f'{name}: not in {folder}, skipped')
            continue
        samples, poses = read(folder / name)
        truth = truth_of(poses.stamp_ns, poses.pose)
        yield name, name, samples, truth
        steps = np.linalg.norm(np.diff(truth.pose[:, :2], axis=0), axis=1)
        share = np.cumsum(steps) / steps.sum()
        begin = truth.stamp_ns[int(np.argmax(
            (share > CUT_SHARE) & (np.abs(truth.v_x[1:]) > 0.5 * np.nanmax(truth.v_x))))]
        after = truth.stamp_ns >= begin
        yield (name, name + ' cut', [one for one in samples if one.stamp_ns >= begin],
               Truth(truth.stamp_ns[after], truth.pose[after], truth.v_x[after],
                     truth.v_y[after], truth.yaw_rate[after]))


def parameters(name: str) -> SlipEstimatorParams:
    """Return the parameters of a recording."""
    known, lag, _ = RECORDINGS[name]
    return build(SlipEstimatorParams, {
        **known, 'imu.position': [0.0, 0.0, 0.0], 'encoder.latency': lag,
        'imu.position_sigma': IMU_POSITION_SHARE * known['wheelbase']})


def main() -> None:
    """Print the table: errors, their ratios to the baselines and shares within two sigma."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else '../shared/data')
    with_smoother = '--smooth' in sys.argv
    ratios: dict[str, list[float]] = {name: [] for name in QUANTITIES}
    print(f'{"":26}' + ''.join(f'{name:>22}' for name in QUANTITIES))
    for name, label, samples, truth in runs(folder):
        if with_smoother:
            both = smooth(parameters(name), samples)
            results = {'': both.filtered, ' smoothed': both.smoothed}
        else:
            series, estimator = Series(), SlipEstimator(parameters(name))
            for sample in samples:
                if not isinstance(sample, (ImuSample, WheelSample)):
                    continue
                for record in estimator.update(sample):
                    if type(record).__name__ in ('Odometry', 'WheelSlip'):
                        series.add(record)
            results = {'': series}
        for suffix, estimates in results.items():
            line = f'{label + suffix:26}'
            for quantity, figure in figures(name, samples, truth, estimates).items():
                if quantity == 'v_x' and 'heading' not in line and not RECORDINGS[name][2]:
                    line += ' ' * 22
                ratios[quantity].append(figure.ratio)
                line += (f' {figure.error:6.3f}/{figure.baseline:5.3f} {figure.ratio:4.2f}'
                         + (' ' * 4 if math.isnan(figure.inside) else f' {figure.inside:3.0%}'))
            print(line, flush=True)
    print(f'{"median of ratios":26}' + ''.join(
        f'{statistics.median(values):22.2f}' for values in ratios.values()))
    print(f'{"largest ratio":26}' + ''.join(f'{max(values):22.2f}' for values in ratios.values()))


if __name__ == '__main__':
    main()
