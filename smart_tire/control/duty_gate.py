"""The output stage: which duty may go to the motors, and what stops them."""

from __future__ import annotations

from collections.abc import Callable
import math
import threading

from smart_tire.samples import Four, NS_PER_S

STOPPED: Four = (0.0, 0.0, 0.0, 0.0)
PAUSE_NS = NS_PER_S  # without commands, which ends a trip: no stream of them has such a gap


class DutyGate:
    """
    Passes the newest duty on while it is fresh and nothing stops the motors; otherwise zero.

    The motors are stopped by

    * the emergency stop, latched until it is released;
    * being disarmed, where ``require_arming`` asks for arming;
    * a hold: a named cause that lasts until it is cleared, such as boards that do not answer;
    * a trip: an event, such as an encoder that stands still under duty. It stays latched until
      all holds are cleared and commands were zero, or absent for ``PAUSE_NS``, once;
    * the lack of a command for ``command_timeout`` [s].

    Each of them discards the command in force, so that it always takes a later one to move the
    wheels. Times are nanoseconds of one steady clock. All methods may be called from any thread.
    """

    def __init__(self, command_timeout: float, report: Callable[[str], None], *,
                 stopped: bool = False, require_arming: bool = False) -> None:
        self._timeout_ns = round(command_timeout * NS_PER_S)
        self._timeout = command_timeout
        self._report = report
        self._lock = threading.RLock()
        self._require_arming = require_arming
        self._emergency = stopped
        self._armed = not require_arming
        self._holds: dict[str, str] = {}  # name -> reason
        self._trip = ''                   # reason, '' while there is none
        self._duty = STOPPED
        self._expires_ns: int | None = None  # of the command in force
        self._heard_ns: int | None = None    # the latest command, obeyed or not
        self.timeouts = 0  # times that commands ceased while the motors were driven

    @property
    def emergency(self) -> bool:
        """Return whether the emergency stop is latched."""
        return self._emergency

    @property
    def armed(self) -> bool:
        """Return whether the motors are armed; always, where no arming is required."""
        return self._armed

    def reasons(self) -> list[str]:
        """Return everything that stops the motors now, except the lack of a command."""
        with self._lock:
            found = ['emergency stop'] if self._emergency else []
            found += list(self._holds.values())
            if self._trip and self._trip not in found:
                found.append(f'{self._trip} (latched until commands pause)')
            found += [] if self._armed else ['not armed']
            return found

    @property
    def enabled(self) -> bool:
        """Return whether a command would move the wheels."""
        return not self.reasons()

    def command(self, duty: Four, now_ns: int) -> bool:
        """Take a duty [-1, 1] that came at ``now_ns``; return whether it is in force."""
        with self._lock:
            self._reset_trip(duty, now_ns)
            self._heard_ns = now_ns
            if not all(map(math.isfinite, duty)) or self.reasons():
                self._discard()
                return False
            self._duty, self._expires_ns = duty, now_ns + self._timeout_ns
            return True

    def output(self, now_ns: int) -> Four:
        """Return the duty for the motors at ``now_ns``."""
        with self._lock:
            expired = self._expires_ns is not None and now_ns > self._expires_ns
            if expired and self._discard():
                self.timeouts += 1
                self._report(f'motors stopped: no motor command for {self._timeout:g} s')
            return self._duty

    @property
    def expiry_ns(self) -> int | None:
        """Return when the command in force expires, None if there is none."""
        return self._expires_ns

    def hold(self, name: str, reason: str, *, latch: bool = False,
             report: bool = True) -> None:
        """
        Stop the motors for the cause ``name`` until it is cleared; report it once.

        With ``latch`` it is a trip as well: clearing it does not let an unbroken stream of
        commands go on.
        """
        with self._lock:
            known = name in self._holds
            self._holds[name] = reason
            self._trip = reason if latch else self._trip
            self._discard()
            if report and not known:
                self._report(f'motors stopped: {reason}')

    def clear(self, name: str) -> None:
        """End the hold for the cause ``name``, if there is one."""
        with self._lock:
            self._holds.pop(name, None)

    def trip(self, reason: str) -> None:
        """Stop the motors until commands were zero or absent; report it once."""
        with self._lock:
            known, self._trip = self._trip, reason
            self._discard()
            if not known:
                self._report(f'motors stopped: {reason}')

    def engage(self) -> None:
        """Latch the emergency stop, which disarms as well."""
        with self._lock:
            self._emergency = True
            self._armed = not self._require_arming
            self._discard()

    def release(self) -> None:
        """Release the emergency stop; the wheels wait for the next command."""
        with self._lock:
            self._emergency = False
            self._discard()

    def arm(self, armed: bool) -> list[str]:
        """Arm or disarm; return why it cannot be armed, nothing if it could."""
        with self._lock:
            against = [*self._holds.values()]
            if self._emergency:
                against.insert(0, 'emergency stop')
            self._armed = (armed and not against) or not self._require_arming
            self._discard()
            return against if armed else []

    def _reset_trip(self, duty: Four, now_ns: int) -> None:
        """Forget a trip once commands pause: an unbroken stream of them must not retry it."""
        pause = self._heard_ns is None or now_ns - self._heard_ns > PAUSE_NS
        if not self._holds and (pause or duty == STOPPED):
            self._trip = ''

    def _discard(self) -> bool:
        """Drop the command in force; return whether it drove a motor."""
        drove = self._duty != STOPPED
        self._duty, self._expires_ns = STOPPED, None
        return drove
