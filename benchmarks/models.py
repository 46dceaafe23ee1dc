"""
Speed of the models against general solvers, and how closely both agree.

Each model is timed against scipy's general method for the same equation on the same input, one
after the other; rates and ratios of one run belong together, and so does the largest difference
between the two results.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math
import sys
import time
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import fixed_quad, quad, solve_bvp, solve_ivp
from benchmarks.command import machine, no_arguments, reported
from smart_tire.arrays import Array
from smart_tire.errors import SmartTireError
from smart_tire.models.film import elastica, elastica_with_weight, hysteresis
from smart_tire.models.tire import brush_tire, tread_film


BUDGET = 0.4        # s for the repetitions of a model; scipy's way is timed once
PERIODS = 20        # of the input of the hysteresis, in three amplitudes
SAMPLES = 1000      # per period
INPUT_SIZE = 30e-9  # C, about the largest charge of paper A's film
TOLERANCE = 1e-6    # of scipy's methods, relative
FILMS = 2000        # buckled films at once
BVP_FILMS = 25      # of them with solve_bvp
WEIGHT = 2.0        # w of the heavy ones, for its effect to show; the paper's films have less
RATE = 400.0        # Hz, paper B, IV
SPEED = 0.087 * math.tau  # m/s, r w at 60 rpm
CONTACT, FILM = 0.046, 0.020  # m, paper B, Table I
AFTER = 0.03        # m of travel before and after the contact
PASSAGES = 500      # at once
MU, LOAD, STIFFNESS = 0.47, 26.7, 52.7  # -, N, N: Table I
SLIP, TOTAL_SLIP = 0.1, 0.13


class Figure(NamedTuple):
    """Rates of one model, and of scipy's way to the same result."""

    what: str
    rate: float        # 1/s
    general: str       # the name of scipy's method
    general_rate: float
    difference: float  # the largest, over the result's largest value


def main(argv: Sequence[str] | None = None) -> int:
    """Print the figures; return the exit status."""
    no_arguments('models', 'measure the speed of the models against general solvers', argv)
    print(machine())
    return reported('models', print_models)


def print_models() -> None:
    """Print all figures on the models."""
    print('models against the general method, in one run:')
    for measure in (duhem, weightless_film, heavy_film, passages):
        for figure in measure():
            print(f'  {figure.what:35} {figure.rate:11,.0f} /s, {figure.general:9} '
                  f'{figure.general_rate:9,.1f} /s: {figure.rate / figure.general_rate:8,.0f} '
                  f'times, differ by {figure.difference:.0e}')


def duhem() -> list[Figure]:
    """Return samples per second of the hysteresis, closed form against time steps."""
    params = hysteresis.TABLE_I
    t = np.arange(1, PERIODS * SAMPLES + 1) / SAMPLES

    def input_at(t: Any) -> Any:
        return INPUT_SIZE * (0.5 + 0.3 * np.sin(t / 3.0)) * np.sin(math.tau * t)

    def slope_at(t: float) -> float:
        grown = 0.5 + 0.3 * math.sin(t / 3.0)
        return INPUT_SIZE * (0.1 * math.cos(t / 3.0) * math.sin(math.tau * t)
                             + grown * math.tau * math.cos(math.tau * t))

    def output_slope(t: float, y: Array) -> Array:
        speed = slope_at(t)
        return params.alpha * abs(speed) * (params.a * input_at(t) - y) + params.b * speed
    u = input_at(t)
    # so that no step jumps over a corner of |u'|; where they differ it is solve_ivp that errs
    seconds, stepped = timed(lambda: solve_ivp(
        output_slope, (0.0, float(t[-1])), [0.0], t_eval=t, rtol=TOLERANCE,
        atol=TOLERANCE * INPUT_SIZE, max_step=0.05).y[0])
    best, closed = best_of(lambda: hysteresis.respond(u, params))
    return [Figure('Duhem samples', t.size / best, 'solve_ivp', t.size / seconds,
                   difference(stepped, closed))]


