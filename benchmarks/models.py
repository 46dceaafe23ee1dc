# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Speed of the models compared with general solvers, and the difference of their results.

Each model and the general method of scipy for the same equation are timed on the same input, one
after the other, so that their ratio is of one run.
"""

from __future__ import annotations

from collections.abc import Callable
import math
import sys
import time
from typing import Any, NamedTuple

from benchmarks.harness import main_without_options
import numpy as np
from scipy.integrate import fixed_quad, quad, solve_bvp, solve_ivp
from smart_tire.arrays import Array
from smart_tire.errors import SmartTireError
from smart_tire.models.film import elastica, elastica_with_weight, hysteresis
from smart_tire.models.tire import brush_tire, tread_film

TIME_BUDGET = 0.4   # s for the repetitions of a model; the scipy method is timed once
PERIODS = 20        # of the hysteresis input, with varying amplitude
PERIOD_SAMPLES = 1000
INPUT_AMPLITUDE = 30e-9  # C, about the maximum charge of paper A's film
TOLERANCE = 1e-6    # -, relative, of the scipy methods
FILM_COUNT = 2000   # buckled films at once
BVP_FILM_COUNT = 25  # of them solved with solve_bvp
WEIGHT = 2.0        # -, w of heavy films, large for a visible effect
SAMPLE_RATE = 400.0  # Hz, paper B, IV
ROLLING_SPEED = 0.087 * math.tau  # m/s, r w at 60 rpm
CONTACT_LENGTH, FILM_LENGTH = 0.046, 0.020  # m, paper B, Table I
SAMPLE_MARGIN = 0.03  # m of travel before and after the contact
CROSSING_COUNT = 500  # at once
MU, LOAD, STIFFNESS = 0.47, 26.7, 52.7  # -, N, N: Table I
SLIP, TOTAL_SLIP = 0.1, 0.13


class Figure(NamedTuple):
    """Rate of one model and of the scipy method for the same result."""

    what: str
    rate: float        # 1/s
    general: str       # name of the scipy method
    general_rate: float
    difference: float  # maximum, over the maximum of the result


def print_models() -> None:
    """Print rates and differences of all models."""
    print('models compared with a general method, in one run:')
    for measure in (duhem, weightless_film, heavy_film, crossings):
        for figure in measure():
            print(f'  {figure.what:35} {figure.rate:11,.0f} /s, {figure.general:9} '
                  f'{figure.general_rate:9,.1f} /s: {figure.rate / figure.general_rate:8,.0f} '
                  f'times, difference {figure.difference:.0e}')


def duhem() -> list[Figure]:
    """Return samples per second of the hysteresis, closed form and time integration."""
    params = hysteresis.TABLE_I
    t = np.arange(1, PERIODS * PERIOD_SAMPLES + 1) / PERIOD_SAMPLES

    def input_at(t: Any) -> Any:
        return INPUT_AMPLITUDE * (0.5 + 0.3 * np.sin(t / 3.0)) * np.sin(math.tau * t)

    def slope_at(t: float) -> float:
        amplitude = 0.5 + 0.3 * math.sin(t / 3.0)
        return INPUT_AMPLITUDE * (0.1 * math.cos(t / 3.0) * math.sin(math.tau * t)
                                  + amplitude * math.tau * math.cos(math.tau * t))

    def output_slope(t: float, y: Array) -> Array:
        speed = slope_at(t)
        return params.alpha * abs(speed) * (params.a * input_at(t) - y) + params.b * speed
    u = input_at(t)
    # max_step: no step may skip a corner of |u'|; the remaining difference is that of solve_ivp
    seconds, stepped = timed(lambda: solve_ivp(
        output_slope, (0.0, float(t[-1])), [0.0], t_eval=t, rtol=TOLERANCE,
        atol=TOLERANCE * INPUT_AMPLITUDE, max_step=0.05).y[0])
    best, closed = best_of(lambda: hysteresis.respond(u, params))
    return [Figure('Duhem samples', t.size / best, 'solve_ivp', t.size / seconds,
                   difference(stepped, closed))]


def weightless_film() -> list[Figure]:
    """Return charges per second of buckled films without weight."""
    strokes = np.linspace(0.02, 0.8, FILM_COUNT)
    some = strokes[::FILM_COUNT // BVP_FILM_COUNT]
    seconds, general = timed(lambda: np.array([charge_by_bvp(stroke, 0.0) for stroke in some]))
    best, closed = best_of(lambda: elastica.charge(strokes))
    return [Figure('elastica, charges', FILM_COUNT / best, 'solve_bvp', some.size / seconds,
                   difference(general, closed[::FILM_COUNT // BVP_FILM_COUNT]))]


def heavy_film() -> list[Figure]:
    """Return solutions per second of films with weight, many at once and one by one."""
    strokes = np.linspace(0.05, 0.6, FILM_COUNT)
    some = strokes[::FILM_COUNT // BVP_FILM_COUNT]
    seconds, general = timed(
        lambda: np.array([charge_by_bvp(stroke, WEIGHT) for stroke in some]))
    best, whole = best_of(lambda: elastica_with_weight.solve(strokes, WEIGHT).charge)
    single, one = best_of(lambda: np.array(
        [float(elastica_with_weight.solve(stroke, WEIGHT).charge) for stroke in some]))
    bvp_rate = some.size / seconds
    return [Figure('heavy elastica, solutions', FILM_COUNT / best, 'solve_bvp', bvp_rate,
                   difference(general, whole[::FILM_COUNT // BVP_FILM_COUNT])),
            Figure('heavy elastica, one by one', some.size / single, 'solve_bvp', bvp_rate,
                   difference(general, one))]


def charge_by_bvp(stroke: float, weight: float) -> float:
    """
    Return Q_en / K of one film from solve_bvp for A(7), A(8): theta, its slope, partial stroke.

    The initial guess is the half wave of an almost flat film.
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


