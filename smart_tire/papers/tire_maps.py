# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The film in the tread: Fig. 8 of paper B, and the crossings of Fig. 11 to 13."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smart_tire.arrays import Array
from smart_tire.models.tire import brush_tire, strain_charge, tread_film
from smart_tire.models.tire.film_equations import BUMP_DISTANCE
from smart_tire.papers.printed import MAPS
from smart_tire.papers.tire_runs import Crossings, Drive, ROBOT, RPM, WHEEL
from smart_tire.parameters import SimulatorParams
from smart_tire.samples import GRAVITY, NS_PER_S

LENGTH, PATCH = ROBOT.film.length, ROBOT.tire.contact_length  # m, l and L
STIFFNESS = ROBOT.tire.longitudinal_stiffness                 # N, C_x
LOAD = 0.25 * ROBOT.mass * GRAVITY                 # N, F_z
GAIN, BENDING = (values[0] for values in (ROBOT.film.stretch_gain, ROBOT.film.bending_peak))
GROUND = SimulatorParams().ground
MU = GROUND.friction[GROUND.names.index('concrete')]
CRITICAL = float(brush_tire.critical_slip(MU, LOAD, STIFFNESS))
SIGNAL_SPEED = 80.0 * RPM * ROBOT.wheel_radius                      # m/s, of Fig. 11
MIN_SAMPLE_RATE = 1.98 * ROBOT.film.sample_rate  # Hz, of a complete crossing (both halves)
OUTLINE_SLIP, OUTLINE_SPEED = 0.1, 60.0 * RPM * ROBOT.wheel_radius  # -, m/s, of Fig. 8
SLIPS = np.linspace(0.005, 0.3, 60)                                 # for errors of the printed map
MIN_SLIP = 0.05  # total slip, below which a crossing hardly determines mu
METHODS = ('exact', 'printed', 'paper')


@dataclass(frozen=True)
class Outline:
    """Fig. 8: one crossing without noise, over time since the film is fully in the patch."""

    time: Array                # s
    bending: dict[str, Array]  # V, by release convention
    stretch: Array             # V
    whole: float                # s, Delta t_L
    interval: float             # s, Delta t_a to the exact peak
    printed_interval: float     # s, (l + L - L_a) / r w
    height: float               # V, exact q_sm
    printed_height: float       # V, of B(25)

    def read_height(self, release: str) -> float:
        """Return the maximum minus the magnitude of the minimum, the paper's reading of q_sm."""
        volts = self.bending[release] + self.stretch
        return float(volts.max() + volts.min())


@dataclass(frozen=True)
class Signals:
    """Fig. 11: the films' voltages over a drive."""

    time: Array         # s
    volts: Array        # (n, 2) V
    peaks: Array        # (crossings, 2) V above the baseline, largest samples
    lag: float           # s, of film 2 after film 1, mean
    expected_lag: float  # s, spacing over speed
    bump: float          # V, mean magnitude before film 1 enters the patch

    @property
    def variation(self) -> Array:
        """Return the range of each film's peaks over their mean."""
        variation: Array = np.ptp(self.peaks, axis=0) / self.peaks.mean(axis=0)
        return variation


@dataclass(frozen=True)
class Line:
    """A regression line."""

    slope: float
    offset: float
    determination: float  # R^2


@dataclass(frozen=True)
class Sweep:
    """Fig. 12, 13 and Table I: crossings at many slips of the instrumented wheel."""

    crossings: Crossings         # in traction
    braking: Crossings           # without a second peak
    lines: dict[float, Line]     # q_sm [V] over slip, by wheel speed [rpm]
    ratios: dict[str, Array]    # adhesion ratio of each crossing, by method
    slopes: dict[str, Line]      # of these over slip
    friction: dict[str, Array]  # mu of each crossing, NaN if not observable, by method


def outline() -> Outline:
    """Return the crossing of film 1 with the parameters of paper B."""
    x = np.linspace(-1.3 * LENGTH, PATCH + LENGTH, 2001)
    x = np.sort(np.append(x, [0.0, PATCH - LENGTH, PATCH]))
    adhesion = PATCH * float(brush_tire.adhesion_ratio(OUTLINE_SLIP, MU, LOAD, STIFFNESS))
    peak = float(strain_charge.peak_position(adhesion, LENGTH, PATCH))
    bending = {release: BENDING * tread_film.bending(
        x, LENGTH, PATCH, ROBOT.film.bending_alpha, release)
        for release in tread_film.RELEASES}
    return Outline(
        x / OUTLINE_SPEED, bending, stretch_volts(x, OUTLINE_SLIP), PATCH / OUTLINE_SPEED,
        (PATCH - peak) / OUTLINE_SPEED, (LENGTH + PATCH - adhesion) / OUTLINE_SPEED,
        float(exact_stretch(OUTLINE_SLIP)), float(printed_stretch(OUTLINE_SLIP)))


