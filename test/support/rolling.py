# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A wheel with two films on a given trajectory: samples with exact ground truth."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math

import numpy as np

from smart_tire.models.tire import tread_film
from smart_tire.parameters import RobotParams
from smart_tire.samples import NS_PER_S, Sample, TireSample, WHEELS, WheelSample, WheelSlip

START_NS = 1_700_000_000 * NS_PER_S
ROBOT = RobotParams()
WHEEL = 'front_right'
CRITICAL = 0.7       # -, critical slip of the surface
PLACE = 0.30         # m, rolled distance when the film midpoint first is at the patch center
ROUND = 2.0 * math.pi * ROBOT.wheel_radius
QUIET = (1.65, 1.65)

Course = Callable[[np.ndarray], np.ndarray]  # s -> m, rolled


def steady(rpm: float, begin: float = 0.5) -> Course:
    """Return the trajectory of a wheel that starts at ``begin`` [s] with constant speed."""
    speed = rpm / 60.0 * ROUND
    return lambda time: speed * np.maximum(time - begin, 0.0)


def along(knots: Sequence[tuple[float, float]]) -> Course:
    """Return the trajectory through (time [s], distance [m]) with smooth starts and stops."""
    times, places = np.array(knots).T

    def course(time: np.ndarray) -> np.ndarray:
        i = np.clip(np.searchsorted(times, time, side='right') - 1, 0, len(times) - 2)
        share = np.clip((time - times[i]) / (times[i + 1] - times[i]), 0.0, 1.0)
        return places[i] + (places[i + 1] - places[i]) * share**2 * (3.0 - 2.0 * share)
    return course


def films(course: Course, duration: float, *, slip: float = 0.1, total: float = 0.13,
          noise: float = 0.005, seed: int = 0, release: str = 'fig8', spread: float = 0.15,
          reverse: bool = False) -> list[TireSample]:
    """Return the film samples of a wheel with the trajectory ``course``."""
    rng = np.random.default_rng(seed)
    film, patch = ROBOT.film, ROBOT.tire.contact_length
    time = np.arange(0.0, duration, 1.0 / film.sample_rate)
    place = course(time)
    volts = []
    for i, offset in enumerate((-0.5 * film.spacing, 0.5 * film.spacing)):
        past = place - PLACE - offset
        turn = np.floor(past / ROUND + 0.5)
        x = past - turn * ROUND + 0.5 * (patch - film.length)
        peak = film.bending(WHEEL)[i] * (1.0 + rng.uniform(-spread, spread, 1000)[
            turn.astype(int) % 1000])
        clean = tread_film.crossing_voltage(
            x, slip=slip, total_slip=total, critical_slip=CRITICAL, film_length=film.length,
            contact_length=patch, bending_peak=peak, bending_alpha=film.bending_alpha,
            stretch_gain=film.gains(WHEEL)[i], release=release, reverse=reverse)
        volts.append(clean - 0.12 * peak * tread_film.bumps(x, film.length, patch)[0]
                     + rng.normal(0.0, noise, len(x)) + film.rest_voltage)
    codes = np.clip(np.rint(np.array(volts).T * 1023.0 / 3.3), 0, 1023)
    return [TireSample(stamp(t), WHEEL, tuple(row)) for t, row in zip(time, codes * 3.3 / 1023.0)]


def wheels(course: Course, duration: float, *, wheel_rate: float = 16.0,
           positions: bool = True) -> list[WheelSample]:
    """Return the wheel speeds and, with ``positions``, angles of the trajectory ``course``."""
    time = np.arange(0.0, duration, 1.0 / wheel_rate)
    angle = course(time) / ROBOT.wheel_radius
    speed = np.diff(angle, prepend=angle[0]) * wheel_rate
    return [WheelSample(stamp(t), (w,) * 4, (a,) * 4 if positions else None)
            for t, a, w in zip(time, angle, speed)]


def slips(course: Course, duration: float, *, slip: float = 0.1) -> list[WheelSlip]:
    """Return the slips of the trajectory ``course``: opposite ones of both sides."""
    out = []
    for t in np.arange(0.0, duration, 0.008):
        rolling = float(course(t + 0.001) - course(t - 0.001)) / 0.002
        ratio = slip if abs(rolling) > 0.05 else math.nan
        out.append(WheelSlip(stamp(t), (-ratio, ratio) * 2, (-slip * rolling, slip * rolling) * 2,
                             (0.003 if ratio == ratio else 1.0,) * 4))
    return out


def stamp(time: float) -> int:
    """Return the timestamp [ns] of a time [s]."""
    return START_NS + round(float(time) * 1e9)


def passes(course: Course, duration: float) -> list[float]:
    """Return the times [s] when the film midpoint is at the patch center."""
    time = np.arange(0.0, duration, 1e-4)
    turns = np.floor((course(time) - PLACE) / ROUND)
    return [float(t) for t in time[1:][np.diff(turns) != 0]]


def in_order(*streams: Sequence[Sample]) -> list[Sample]:
    """Return samples of several streams sorted by timestamp."""
    return sorted((sample for stream in streams for sample in stream),
                  key=lambda sample: sample.stamp_ns)


assert WHEEL in WHEELS
