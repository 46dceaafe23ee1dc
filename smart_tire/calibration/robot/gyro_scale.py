"""The gyro's scale against the yaw of a reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.recording import PoseRecord, Recording, Signal
from smart_tire.errors import EstimatorError
from smart_tire.numerics.delay_regression import fit_delay, Problem, Rows
from smart_tire.uncertain import Uncertain


STRETCH = 1.0        # s over which yaw is taken: as long as a turn, against noise of the poses
LONGEST_GAP = 0.5    # s between poses
REACH = 1.0          # s, of the delays of the reference that are tried
STEP = 0.05          # s, of their grid
TURNING = 0.05       # rad/s; slower stretches tell nothing of a scale
CLEAR_TURN = 1.0     # rad, beyond what a bias of the gyro makes of a run
SCALE_LIMIT = 0.05   # standard error above which a scale is not told


@dataclass(frozen=True)
class GyroCheck:
    """The gyro against the reference."""

    scale: Uncertain    # what the gyro reads over the true rate
    latency: Uncertain  # s, how late the stamps of the reference are against the gyro


def check_gyro(recording: Recording) -> GyroCheck:
    """Return the gyro's scale; EstimatorError where reference or turns are missing."""
    begin, end, turned = _turns(usable_reference(recording))
    imu = recording.imu
    gyro = Signal(imu.time, imu.rate[:, 2])
    inside = (begin > imu.time[0] + REACH) & (end < imu.time[-1] - REACH)
    begin, end, turned = begin[inside], end[inside], turned[inside]
    if len(end):
        # a delay must not take a turn out of its stretch: neighbours of turns stay
        rate = np.abs(gyro.mean(begin - REACH, end + REACH))
        begin, end, turned = (values[rate > TURNING] for values in (begin, end, turned))
    duration = end - begin

    def rows(delay: float) -> Rows:
        rate = gyro.mean(begin - delay, end - delay)
        return Rows(np.column_stack([turned / duration, np.ones(len(end))]), rate)

    fit = fit_delay(Problem(rows, lambda delay: np.zeros(len(end)), end, np.zeros(2),
                            np.full(2, np.inf)), np.arange(-REACH, REACH + STEP, STEP))
    scale = Uncertain(float(fit.coefficients[0]), fit.coefficient_sigma(0))
    if scale.sigma > SCALE_LIMIT:
        raise EstimatorError(f'standard error of {scale.sigma:.2g}, expected at most '
                             f'{SCALE_LIMIT:g}: the robot hardly turns')
    return GyroCheck(scale, Uncertain(fit.delay, fit.sigma))


def usable_reference(recording: Recording) -> PoseRecord:
    """Return the reference; EstimatorError without one, or where its yaw stays while it turns."""
    poses, imu = recording.reference, recording.imu
    if poses is None:
        raise EstimatorError('there is no reference of the pose')
    turned = Signal(imu.time, imu.rate[:, 2]).integral(poses.time)
    if np.ptp(turned) > CLEAR_TURN and np.ptp(poses.yaw) < 0.5 * np.ptp(turned):
        raise EstimatorError(f'the reference turns by {np.ptp(poses.yaw):.2g} rad while the gyro '
                             f'turns by {np.ptp(turned):.2g} rad: it has no yaw')
    return poses


def _turns(reference: PoseRecord) -> tuple[Array, Array, Array]:
    """Return begin, end [s] and turn [rad] of stretches of the reference."""
    ends = np.array(list(reference.stretches(STRETCH, LONGEST_GAP)), int).reshape(-1, 2)
    first, last = ends.T
    return (reference.time[first], reference.time[last],
            reference.yaw[last] - reference.yaw[first])
