"""
Contacts of the films of one wheel: stretches of travel in which a film was active.

Activity is a charge that differs from rest, of either sign, followed over the rolled distance
and not over time: a contact ends when the film was watched at rest for some millimetres, or
when the wheel turns round. Noise, bumps and waiting make none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.arrays import Array
from smart_tire.samples import NS_PER_S

Instants = NDArray[np.int64]

QUIET = 0.035         # m of watched rest that end a contact; hard braking feigns it for 26 mm
BEFORE = 0.050        # m of travel kept before a contact's first active sample: entry, bump ...
AFTER = 0.030         # m ... and behind the last: bump, recovery
STANDING = 0.002      # m/s; below, the wheel stands and a sample tells nothing new
STUCK = 2.5           # contact lengths of activity that no contact explains: the rest has moved
REST_MEMORY = 0.1     # share of a new median in the tracked rest voltage
FEWEST_QUIET = 8      # samples for a median
LOST_STEP = 2.5       # sample periods; a longer step between stamps is a gap
KEPT = 5.0            # contact lengths of travel kept
KEPT_GAPS = 64


@dataclass(frozen=True, slots=True, eq=False)
class ActiveSegment:
    """What one film gave while it was active and the wheel rolled one way."""

    film: int           # index, 0 for film 1
    begin_ns: int       # first active sample
    end_ns: int         # last active sample
    instants: Instants  # ns, of the samples, with some travel before and after
    volts: Array        # V, as sampled
    rest: float         # V


@dataclass(slots=True)
class _OpenSegment:
    """A contact that has not ended."""

    begin_ns: int
    end_ns: int
    begin: float   # m, watched travel at the first active sample
    end: float     # m, likewise at the last
    since_ns: int  # the last turn; what came before belongs to another contact


class SegmentExtractor:
    """
    Recent samples of one wheel's films, and the contacts in them.

    ``thresholds`` [V] say for each film what is active; ``rest`` [V] is followed from there. For
    the record the wheel stands still while it does not roll: what is sampled then is dropped,
    however long the robot waits with a film in the patch. ``contact`` [m] is the travel of a
    film from entry to release.
    """

    def __init__(self, thresholds: Sequence[float], rest: float, period_ns: int,
                 contact: float) -> None:
        films = len(thresholds)
        self._thresholds = np.asarray(thresholds, dtype=float)
        self._period_ns = period_ns
        self._contact = contact
        self._rest = np.full(films, rest)
        self._instants: Instants = np.empty(0, dtype=np.int64)
        self._volts: Array = np.empty((0, films))
        self._watched: Array = np.empty(0)  # m, travel up to each sample without that in gaps
        self._activities: list[_OpenSegment | None] = [None] * films
        self._gaps: list[tuple[int, int]] = []
        self._last: tuple[int, float] | None = None  # instant and place of the newest sample
        self._turn_ns = 0  # newest turn of the wheel
        self.stuck = 0  # times that a film was active for longer than a contact is

    def add(self, instants: Instants, places: Array, volts: Array,
            turns: Sequence[int]) -> list[ActiveSegment]:
        """
        Take in samples and return the contacts that end with them.

        ``places`` (n,) [m] is the rolled distance at ``instants`` (n,) [ns], ``volts`` is
        (n, films). ``turns`` [ns] are instants when the wheel turned round, up to the last
        sample, and not before the turns of earlier calls.
        """
        contacts: list[ActiveSegment] = []
        for turn_ns in turns:
            split = int(np.searchsorted(instants, turn_ns, side='right'))
            contacts += self._append(instants[:split], places[:split], volts[:split])
            instants, places, volts = instants[split:], places[split:], volts[split:]
            contacts += self._turn(turn_ns)
        return contacts + self._append(instants, places, volts)

    def finish(self) -> list[ActiveSegment]:
        """End all contacts: the films are known to have left the patch."""
        contacts = []
        for film in range(len(self._rest)):
            contacts += self._settle(film, math.inf, 0.0)
        return contacts

    @property
    def active(self) -> bool:
        """Whether the contact of a film has not ended."""
        return any(activity is not None for activity in self._activities)

    def lost(self, begin_ns: int, end_ns: int) -> float:
        """Return the share of the time between two instants that no sample covers."""
        if self._last is None:
            return 1.0
        missing = sum(max(0, min(end, end_ns) - max(begin, begin_ns))
                      for begin, end in [*self._gaps, (self._last[0], end_ns)])
        return missing / max(end_ns - begin_ns, 1)

    def _append(self, instants: Instants, places: Array, volts: Array) -> list[ActiveSegment]:
        if not len(instants):
            return []
        last = self._last
        if last is None:  # nothing is known of the time before
            last = int(instants[0]), float(places[0])
            self._gaps.append((0, last[0]))
        elapsed, steps = np.empty(len(instants), dtype=np.int64), np.empty(len(instants))
        elapsed[0], steps[0] = instants[0] - last[0], places[0] - last[1]
        np.subtract(instants[1:], instants[:-1], out=elapsed[1:])
        np.subtract(places[1:], places[:-1], out=steps[1:])
        steps = np.abs(steps)
        self._last = int(instants[-1]), float(places[-1])
        rolling = steps > (STANDING / NS_PER_S) * elapsed
        if elapsed.max() > LOST_STEP * self._period_ns:
            lost = elapsed > LOST_STEP * self._period_ns
            self._gaps += [(int(instants[i] - elapsed[i]), int(instants[i]))
                           for i in lost.nonzero()[0]]
            del self._gaps[:-KEPT_GAPS]
            rolling |= lost
            steps[lost] = 0.0
        watched = steps.cumsum()
        if len(self._watched):
            watched += self._watched[-1]
        if not rolling.all():
            instants, volts, watched = instants[rolling], volts[rolling], watched[rolling]
            if not len(instants):
                return []
        self._instants = np.concatenate([self._instants, instants])
        self._volts = np.concatenate([self._volts, volts])
        self._watched = np.concatenate([self._watched, watched])
        contacts = self._follow(instants, volts, watched)
        self._forget(float(watched[-1]) - KEPT * self._contact)
        return contacts

    def _forget(self, before: float) -> None:
        old = int(self._watched.searchsorted(before))
        self._instants, self._volts = self._instants[old:], self._volts[old:]
        self._watched = self._watched[old:]

    def _follow(self, instants: Instants, volts: Array, watched: Array) -> list[ActiveSegment]:
        contacts = []
        charge = volts - self._rest
        active = np.abs(charge) > self._thresholds
        for film, seen in enumerate(active.any(axis=0).tolist()):
            if not seen and self._activities[film] is None:
                self._track_rest(film, charge[:, film])
                continue
            for first, last in _runs(active[:, film].nonzero()[0], watched) if seen else ():
                contacts += self._settle(film, float(watched[first]), QUIET)
                self._extend(film, int(instants[first]), float(watched[first]))
                self._extend(film, int(instants[last]), float(watched[last]))
            contacts += self._settle(film, float(watched[-1]), QUIET)
        return contacts

    def _track_rest(self, film: int, charge: Array) -> None:
        if len(charge) >= FEWEST_QUIET:
            # the median, by hand: NumPy's takes ten times as long
            ordered = np.sort(charge)
            middle = 0.5 * (ordered[(len(charge) - 1) // 2] + ordered[len(charge) // 2])
            if math.isfinite(middle):  # a film may be absent
                self._rest[film] += REST_MEMORY * float(middle)

    def _extend(self, film: int, instant: int, watched: float) -> None:
        activity = self._activities[film]
        if activity is None:
            self._activities[film] = _OpenSegment(
                instant, instant, watched, watched, self._turn_ns)
            return
        activity.end_ns, activity.end = instant, watched
        if watched - activity.begin > STUCK * self._contact:
            # longer than any contact: what was taken for rest no longer is
            self._rest[film] = float(np.median(self._volts[:, film]))
            self._activities[film] = None
            self.stuck += 1

    def _settle(self, film: int, watched: float, quiet: float) -> list[ActiveSegment]:
        """End the film's contact if it has been at rest for ``quiet`` [m]."""
        activity = self._activities[film]
        if activity is None or watched - activity.end <= quiet:
            return []
        self._activities[film] = None
        return [self._contact_of(film, activity, activity.end + AFTER)]

    def _turn(self, turn_ns: int) -> list[ActiveSegment]:
        """End every contact where the wheel turned round; what was active later is another."""
        contacts = []
        self._turn_ns = turn_ns
        at = int(np.searchsorted(self._instants, turn_ns, side='right')) - 1
        if at < 0:
            return []
        place = float(self._watched[at])
        for film, activity in enumerate(self._activities):
            if activity is None or activity.begin_ns > turn_ns:
                continue
            self._activities[film] = None
            if activity.end_ns > turn_ns:
                self._activities[film] = _OpenSegment(
                    turn_ns, activity.end_ns, place, activity.end, turn_ns)
                activity.end_ns, activity.end = turn_ns, place
            contacts.append(self._contact_of(film, activity, place))
        return contacts

    def _contact_of(self, film: int, activity: _OpenSegment, until: float) -> ActiveSegment:
        low, high = np.searchsorted(self._watched, [activity.begin - BEFORE, until + 1e-9])
        low = max(int(low), int(np.searchsorted(self._instants, activity.since_ns)))
        return ActiveSegment(film, activity.begin_ns, activity.end_ns, self._instants[low:high],
                       self._volts[low:high, film], float(self._rest[film]))


def _runs(indices: NDArray[np.intp], watched: Array) -> list[tuple[int, int]]:
    """Return first and last of the ``indices`` (n,) of active samples that no rest divides."""
    places = watched[indices]
    rests = (places[1:] - places[:-1] > QUIET).nonzero()[0]
    firsts = indices[[0, *(rests + 1)]]
    lasts = indices[[*rests, -1]]
    return list(zip(firsts.tolist(), lasts.tolist()))