def stretch_volts(x: Array, slip: Array | float) -> Array:
    """Return the stretch signal [V] of film 1 at ``x`` [m], for longitudinal slip."""
    return GAIN * strain_charge.overlap_integral(x, slip, slip, CRITICAL, LENGTH, PATCH)


def exact_stretch(slip: Array | float) -> Array:
    """Return the exact q_sm [V] of film 1."""
    adhesion = PATCH * brush_tire.adhesion_ratio(slip, MU, LOAD, STIFFNESS)
    return stretch_volts(strain_charge.peak_position(adhesion, LENGTH, PATCH), slip)


def printed_stretch(slip: Array | float) -> Array:
    """Return q_sm [V] of B(25), with the adhesion length at this slip."""
    adhesion = PATCH * brush_tire.adhesion_ratio(slip, MU, LOAD, STIFFNESS)
    return GAIN * LENGTH * (2.0 * adhesion - LENGTH) / (2.0 * PATCH) * np.asarray(slip)


def printed_ratio(slip: Array) -> Array:
    """Return the adhesion ratio of the printed map from exact peaks."""
    adhesion = PATCH * brush_tire.adhesion_ratio(slip, MU, LOAD, STIFFNESS)
    return ratio_of(strain_charge.peak_position(adhesion, LENGTH, PATCH), 'printed')


def printed_excess(slip: Array) -> Array:
    """Return mu of the printed map over the true one, without noise."""
    ratio = brush_tire.adhesion_ratio(slip, MU, LOAD, STIFFNESS)
    excess: Array = (1.0 - ratio) / (1.0 - printed_ratio(slip))
    return excess


def ratio_of(peak: Array, method: str) -> Array:
    """Return L_a / L from the peak position [m] by the ``exact`` or the ``printed`` map."""
    return MAPS[method](peak, LENGTH, PATCH) / PATCH


def signals(run: Drive) -> Signals:
    """Return the film voltages of a drive at ``SIGNAL_SPEED``."""
    stamps, volts = run.inputs.films(WHEEL)
    baseline, speed = ROBOT.film.rest_voltage, SIGNAL_SPEED
    reach = 0.5 * (ROBOT.film.spacing + LENGTH + PATCH) + 2.0 * BUMP_DISTANCE * LENGTH
    peaks, lags, bumps = [], [], []
    for crossing in run.estimates.crossings:
        window = np.abs(stamps - crossing.stamp_ns) < reach / speed * NS_PER_S
        if crossing.stamp_ns < run.begin_ns or window.sum() < MIN_SAMPLE_RATE * reach / speed:
            continue  # incomplete: a lost batch, or begin or end of the drive
        charge, time = volts[window] - baseline, stamps[window]
        peaks.append(charge.max(axis=0))
        release = charge.argmin(axis=0)
        lags.append((time[release[1]] - time[release[0]]) / NS_PER_S)
        bumps.append(-charge[:charge[:, 0].argmax(), 0].min())
    return Signals((stamps - run.origin_ns) / NS_PER_S, volts, np.array(peaks),
                   float(np.mean(lags)), ROBOT.film.spacing / speed, float(np.mean(bumps)))


def sweep(crossings: Crossings) -> Sweep:
    """Return regression lines and friction by all methods from the crossings of many drives."""
    traction = crossings.take(crossings.slip > 0.0)
    ratios = {'exact': ratio_of(traction.peak, 'exact'),
              'printed': ratio_of(traction.peak, 'printed'),
              'paper': ratio_of(traction.raw_peak, 'printed')}
    # the paper uses the longitudinal slip; total slip requires the lateral motion as well
    slips = {'exact': traction.total_slip, 'printed': traction.total_slip, 'paper': traction.slip}
    informative = traction.total_slip > MIN_SLIP
    return Sweep(
        traction, crossings.take(crossings.slip < 0.0),
        {speed: fit_line(traction.slip[traction.speed == speed],
                         traction.stretch[traction.speed == speed])
         for speed in np.unique(traction.speed).tolist()},
        ratios, {method: fit_line(slips[method][informative], ratios[method][informative])
                 for method in METHODS},
        {method: np.where(informative, brush_tire.friction_from_adhesion(
            ratios[method], slips[method], traction.load, STIFFNESS), np.nan)
         for method in METHODS})


def fit_line(x: Array, y: Array) -> Line:
    """Return the regression line of the finite points."""
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    slope, offset = np.polyfit(x, y, 1)
    return Line(float(slope), float(offset), float(np.corrcoef(x, y)[0, 1]**2))
