"""Four duties from wanted and measured wheel speeds, and when to stop."""

from __future__ import annotations

from collections.abc import Sequence
import math

from smart_tire.control.pid import Pid
from smart_tire.parameters.tuning import WheelControllerParams
from smart_tire.samples import Four, NS_PER_S

STOPPED: Four = (0.0, 0.0, 0.0, 0.0)
MAX_STEPS = 4     # a longer pause between two control steps is counted as so many periods
STANDSTILL = 0.1  # rad/s; below, a wheel that shall stand gets no duty


class WheelControl:
    """
    The control loop without its clock: all times are nanoseconds of one steady clock.

    The motors get no duty at all without set points, without wheel speeds for
    ``wheel_states_timeout``, and while the emergency stop is engaged.
    """

    def __init__(self, params: WheelControllerParams) -> None:
        self._pids = [Pid(params.pid) for _ in STOPPED]
        self._measured = STOPPED
        self._measured_ns: int | None = None
        self._stepped_ns: int | None = None
        self.stopped = False  # by the emergency stop
        self.applied = True   # whether the duties reach the motors
        self.retune(params)

    def retune(self, params: WheelControllerParams) -> None:
        """Use other parameters from now on."""
        self._params = params
        for pid in self._pids:
            pid.params = params.pid

    def measure(self, velocity: Four, now_ns: int) -> None:
        """Take the speeds of the wheels [rad/s]."""
        self._measured, self._measured_ns = velocity, now_ns

    def forget_measurement(self) -> None:
        """Count the speeds of the wheels as unknown."""
        self._measured_ns = None

    def measured(self, now_ns: int) -> bool:
        """Return whether the speeds of the wheels are known."""
        return (self._measured_ns is not None
                and now_ns - self._measured_ns
                <= math.ceil(self._params.wheel_states_timeout * NS_PER_S))

    def step(self, velocity: Sequence[float] | None, now_ns: int) -> tuple[Four, Four]:
        """
        Return the set points of the wheel speeds [rad/s] and the duties [-1, 1].

        ``velocity`` [rad/s] are the wanted speeds, None if there is no command in force; where
        one is too fast, all are slowed alike. While the duties are not applied, the controllers
        start over in every step, so that no integral winds up meanwhile.
        """
        dt = self._elapsed(now_ns)
        driven = velocity is not None and not self.stopped
        wanted = self._limited(velocity) if velocity is not None and driven else STOPPED
        if not driven or not self.measured(now_ns):
            self._reset()
            return wanted, STOPPED
        if not self.applied:
            self._reset()
        a, b, c, d = (_duty(*wheel, dt) for wheel in zip(self._pids, wanted, self._measured))
        return wanted, (a, b, c, d)

    def _reset(self) -> None:
        for pid in self._pids:
            pid.reset()

    def _limited(self, velocity: Sequence[float]) -> Four:
        fastest = max(max(map(abs, velocity)) / self._params.max_wheel_speed, 1.0)
        a, b, c, d = (speed / fastest for speed in velocity)
        return a, b, c, d

    def _elapsed(self, now_ns: int) -> float:
        period = 1.0 / self._params.rate
        before, self._stepped_ns = self._stepped_ns, now_ns
        if before is None or now_ns <= before:
            return period
        return min((now_ns - before) / NS_PER_S, MAX_STEPS * period)


def _duty(pid: Pid, wanted: float, measured: float, dt: float) -> float:
    if wanted == 0.0 and abs(measured) < STANDSTILL:
        pid.reset()
        return 0.0
    return pid.update(wanted, measured, dt)