def weightless_film() -> list[Figure]:
    """Return charges per second of buckled films without weight."""
    strokes = np.linspace(0.02, 0.8, FILMS)
    some = strokes[::FILMS // BVP_FILMS]
    seconds, general = timed(lambda: np.array([charge_by_bvp(stroke, 0.0) for stroke in some]))
    best, closed = best_of(lambda: elastica.charge(strokes))
    return [Figure('elastica, charges', FILMS / best, 'solve_bvp', some.size / seconds,
                   difference(general, closed[::FILMS // BVP_FILMS]))]


def heavy_film() -> list[Figure]:
    """Return solutions per second of buckled films with weight, many at once and one by one."""
    strokes = np.linspace(0.05, 0.6, FILMS)
    some = strokes[::FILMS // BVP_FILMS]
    seconds, general = timed(
        lambda: np.array([charge_by_bvp(stroke, WEIGHT) for stroke in some]))
    best, whole = best_of(lambda: elastica_with_weight.solve(strokes, WEIGHT).charge)
    single, one = best_of(lambda: np.array(
        [float(elastica_with_weight.solve(stroke, WEIGHT).charge) for stroke in some]))
    return [Figure('heavy elastica, solutions', FILMS / best, 'solve_bvp', some.size / seconds,
                   difference(general, whole[::FILMS // BVP_FILMS])),
            Figure('heavy elastica, one by one', some.size / single, 'solve_bvp',
                   some.size / seconds, difference(general, one))]


def charge_by_bvp(stroke: float, weight: float) -> float:
    """
    Return Q_en / K of one film by scipy: A(7), A(8) for theta, its slope, and the stroke so far.

    The first guess is the half wave that a flat film buckles into.
    """
    s = np.linspace(0.0, 1.0, 21)
    size = 2.0 * math.sqrt(stroke)
    guess = np.array([size * np.sin(np.pi * s), size * np.pi * np.cos(np.pi * s), stroke * s])

    def slopes(s: Array, y: Array, p: Array) -> Array:
        sine, cosine = np.sin(y[0]), np.cos(y[0])
        return np.array([y[1], weight * s * cosine - p[0] * sine, 1.0 - cosine])

    def ends(begin: Array, end: Array, p: Array) -> Array:
        return np.array([begin[0], end[0], begin[2], end[2] - stroke])
    solution = solve_bvp(slopes, ends, s, guess, p=[np.pi**2], tol=TOLERANCE)
    if not solution.success:
        raise SmartTireError(f'solve_bvp: stroke {stroke}, weight {weight}: {solution.message}')
    lift = weight * fixed_quad(lambda s: s * np.sin(solution.sol(s)[0]), 0.0, 1.0, n=20)[0]
    return float((solution.p[0] * (1.0 - stroke) + lift) / np.pi**2 - 1.0)


def passages() -> list[Figure]:
    """Return whole passages per second, one by one and many at once, against quadrature."""
    x = np.arange(-FILM - AFTER, CONTACT + AFTER, SPEED / RATE)
    critical = float(brush_tire.critical_slip(MU, LOAD, STIFFNESS))
    rest: dict[str, Any] = {
        'total_slip': TOTAL_SLIP, 'critical_slip': critical, 'film_length': FILM,
        'contact_length': CONTACT, 'bending_peak': 0.83, 'bending_alpha': 67.0,
        'stretch_gain': 307.5}
    seconds, summed = timed(lambda: np.array([passage_by_quad(place, **rest)
                                              for place in x.tolist()]))
    best, volts = best_of(lambda: tread_film.crossing_voltage(x, slip=SLIP, **rest))
    slips = np.linspace(-TOTAL_SLIP, TOTAL_SLIP, PASSAGES)[:, np.newaxis]
    many, _ = best_of(lambda: tread_film.crossing_voltage(x, slip=slips, **rest))
    apart = difference(summed, volts)
    return [Figure(f'film passages of {x.size} samples', 1.0 / best, 'quad', 1.0 / seconds,
                   apart),
            Figure(f'film passages, {PASSAGES} at once', PASSAGES / many, 'quad', 1.0 / seconds,
                   apart)]


def passage_by_quad(x: float, *, total_slip: float, critical_slip: float, film_length: float,
                    contact_length: float, bending_peak: float, bending_alpha: float,
                    stretch_gain: float) -> float:
    """Return one sample of a passage, with the strain of B(21) summed by scipy."""
    def strain(zeta: float) -> float:
        xi = zeta / contact_length
        return SLIP / total_slip * min(total_slip * xi, critical_slip * xi * (1.0 - xi))
    low, high = max(x, 0.0), min(x + film_length, contact_length)
    edge = (1.0 - total_slip / critical_slip) * contact_length
    stretch = 0.0
    if low < high:
        stretch = quad(strain, low, high, points=[edge] if low < edge < high else None)[0]
    bending = tread_film.bending(
        np.asarray(x), film_length, contact_length, bending_alpha).value
    return bending_peak * float(bending) + stretch_gain * stretch


def timed(work: Callable[[], Array]) -> tuple[float, Array]:
    """Return the seconds that ``work`` takes, and its result."""
    begin = time.perf_counter()
    result = work()
    return time.perf_counter() - begin, result


def best_of(work: Callable[[], Array]) -> tuple[float, Array]:
    """Return the shortest time of ``work`` within the budget, and its result."""
    end = time.perf_counter() + BUDGET
    best, result = timed(work)
    while time.perf_counter() < end:
        best = min(best, timed(work)[0])
    return best, result


def difference(general: Array, model: Array) -> float:
    """Return the largest difference, over the largest value."""
    return float(np.abs(general - model).max() / np.abs(model).max())


if __name__ == '__main__':
    sys.exit(main())
