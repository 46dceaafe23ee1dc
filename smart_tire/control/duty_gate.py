# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Output stage: decides which duty reaches the motors, and when they stop."""

from __future__ import annotations

from collections.abc import Callable
import math
import threading

from smart_tire.control import constants as c
from smart_tire.samples import Four, NS_PER_S, STOPPED


class DutyGate:
    """
    Forwards the latest duty while it is valid and nothing stops the motors; otherwise zero.

    The motors are stopped by

    * the emergency stop, latched until it is released;
    * disarming, if ``require_arming`` is set;
    * a hold: a named cause that lasts until it is cleared, such as boards that do not respond;
    * a trip: an event, such as missing encoder counts under duty. It is latched until all holds
      are cleared and no duty other than zero was commanded for ``MIN_PAUSE_NS``: a controller
      without a reading commands zero for a moment, too;
    * the absence of commands for ``command_timeout`` [s].

    Every stop discards the active command, so a later command is always needed to move the wheels.
    Times are nanoseconds of one steady clock. All methods may be called from any thread.
    """

    def __init__(self, command_timeout: float, report: Callable[[str], None], *,
                 stopped: bool = False, require_arming: bool = False,
                 release_hold_off: float = 0.0) -> None:
        self._timeout_ns = round(command_timeout * NS_PER_S)
        self._report = report
        self._lock = threading.RLock()
        self._require_arming = require_arming
        self.emergency = stopped  # whether the emergency stop is latched
        self._hold_off_ns = round(release_hold_off * NS_PER_S)
        self._asked_ns: int | None = None  # latest request to engage or to release the stop
        self.refused_releases = 0
        self.armed = not require_arming  # always true if arming is not required
        self._holds: dict[str, str] = {}  # name -> reason
        self._trip = ''                   # reason, '' without a trip
        self._duty = STOPPED
        self.expiry_ns: int | None = None       # of the active command
        self._asked_duty_ns: int | None = None  # latest command of a duty, accepted or not
        self.timeouts = 0  # commands that expired while the motors were driven

    def reasons(self) -> list[str]:
        """Return all causes that stop the motors now, except the absence of a command."""
        with self._lock:
            found = self._held()
            if self._trip and self._trip not in found:
                found.append(f'{self._trip} (latched until commands pause)')
            found += [] if self.armed else ['not armed']
            return found

    @property
    def enabled(self) -> bool:
        """Return whether a command would move the wheels."""
        return not self.reasons()

    def command(self, duty: Four, now_ns: int) -> bool:
        """Set the duty [-1, 1] received at ``now_ns``; return whether it is accepted."""
        with self._lock:
            self._reset_trip(now_ns)
            if duty != STOPPED:
                self._asked_duty_ns = now_ns
            if not all(map(math.isfinite, duty)) or self.reasons():
                self._discard()
                return False
            self._duty, self.expiry_ns = duty, now_ns + self._timeout_ns
            return True

    def output(self, now_ns: int) -> Four:
        """Return the duty for the motors at ``now_ns``."""
        with self._lock:
            expired = self.expiry_ns is not None and now_ns > self.expiry_ns
            if expired and self._discard():
                self.timeouts += 1
                self._report('motors stopped: no motor command for '
                             f'{self._timeout_ns / NS_PER_S:g} s')
            return self._duty

    def hold(self, name: str, reason: str, *, latch: bool = False,
             report: bool = True) -> None:
        """
        Stop the motors for the cause ``name`` until it is cleared; report it once.

        With ``latch`` it is a trip, too: after it is cleared, an uninterrupted stream of commands
        remains refused.
        """
        with self._lock:
            known = name in self._holds
            self._holds[name] = reason
            self._trip = reason if latch else self._trip
            self._discard()
            if report and not known:
                self._report(f'motors stopped: {reason}')

    def clear(self, name: str) -> None:
        """Clear the hold ``name``, if it is set."""
        with self._lock:
            self._holds.pop(name, None)

    def trip(self, reason: str) -> None:
        """Stop the motors until no duty was commanded for a while; report it once."""
        with self._lock:
            known, self._trip = self._trip, reason
            self._discard()
            if not known:
                self._report(f'motors stopped: {reason}')

    def engage(self, now_ns: int) -> None:
        """Latch the emergency stop and disarm."""
        with self._lock:
            self.emergency, self._asked_ns = True, now_ns
            self.armed = not self._require_arming
            self._discard()

    def release(self, now_ns: int) -> str:
        """
        Release the emergency stop; return why that is refused, '' if it is released.

        It is refused within ``release_hold_off`` [s] after the latest engagement or request to
        release, refused ones included: a client that repeats its request does not undo a stop.
        Motion needs a new command.
        """
        with self._lock:
            before_ns, self._asked_ns = self._asked_ns, now_ns
            if before_ns is not None and now_ns - before_ns < self._hold_off_ns:
                self.refused_releases += 1
                return (f'release refused: {(now_ns - before_ns) / NS_PER_S:.2g} s after the last '
                        f'request, expected at least {self._hold_off_ns / NS_PER_S:g} s')
            self.emergency = False
            self._discard()
            return ''

    def arm(self, armed: bool) -> list[str]:
        """Arm or disarm; return the causes that prevent arming, empty on success."""
        with self._lock:
            causes = self._held()
            self.armed = (armed and not causes) or not self._require_arming
            self._discard()
            return causes if armed else []

    def _held(self) -> list[str]:
        """Return the causes that last until they are cleared."""
        return [*(['emergency stop'] if self.emergency else []), *self._holds.values()]

    def _reset_trip(self, now_ns: int) -> None:
        """Reset the trip after a pause; an uninterrupted stream of commands must not reset it."""
        asked_ns = self._asked_duty_ns
        if not self._holds and (asked_ns is None or now_ns - asked_ns > c.MIN_PAUSE_NS):
            self._trip = ''

    def _discard(self) -> bool:
        """Discard the active command; return whether it drove a motor."""
        drove = self._duty != STOPPED
        self._duty, self.expiry_ns = STOPPED, None
        return drove
