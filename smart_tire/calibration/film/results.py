"""What is told of films, contact and wheel, out of what passages have in common, and what not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
import math

import numpy as np

from smart_tire.arrays import Array
from smart_tire.calibration.film.adjustment import Adjustment
from smart_tire.calibration.film.mounting_angle import film_angle
from smart_tire.calibration.film.observations import EvidenceReader, GainObservation
from smart_tire.errors import EstimatorError
from smart_tire.numerics.robust import MAD_TO_SIGMA
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain, weighted_mean


LEAST_SLIP = 0.03    # -, below which the stretch of a passage is lost in that of the bending
SIGNIFICANT = 3.0    # sigmas, that a slip must differ from 0
FEWEST = 5           # passages of a film, below which none can be told for an outlier
WORST = 0.1          # relative standard error above which a gain or the contact length is refused
WORST_PLACE = 0.003  # m, likewise of the place of a film
OUTLIER = 3.0              # sigmas, to which bending peaks beyond are drawn


@dataclass(frozen=True, eq=False)
class FilmTold:
    """What was found of one film; what each of its n passages tells is for figures."""

    wheel: str
    film: int                # index, 0 for film 1
    gain: Uncertain | None    # V/m, film.stretch_gain; None where it was refused
    per_slip: Uncertain | None  # V per unit of slip, see ``volts_per_slip``
    bending: Uncertain        # V, film.bending_peak: mean, and its own standard error
    slip: Array              # (n,) -, of the slip estimator ...
    slip_sigma: Array        # (n,)
    stretch: Array           # (n,) V, ... and by what ``per_slip`` times slip should be, as seen
    stretch_sigma: Array     # (n,) V, of the waveform alone


@dataclass(frozen=True, eq=False)
class Waveform:
    """A passage as an example: ways [m] from the middle of the patch, and volts above rest."""

    wheel: str
    slip: float
    films: tuple[int, ...]
    way: tuple[Array, ...]
    volts: tuple[Array, ...]
    fitted: tuple[Array, ...]


@dataclass(eq=False)
class GainFit:
    """What passages tell; what they do not tell stands in ``refused`` with the reason."""

    robot: RobotParams  # with all that was found
    films: list[FilmTold] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)
    length: Uncertain | None = None  # m, of the contact
    places: dict[int, Uncertain] = field(default_factory=dict)  # m, film index -> from film 1
    angles: dict[tuple[int, str], Uncertain] = field(default_factory=dict)  # run, wheel -> rad
    passages: int = 0    # that were understood ...
    telling: int = 0     # ... those that tell gains ...
    manoeuvres: int = 0  # ... and in how many stretches of like slip
    excess: float = 1.0  # mean square of what slips are off in those, over that expected
    example: Waveform | None = None


def volts_per_slip(gain: float, film_length: float, contact_length: float) -> float:
    """
    Return the largest stretch voltage of a passage over its slip [V], in the limit of small slip.

    While all of the patch sticks the stretch is largest where the film's leading edge is at the
    patch's end, where its integral is ``slip * l (1 - l / (2 L))``.
    """
    inside = min(film_length, contact_length)
    return gain * inside * (1.0 - 0.5 * inside / contact_length)


@dataclass(frozen=True, eq=False)
class Found:
    """A combination, and what it rests on."""

    robot: RobotParams   # to which ``result`` is relative
    groups: list[tuple[int, ...]]  # of films that pass together
    reader: EvidenceReader
    result: Adjustment


class Results:
    """From what passages have in common to what is told, and what is not."""

    def __init__(self, fit: GainFit, told: Sequence[GainObservation], runs: Sequence[int],
                 found: Found) -> None:
        self._fit, self._told, self._runs, self._groups = fit, told, runs, found.groups
        self._robot, self._reader, self._result = found.robot, found.reader, found.result
        self._layout = found.result.layout

    def fill(self) -> None:
        """Fill in all that is told and refused."""
        self._lengths()
        for wheel in self._robot.film.wheels:
            for film in range(self._robot.film.count):
                self._film(wheel, film)
        self._angles()
        self._places()
        self._fit.example = self._example()

    def _lengths(self) -> None:
        fit, layout = self._fit, self._layout
        value, sigma = self._result.estimate(layout.length)
        length = self._robot.tire.contact_length * math.exp(value)
        if sigma < WORST:
            fit.length = Uncertain(length, sigma * length)
        else:
            fit.refused['contact length'] = _too_wide(sigma)

    def _film(self, wheel: str, film: int) -> None:
        name = f'gain of film {film + 1}, {wheel}'
        all_seen = [one for one in self._told if one.known.wheel == wheel and film in one.films]
        if len(all_seen) < FEWEST:
            self._fit.refused[name] = (f'seen in {len(all_seen)} passages, expected at least '
                                       f'{FEWEST}')
            return
        telling = [one for one in all_seen if one.gains]
        index = self._layout.gain(wheel, film)
        value, sigma = self._result.estimate(index)
        nominal = self._robot.film.gains(wheel)[film]
        gain = Uncertain(nominal * (1.0 + value), nominal * sigma)
        why = _untold(all_seen, telling, gain)
        if why:
            self._fit.refused[name] = why
        arms = np.array([self._stretch(one, film) for one in telling]).reshape(-1, 4).T
        self._fit.films.append(FilmTold(
            wheel, film, None if why else gain, None if why else self._per_slip(gain, index),
            middle(bendings(self._told, wheel, film)), *arms))

    def _per_slip(self, gain: Uncertain, index: int) -> Uncertain:
        """Return the volts per unit of slip with what gain and contact length leave open."""
        robot, length = self._robot, self._layout.length
        film, patch = robot.film.length, robot.tire.contact_length * math.exp(
            self._result.value[length])
        value = volts_per_slip(gain.value, film, patch)
        slopes = np.array([1.0, 0.5 * film / patch / (1.0 - 0.5 * film / patch)
                           if film < patch else 0.0])
        covariance = self._result.covariance[np.ix_([index, length], [index, length])]
        return Uncertain(value, value * math.sqrt(float(slopes @ covariance @ slopes)))

    def _stretch(self, one: GainObservation, film: int) -> tuple[float, float, float, float]:
        """Return slip, its sigma, and the stretch voltage with the sigma of the film alone."""
        layout, i, shared = self._layout, one.films.index(film), len(one.films)
        others = np.zeros(len(one.value))
        others[[shared, shared + 1]] = self._result.value[[layout.length, layout.alpha]]
        others[shared + 2:] = one.value[shared + 2:]
        pull = one.precision @ (one.value - others)
        gains = np.linalg.inv(one.precision[:shared, :shared])
        gain = 1.0 + float((gains @ pull[:shared])[i])
        slip, sigma = one.known.slip
        unit = volts_per_slip(self._robot.film.gains(one.known.wheel)[film],
                              self._robot.film.length, self._robot.tire.contact_length)
        return (slip, sigma, unit * gain * slip,
                unit * abs(slip) * math.sqrt(float(gains[i, i])))

    def _angles(self) -> None:
        for run in sorted(set(self._runs)):
            for wheel in self._robot.film.wheels:
                try:
                    self._fit.angles[run, wheel] = self._angle(run, wheel)
                except EstimatorError as error:
                    self._fit.refused[f'angle of film 1, {wheel}'] = str(error)

    def _angle(self, run: int, wheel: str) -> Uncertain:
        """Return the angle of film 1; EstimatorError."""
        seen = self._seen(run, wheel, 0)
        found = film_angle([angle for _, angle, _ in seen], [speed for _, _, speed in seen])
        count = math.tau / self._robot.encoder.counts_per_revolution  # rad; a count begins or ends
        return replace(found, sigma=math.hypot(found.sigma, count / math.sqrt(12.0)))

    def _seen(self, run: int, wheel: str, group: int) -> list[tuple[int, float, float]]:
        """Return stamp [ns], angle of a group's first film [rad] and speed [rad/s] of passages."""
        radius, places = self._robot.wheel_radius, self._robot.film.places
        members, found = self._groups[group], []
        for one, number in zip(self._told, self._runs):
            known = one.known
            if number == run and known.wheel == wheel and one.films[0] in members:
                way = one.place - (places[one.films[0]] - places[members[0]])
                found.append((known.stamp_ns, known.origin + way / radius,
                              known.direction * known.speed / radius))
        return found

    def _places(self) -> None:
        """Tell places within groups from single passages, between groups from their angles."""
        robot = self._robot
        for number, group in enumerate(self._groups):
            begin = Uncertain(0.0, 0.0)
            if number:
                try:
                    begin = self._between(number)
                except EstimatorError as error:
                    self._fit.refused[f'spacing, film 1 to {group[0] + 1}'] = str(error)
                    continue
                self._fit.places[group[0]] = begin
            for film in group[1:]:
                off = apart(self._result, film, group[0])
                if off.sigma > WORST_PLACE:
                    self._fit.refused[f'spacing, film 1 to {film + 1}'] = (
                        f'never seen together with film {group[0] + 1} in a passage')
                    continue
                inside = robot.film.places[film] - robot.film.places[group[0]]
                self._fit.places[film] = Uncertain(
                    begin.value + inside + off.value, math.hypot(begin.sigma, off.sigma))

    def _between(self, group: int) -> Uncertain:
        """Return how far [m] a group's first film is from film 1; EstimatorError."""
        radius, parts = self._robot.wheel_radius, []
        for run, wheel in self._fit.angles:
            firsts = self._seen(run, wheel, 0)
            # from the passage next to each: lateness of stamps is the same in both
            pairs = [(one, min(firsts, key=lambda first: abs(first[0] - one[0])))
                     for one in self._seen(run, wheel, group)]
            apart = film_angle([one[1] - first[1] for one, first in pairs],
                               [one[2] - first[2] for one, first in pairs])
            parts.append(Uncertain(radius * apart.value, radius * apart.sigma))
        if not parts:
            raise EstimatorError('needs the angle of film 1')
        mean = weighted_mean(parts)
        return replace(mean, sigma=math.hypot(
            mean.sigma, self._robot.wheel_radius_sigma * mean.value))

    def _example(self) -> Waveform | None:
        """Return a passage of many films whose slip is large, yet no extreme."""
        telling = [one for one in self._told if one.gains]
        if not telling:
            return None
        most = max(len(one.films) for one in telling)
        telling = sorted((one for one in telling if len(one.films) == most),
                         key=lambda one: abs(one.known.slip[0]))
        one = telling[(3 * len(telling)) // 4]
        films = one.fit.passage.films
        middle = float(np.mean([one.fit.passage.sightings[i].middle for i in range(len(films))]))
        return Waveform(
            one.known.wheel, one.known.slip[0], one.films,
            tuple(film.distance - middle for film in films),
            tuple(film.volts for film in films), tuple(self._reader.volts(one)))


def _too_wide(sigma: float) -> str:
    return f'standard error of {sigma:.0%}, expected at most {WORST:.0%}'


def _untold(seen: Sequence[GainObservation], telling: Sequence[GainObservation],
            gain: Uncertain) -> str:
    """Return why a gain is refused, '' where it is not."""
    if len(telling) < FEWEST:
        slip, sigma = max((one.known.slip for one in seen), key=lambda slip: abs(slip[0]))
        return (f'{len(telling)} of {len(seen)} passages with a slip above {LEAST_SLIP:g} and '
                f'{SIGNIFICANT:g} times its sigma, expected at least {FEWEST}; the largest is '
                f'{slip:.3f} ± {sigma:.3f}: turn, accelerate and brake')
    if gain.value <= 0.0:
        return ('comes out negative: the poles of the film, or the direction in which it passes, '
                'are the other way round')
    if gain.sigma > WORST * gain.value:
        return (f'{_too_wide(gain.sigma / gain.value)}: the slip is not known well enough; '
                'turn both ways')
    return ''


def bendings(told: Sequence[GainObservation], wheel: str, film: int) -> list[float]:
    return [one.bending[one.films.index(film)] for one in told
            if one.known.wheel == wheel and film in one.films]


def middle(values: Sequence[float]) -> Uncertain:
    """Return the mean with its standard error; values far off count as if they were nearer."""
    median = float(np.median(values))
    spread = MAD_TO_SIGMA * float(np.median(np.abs(np.asarray(values) - median)))
    near = np.clip(values, median - OUTLIER * spread, median + OUTLIER * spread)
    return Uncertain(float(np.mean(near)), float(np.std(near, ddof=1)) / math.sqrt(len(near))
                    if len(near) > 1 else math.inf)


def apart(result: Adjustment, film: int, first: int) -> Uncertain:
    """Return the place of a film beyond the nominal one [m], seen from another."""
    both = [result.layout.place(film), result.layout.place(first)]
    variance = np.array([1.0, -1.0]) @ result.covariance[np.ix_(both, both)] @ [1.0, -1.0]
    return Uncertain(float(result.value[both[0]] - result.value[both[1]]),
                    math.sqrt(max(float(variance), 0.0)))