def crossings() -> list[Figure]:
    """Return patch crossings per second, one by one and many at once, and by quadrature."""
    x = np.arange(-FILM_LENGTH - SAMPLE_MARGIN, CONTACT_LENGTH + SAMPLE_MARGIN,
                  ROLLING_SPEED / SAMPLE_RATE)
    critical = float(brush_tire.critical_slip(MU, LOAD, STIFFNESS))
    film: dict[str, Any] = {
        'total_slip': TOTAL_SLIP, 'critical_slip': critical, 'film_length': FILM_LENGTH,
        'contact_length': CONTACT_LENGTH, 'bending_peak': 0.83, 'bending_alpha': 67.0,
        'stretch_gain': 307.5}
    seconds, summed = timed(lambda: np.array([crossing_by_quad(position, **film)
                                              for position in x.tolist()]))
    best, volts = best_of(lambda: tread_film.crossing_voltage(x, slip=SLIP, **film))
    slips = np.linspace(-TOTAL_SLIP, TOTAL_SLIP, CROSSING_COUNT)[:, np.newaxis]
    many, _ = best_of(lambda: tread_film.crossing_voltage(x, slip=slips, **film))
    error = difference(summed, volts)
    quad_rate = 1.0 / seconds
    return [Figure(f'crossings of {x.size} samples', 1.0 / best, 'quad', quad_rate, error),
            Figure(f'crossings, {CROSSING_COUNT} at once', CROSSING_COUNT / many, 'quad',
                   quad_rate, error)]


def crossing_by_quad(x: float, *, total_slip: float, critical_slip: float, film_length: float,
                     contact_length: float, bending_peak: float, bending_alpha: float,
                     stretch_gain: float) -> float:
    """Return the voltage at one position, with the strain of B(21) integrated by scipy."""
    def strain(zeta: float) -> float:
        xi = zeta / contact_length
        return SLIP / total_slip * min(total_slip * xi, critical_slip * xi * (1.0 - xi))
    low, high = max(x, 0.0), min(x + film_length, contact_length)
    edge = (1.0 - total_slip / critical_slip) * contact_length
    overlap = 0.0
    if low < high:
        overlap = quad(strain, low, high, points=[edge] if low < edge < high else None)[0]
    bending = tread_film.bending(
        np.asarray(x), film_length, contact_length, bending_alpha).value
    return bending_peak * float(bending) + stretch_gain * overlap


def timed(work: Callable[[], Array]) -> tuple[float, Array]:
    """Return the duration [s] of ``work`` and its result."""
    begin = time.perf_counter()
    result = work()
    return time.perf_counter() - begin, result


def best_of(work: Callable[[], Array]) -> tuple[float, Array]:
    """Return the minimum duration [s] of ``work`` within the time budget, and its result."""
    end = time.perf_counter() + TIME_BUDGET
    best, result = timed(work)
    while time.perf_counter() < end:
        best = min(best, timed(work)[0])
    return best, result


def difference(general: Array, model: Array) -> float:
    """Return the maximum difference over the maximum value."""
    return float(np.abs(general - model).max() / np.abs(model).max())


if __name__ == '__main__':
    sys.exit(main_without_options(
        'models', 'measure the speed of the models, compared with general solvers', print_models))
