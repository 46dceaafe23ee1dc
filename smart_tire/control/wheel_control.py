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

    Without a command for ``cmd_vel_timeout`` the wheels are brought to a stop. Without
    wheel speeds for ``wheel_states_timeout``, and while the emergency stop is latched, the
    motors get no duty at all.
    """

    def __init__(self, params: WheelControllerParams) -> None:
        self._pids = [Pid(params.pid) for _ in STOPPED]
        self._command = STOPPED
        self._commanded_ns: int | None = None
        self._measured = STOPPED
        self._measured_ns: int | None = None
        self._stepped_ns: int | None = None
        self.stopped = False  # by the emergency stop
        self.retune(params)

    def retune(self, params: WheelControllerParams) -> None:
        """Use other parameters from now on."""
        self._params = params
        for pid in self._pids:
            pid.params = params.pid

    def command(self, velocity: Sequence[float], now_ns: int) -> None:
        """Take the wanted speeds of the wheels [rad/s]; where one is too fast, all are slowed."""
        fastest = max(max(map(abs, velocity)) / self._params.max_wheel_speed, 1.0)
        a, b, c, d = (speed / fastest for speed in velocity)
        self._command, self._commanded_ns = (a, b, c, d), now_ns

    def measure(self, velocity: Four, now_ns: int) -> None:
        """Take the speeds of the wheels [rad/s]."""
        self._measured, self._measured_ns = velocity, now_ns

    def emergency_stop(self, engaged: bool) -> None:
        """Latch or release the emergency stop; what was commanded before it is forgotten."""
        self.stopped = engaged
        self._commanded_ns = None

    def commanded(self, now_ns: int) -> bool:
        """Return whether a command is in force."""
        return not self.stopped and _fresh(
            self._commanded_ns, now_ns, self._params.cmd_vel_timeout)

    def measured(self, now_ns: int) -> bool:
        """Return whether the speeds of the wheels are known."""
        return _fresh(self._measured_ns, now_ns, self._params.wheel_states_timeout)

    def step(self, now_ns: int) -> tuple[Four, Four]:
        """Return the set points of the wheel speeds [rad/s] and the duties [-1, 1]."""
        dt = self._elapsed(now_ns)
        wanted = self._command if self.commanded(now_ns) else STOPPED
        if self.stopped or not self.measured(now_ns):
            for pid in self._pids:
                pid.reset()
            return wanted, STOPPED
        a, b, c, d = (_duty(*wheel, dt) for wheel in zip(self._pids, wanted, self._measured))
        return wanted, (a, b, c, d)

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


def _fresh(stamp_ns: int | None, now_ns: int, timeout: float) -> bool:
    return stamp_ns is not None and now_ns - stamp_ns <= math.ceil(timeout * NS_PER_S)
