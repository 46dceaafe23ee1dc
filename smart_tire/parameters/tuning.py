"""The estimators and the controller (``config/tuning.yaml``)."""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.spec import group, param, part

RELIABILITIES = ('reliable', 'best_effort')


@dataclass(frozen=True, kw_only=True)
class SlipEstimatorParams:
    """Slip estimator: an extended Kalman filter on IMU and wheels."""

    reorder_window: float = param(
        0.03, 's', 'how far message stamps may be out of order', low=0.0, high=1.0)
    constraint: str = param('plain', '-', 'slips in B(7): plain, or as printed',
                            choices=('plain', 'printed'))
    slip_sigma: float = param(
        0.15, '-', 'spread of slip by which the two sides differ, where nothing is known of it',
        low=1e-3, high=1.0)
    common_slip_sigma: float = param(
        0.07, '-', 'spread of slip that both sides share, at constant speed', low=1e-3, high=1.0)
    rolling_slip_sigma: float = param(
        0.015, '-', 'spread of the slip of wheels that only roll, on firm ground', low=1e-4)
    slip_drift: float = param(
        0.005, '1/sqrt(s)', 'how fast the slip of a side wanders while nothing happens', low=0.0)
    slip_agility: float = param(
        1.0, '-', 'change of sliding per change of wheel or ground speed, one sigma', low=0.0)
    icr: float = param(0.0, 'm', 'S at the start: x of the centre of rotation in base_link')
    icr_sigma: float = param(
        0.2, '-', 'what is known of S at the start, one sigma over the wheelbase', low=0.0)
    icr_drift: float = param(
        0.005, '1/sqrt(s)', 'how fast S wanders, over the wheelbase', low=0.0)
    lateral_sigma: float = param(
        0.006, 'm/s', 'lateral speed beyond that of B(8), correlated over 0.1 s', low=1e-5)
    slope_sigma: float = param(
        0.0002, 'rad', 'slope of the ground; a laboratory floor, larger outdoors', low=0.0)
    reliability: str = param('reliable', '-', 'of the input subscriptions', choices=RELIABILITIES)
    robot: RobotParams = part(RobotParams)


@dataclass(frozen=True, kw_only=True)
class FrictionEstimatorParams:
    """Friction estimator: one record per passage of a wheel's films."""

    reorder_window: float = param(
        0.06, 's', 'how far message stamps may be out of order', low=0.0, high=1.0)
    method: str = param('waveform', '-', "a fit of the whole waveform, or the paper's peaks",
                        choices=('waveform', 'two_peaks'))
    map: str = param('exact', '-', 'of two_peaks, interval to adhesion length: exact, or printed',
                     choices=('exact', 'printed'))
    load_sigma: float = param(
        0.02, '-', "relative sigma of a wheel's load: uneven ground, suspension", low=0.0)
    reliability: str = param('reliable', '-', 'of the input subscriptions', choices=RELIABILITIES)
    robot: RobotParams = part(RobotParams)

    def __post_init__(self) -> None:
        film, patch = self.robot.film, self.robot.tire.contact_length
        if self.method == 'two_peaks' and film.length >= patch:
            raise ValueError(f'method: two_peaks needs a film.length ({film.length} m) below '
                             f'tire.contact_length ({patch} m)')
        if self.method == 'two_peaks' and film.release != 'fig8':
            raise ValueError(f'method: two_peaks needs film.release fig8, not {film.release}: '
                             'without an opposite peak there are no two')


@dataclass(frozen=True, kw_only=True)
class PidParams:
    """Speed control of one wheel; the feed-forward alone brings an unloaded motor to speed."""

    feed_forward: float = param(
        0.05, 's/rad', 'duty per wanted wheel speed: 1 / free speed', low=0.0, live=True)
    proportional: float = param(0.04, 's/rad', 'duty per error', low=0.0, live=True)
    integral: float = param(
        0.15, '1/rad', 'duty per error and second', low=0.0, live=True)
    derivative: float = param(
        0.002, 's2/rad', 'duty per change of the wheel speed', low=0.0, live=True)
    limit: float = param(1.0, '-', 'largest duty', low=0.0, high=1.0, live=True)
    rate_limit: float = param(
        4.0, '1/s', 'largest change of the duty per second', low=1e-2, live=True)


@dataclass(frozen=True, kw_only=True)
class WheelControllerParams:
    """Wheel controller: one PID per wheel on its speed."""

    rate: float = param(16.0, 'Hz', 'control steps per second', low=1.0, high=200.0)
    cmd_vel_inputs: tuple[str, ...] = param(
        ('cmd_vel',), '-', 'topics that command a velocity, each from one publisher')
    cmd_vel_priorities: tuple[int, ...] = param(
        (0,), '-', 'of each of cmd_vel_inputs; a higher number wins')
    cmd_vel_timeouts: tuple[float, ...] = param(
        (0.0,), 's', 'of each of cmd_vel_inputs; 0 stands for cmd_vel_timeout', low=0.0,
        high=60.0)
    cmd_vel_timeout: float = param(
        0.25, 's', 'zero duty when no cmd_vel came for so long', low=0.02, high=60.0)
    cmd_vel_max_age: float = param(
        0.5, 's', 'cmd_vel older or further ahead is refused', low=0.02, high=60.0)
    effective_track: float = param(
        0.38, 'm', 'track that a differential drive of the same yaw rate would have', low=1e-2)
    wheel_states_timeout: float = param(
        0.5, 's', 'no duty when no wheel_states came for so long', low=0.02, high=60.0)
    max_wheel_speed: float = param(
        20.0, 'rad/s', 'fastest set point; all wheels are slowed alike', low=0.1)
    pid: PidParams = group(PidParams)
    reliability: str = param('reliable', '-', 'of the input subscriptions', choices=RELIABILITIES)
    robot: RobotParams = part(RobotParams)

    def __post_init__(self) -> None:
        if not self.cmd_vel_inputs or len(set(self.cmd_vel_inputs)) < len(self.cmd_vel_inputs):
            raise ValueError(f'cmd_vel_inputs: {list(self.cmd_vel_inputs)}, '
                             'expected one topic or more, each once')
        for name in ('cmd_vel_priorities', 'cmd_vel_timeouts'):
            if len(getattr(self, name)) != len(self.cmd_vel_inputs):
                raise ValueError(f'{name}: {list(getattr(self, name))}, expected one for each of '
                                 f'{list(self.cmd_vel_inputs)}')

    def inputs(self) -> list[tuple[str, int, float]]:
        """Return (topic, priority, time-out [s]) of each source of velocity commands."""
        return [(name, priority, timeout or self.cmd_vel_timeout)
                for name, priority, timeout in zip(
                    self.cmd_vel_inputs, self.cmd_vel_priorities, self.cmd_vel_timeouts)]
