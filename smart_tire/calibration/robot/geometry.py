"""What a recording tells of a robot's wheels and of its inertial unit, and what it does not."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
import math
from typing import TypeVar

from smart_tire.calibration.recording import Recording
from smart_tire.calibration.robot.accelerometer_fit import fit_speed_changes, SpeedFit
from smart_tire.calibration.robot.gyro_scale import check_gyro, GyroCheck, usable_reference
from smart_tire.calibration.robot.rolling_radius import fit_radius, TURN_SLIP, WayFit
from smart_tire.calibration.robot.static_imu import fit_rest, HELD, RestFit
from smart_tire.calibration.robot.timestamp_jitter import fit_jitter
from smart_tire.calibration.robot.wheel_latency import fit_turns, TurnFit
from smart_tire.errors import EstimatorError
from smart_tire.parameters import RobotParams
from smart_tire.parameters.calibration_file import Identified
from smart_tire.rotation import angles, matrix
from smart_tire.uncertain import Uncertain, weighted_mean

LATENCY, JITTER, TRACK = 'wheel latency', 'stamp jitter', 'effective track'
RADIUS, GYRO_SCALE, REST = 'rolling radius', 'gyro scale', 'inertial unit'
ROLL, PITCH = 'mounting roll', 'mounting pitch'
TRACK_LIMIT = 0.1   # relative standard error above which a track is not given
TILTED = 3.0        # sigmas of bias and slope, above which a tilt belongs to the mounting

Fit = TypeVar('Fit')


@dataclass(frozen=True)
class Quantity:
    """One line of what was found."""

    name: str
    estimate: Uncertain
    unit: str
    note: str = ''
    parameter: str = ''  # that takes the value, '' where there is none


@dataclass
class Geometry:
    """What was found, what was refused with the reason, and the fits, None where refused."""

    quantities: list[Quantity] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)  # name -> reason
    turns: TurnFit | None = None
    speeds: SpeedFit | None = None
    ways: WayFit | None = None

    def get(self, name: str) -> Uncertain | None:
        """Return the estimate of the quantity ``name``, None if it was refused."""
        return next((item.estimate for item in self.quantities if item.name == name), None)

    def add(self, name: str, estimate: Uncertain, unit: str, note: str = '',
            parameter: str = '') -> None:
        """Append a quantity."""
        self.quantities.append(Quantity(name, estimate, unit, note, parameter))

    def attempt(self, name: str, fit: Callable[[], Fit]) -> Fit | None:
        """Return what ``fit`` returns; where it refuses, note why ``name`` is not told."""
        try:
            return fit()
        except EstimatorError as error:
            self.refused[name] = str(error)
            return None


def identify_geometry(recording: Recording, robot: RobotParams) -> Geometry:
    """Return all that ``recording`` tells; what it does not tell stands in ``refused``."""
    found = Geometry()
    rest = found.attempt(REST, lambda: fit_rest(recording, robot))
    gyro = found.attempt(GYRO_SCALE, lambda: check_gyro(recording))
    _add_latency(found, recording, robot)
    jitter = found.attempt(JITTER, lambda: fit_jitter(recording.wheels, robot))
    if jitter is not None:
        found.add(JITTER, jitter, 's', 'standard deviation of a stamp', 'encoder.stamp_jitter')
    _add_radius(found, recording, robot, gyro)
    _add_track(found, robot)
    if gyro is not None:
        found.add(GYRO_SCALE, gyro.scale, '-', 'against the reference; no parameter takes it')
    if rest is not None:
        _add_rest(found, rest)
    return found


def _add_latency(found: Geometry, recording: Recording, robot: RobotParams) -> None:
    turns = found.turns = found.attempt(LATENCY, lambda: fit_turns(recording, robot))
    speeds = found.speeds = found.attempt(
        'latency by speed', lambda: fit_speed_changes(recording, robot))
    by_speed = found.refused.pop('latency by speed', '')
    if turns is None and speeds is None:
        found.refused[LATENCY] += f'; changes of speed: {by_speed}'
    # turns first: bodies pitch when they gain speed, and lag more behind their wheels
    other = '' if speeds is None else (f'changes of speed say {speeds.latency.value:.3f} '
                                       f'± {speeds.latency.sigma:.3f} s')
    if turns is not None:
        found.add(LATENCY, turns.latency, 's', other, 'encoder.latency')
    elif speeds is not None:
        why = found.refused.pop(LATENCY)
        found.add(LATENCY, speeds.latency, 's', f'by changes of speed, for in turns: {why}',
                  'encoder.latency')


def _add_radius(found: Geometry, recording: Recording, robot: RobotParams,
                gyro: GyroCheck | None) -> None:
    found.ways = found.attempt(RADIUS, lambda: _ways(found, recording, robot, gyro))
    if found.ways is None:
        if found.speeds is not None:
            rough = found.speeds.radius
            found.refused[RADIUS] += (
                f'; the accelerometer says {rough.value:.3f} ± {rough.sigma:.3f} m')
        return
    radius = found.ways.radius
    found.add(RADIUS, radius, 'm', 'mean, with the slip that rolling straight takes',
              'wheel_radius')
    if found.turns is not None:
        unlike = found.turns.unlike
        sigma = math.hypot(radius.sigma, 0.5 * radius.value * unlike.sigma)
        for side, sign in (('left', -1.0), ('right', 1.0)):
            value = radius.value * (1.0 + 0.5 * sign * unlike.value)
            found.add(f'{RADIUS}, {side}', Uncertain(value, sigma), 'm')


def _ways(found: Geometry, recording: Recording, robot: RobotParams,
          gyro: GyroCheck | None) -> WayFit:
    poses = usable_reference(recording)
    latency = found.get(LATENCY) or Uncertain(robot.encoder.latency, math.inf)
    ahead = gyro.latency.value if gyro is not None else 0.0
    turn_slip = TURN_SLIP
    if found.turns is not None:
        track = found.turns.slope.value * robot.wheel_radius
        turn_slip = min(max(1.0 - robot.track_width / track, 0.0), 1.0)
    return fit_radius(recording.wheels, poses, latency.value - ahead, robot,
                      turn_slip)


def _add_track(found: Geometry, robot: RobotParams) -> None:
    if found.turns is None:
        found.refused[TRACK] = f'as little as the latency by turns ({LATENCY})'
        return
    slope = found.turns.slope
    radius = found.get(RADIUS) or Uncertain(robot.wheel_radius, 0.0)
    track = Uncertain(slope.value * radius.value, math.hypot(
        slope.sigma * radius.value, slope.value * radius.sigma))
    if track.sigma > TRACK_LIMIT * track.value:
        found.refused[TRACK] = (f'standard error of {track.sigma / track.value:.0%}, expected at '
                                f'most {TRACK_LIMIT:.0%}')
    else:
        found.add(TRACK, track, 'm', 'with the rolling radius above' if found.ways is not None
                  else 'with the wheel_radius given', 'effective_track')


def _add_rest(found: Geometry, rest: RestFit) -> None:
    for axis, bias in zip('xyz', rest.gyro_bias):
        found.add(f'gyro bias {axis}', bias, 'rad/s', 'of this run')
    held = f', {rest.repeated:.0%} of the readings repeat others and do not count' if (
        rest.repeated > HELD) else ''
    found.add('gyro noise', rest.gyro_noise, 'rad/s', f'of a reading at rest{held}',
              'imu.gyro_noise')
    found.add('accelerometer noise', rest.accel_noise, 'm/s2', f'of a reading at rest{held}',
              'imu.accel_noise')
    places = f'{rest.places} rests' if rest.places > 1 else 'one rest'
    for name, tilt in ((ROLL, rest.roll), (PITCH, rest.pitch)):
        found.add(name, tilt, 'rad', f'beyond imu.rotation, by {places}; its error has the bias '
                                     'and the slope of the ground')


def parameters(found: Geometry, robot: RobotParams) -> list[Identified]:
    """
    Return what goes into a parameter file.

    The mounting is only there where it is tilted by more than bias and slope may look like.
    """
    items = [Identified(item.parameter, item.estimate.value, item.estimate.sigma, item.note)
             for item in found.quantities if item.parameter]
    radius = found.get(RADIUS)
    if radius is not None:
        items.append(Identified('wheel_radius_sigma', radius.sigma / radius.value))
    roll, pitch = found.get(ROLL), found.get(PITCH)
    if roll is not None and pitch is not None and any(
            abs(tilt.value) > TILTED * tilt.sigma for tilt in (roll, pitch)):
        turned = matrix(roll.value, pitch.value, 0.0) @ matrix(*robot.imu.rotation)
        items.append(Identified('imu.rotation', angles(turned), (roll.sigma, pitch.sigma, 0.0),
                                'yaw as it was'))
    return items


def together(parts: Iterable[Geometry]) -> Geometry:
    """
    Return what several recordings tell together: means weighted by the standard errors.

    Where they scatter more than their standard errors say, those grow accordingly.
    """
    parts = list(parts)
    merged = Geometry()
    for kind in ('turns', 'speeds', 'ways'):
        setattr(merged, kind, next(filter(None, (getattr(part, kind) for part in parts)), None))
    names = dict.fromkeys(item.name for part in parts for item in part.quantities)
    for name in names:
        same = [item for part in parts for item in part.quantities if item.name == name]
        merged.quantities.append(replace(
            same[0], estimate=weighted_mean([item.estimate for item in same])))
    for part in parts:
        merged.refused.update((name, why) for name, why in part.refused.items()
                              if name not in names)
    return merged
