"""The film in the tread: paper B's Fig. 8, and what many passages show in Fig. 11 to 13."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smart_tire.analysis.series import Floats
from smart_tire.models.tire import brush_tire, strain_charge, tread_film
from smart_tire.models.vehicle import skid_steer
from smart_tire.parameters import SimulatorParams
from smart_tire.reproduction.tire_runs import Passages, ROBOT, RPM, Run, WHEEL
from smart_tire.samples import NS_PER_S

LENGTH, PATCH = ROBOT.film.length, ROBOT.tire.contact_length  # m, l and L
STIFFNESS = ROBOT.tire.longitudinal_stiffness                 # N, C_x
LOAD = 0.25 * ROBOT.mass * skid_steer.GRAVITY                 # N, F_z
GAIN, BENDING = (values[0] for values in (ROBOT.film.stretch_gain, ROBOT.film.bending_peak))
GROUND = SimulatorParams().ground
MU = GROUND.friction[GROUND.names.index('concrete')]
CRITICAL = float(brush_tire.critical_slip(MU, LOAD, STIFFNESS))
SIGNAL_SPEED = 80.0 * RPM * ROBOT.wheel_radius  # m/s, of Fig. 11
WATCHED = 1.98 * ROBOT.film.sample_rate  # Hz, of both halves of a passage: hardly a sample lost
OUTLINE_SLIP, OUTLINE_SPEED = 0.1, 60.0 * RPM * ROBOT.wheel_radius  # -, m/s, of Fig. 8
SLIPS = np.linspace(0.005, 0.3, 60)  # of the printed map's errors
LEAST_SLIP = 0.05   # total: a passage with less tells little of mu
WAYS = ('exact', 'printed', 'paper')


@dataclass(frozen=True)
class Outline:
    """Fig. 8: one passage without noise, over the time since the film was all in the patch."""

    time: Floats                # s
    bending: dict[str, Floats]  # V, by release convention
    stretch: Floats             # V
    whole: float                # s, Delta t_L
    interval: float             # s, Delta t_a to the exact peak
    printed_interval: float     # s, (l + L - L_a) / r w
    height: float               # V, exact q_sm
    printed_height: float       # V, of B(25)

    def read_height(self, release: str) -> float:
        """Return the largest value minus the depth of the smallest, as the paper reads q_sm."""
        volts = self.bending[release] + self.stretch
        return float(volts.max() + volts.min())


@dataclass(frozen=True)
class Signals:
    """Fig. 11: the films' voltages over a drive."""

    time: Floats           # s
    volts: Floats          # (n, 2) V
    peaks: Floats          # (passages, 2) V above rest, highest samples
    lag: float             # s, of film 2 behind film 1, mean
    expected_lag: float    # s, spacing over speed
    bump: float            # V, mean depth before the contact of film 1

    @property
    def variation(self) -> Floats:
        """Return the range of each film's peaks over their mean."""
        variation: Floats = np.ptp(self.peaks, axis=0) / self.peaks.mean(axis=0)
        return variation


@dataclass(frozen=True)
class Line:
    """A straight line through points."""

    slope: float
    offset: float
    determination: float  # R^2


@dataclass(frozen=True)
class Sweep:
    """Fig. 12, 13 and Table I: passages at many slips of the wheel with the films."""

    passages: Passages           # in traction
    braking: Passages            # which two peaks do not tell
    lines: dict[float, Line]     # q_sm [V] over slip, by wheel speed [rpm]
    ratios: dict[str, Floats]    # adhesion ratio of each passage, by way
    slopes: dict[str, Line]      # of these over slip
    friction: dict[str, Floats]  # mu of each passage, NaN where it is not told, by way


def outline() -> Outline:
    """Return the passage of film 1 at paper B's parameters."""
    x = np.linspace(-1.3 * LENGTH, PATCH + LENGTH, 2001)
    x = np.sort(np.append(x, [0.0, PATCH - LENGTH, PATCH]))
    stuck = PATCH * float(brush_tire.adhesion_ratio(OUTLINE_SLIP, MU, LOAD, STIFFNESS))
    peak = float(strain_charge.peak_position(stuck, LENGTH, PATCH))
    bending = {release: BENDING * tread_film.bending(
        x, LENGTH, PATCH, ROBOT.film.bending_alpha, release).value
        for release in tread_film.RELEASES}
    return Outline(
        x / OUTLINE_SPEED, bending, stretch_volts(x, OUTLINE_SLIP), PATCH / OUTLINE_SPEED,
        (PATCH - peak) / OUTLINE_SPEED, (LENGTH + PATCH - stuck) / OUTLINE_SPEED,
        float(highest_stretch(OUTLINE_SLIP)), float(printed_stretch(OUTLINE_SLIP)))


def stretch_volts(x: Floats, slip: Floats | float) -> Floats:
    """Return the stretch part [V] of film 1 at ``x`` [m], slipping straight ahead."""
    return GAIN * strain_charge.overlap_integral(x, slip, slip, CRITICAL, LENGTH, PATCH)


def highest_stretch(slip: Floats | float) -> Floats:
    """Return the exact q_sm [V] of film 1."""
    stuck = PATCH * brush_tire.adhesion_ratio(slip, MU, LOAD, STIFFNESS)
    return stretch_volts(strain_charge.peak_position(stuck, LENGTH, PATCH), slip)


def printed_stretch(slip: Floats | float) -> Floats:
    """Return q_sm [V] of B(25), with the adhesion length that goes with the slip."""
    stuck = PATCH * brush_tire.adhesion_ratio(slip, MU, LOAD, STIFFNESS)
    return GAIN * LENGTH * (2.0 * stuck - LENGTH) / (2.0 * PATCH) * np.asarray(slip)


def printed_ratio(slip: Floats) -> Floats:
    """Return the adhesion ratio that the printed map reads off exact peaks."""
    stuck = PATCH * brush_tire.adhesion_ratio(slip, MU, LOAD, STIFFNESS)
    return ratio_of(strain_charge.peak_position(stuck, LENGTH, PATCH), 'printed')


def printed_excess(slip: Floats) -> Floats:
    """Return mu from the printed map over the true one, with no noise at all."""
    ratio = brush_tire.adhesion_ratio(slip, MU, LOAD, STIFFNESS)
    excess: Floats = (1.0 - ratio) / (1.0 - printed_ratio(slip))
    return excess


def ratio_of(peak: Floats, method: str) -> Floats:
    """Return L_a / L from the place of the peak [m] by the ``exact`` or the ``printed`` map."""
    return strain_charge.adhesion_length(peak, LENGTH, PATCH, method) / PATCH


def signals(run: Run) -> Signals:
    """Return the films' voltages of a drive at ``SIGNAL_SPEED``."""
    stamps, volts = run.inputs.films(WHEEL)
    rest, speed = ROBOT.film.rest_voltage, SIGNAL_SPEED
    reach = 0.5 * (ROBOT.film.spacing + LENGTH + PATCH) + 2.0 * tread_film.BUMP_DISTANCE  # m
    peaks, lags, bumps = [], [], []
    for passage in run.estimates.passages:
        near = np.abs(stamps - passage.stamp_ns) < reach / speed * NS_PER_S
        if passage.stamp_ns < run.begin_ns or near.sum() < WATCHED * reach / speed:
            continue  # a lost batch, or the drive's begin or end
        charge, time = volts[near] - rest, stamps[near]
        peaks.append(charge.max(axis=0))
        low = charge.argmin(axis=0)
        lags.append((time[low[1]] - time[low[0]]) / NS_PER_S)
        bumps.append(-charge[:charge[:, 0].argmax(), 0].min())
    return Signals((stamps - run.origin_ns) / NS_PER_S, volts, np.array(peaks),
                   float(np.mean(lags)), ROBOT.film.spacing / speed, float(np.mean(bumps)))


def sweep(passages: Passages) -> Sweep:
    """Return what the passages of many drives tell."""
    pulling = passages.take(passages.slip > 0.0)
    ratios = {'exact': ratio_of(pulling.peak, 'exact'),
              'printed': ratio_of(pulling.peak, 'printed'),
              'paper': ratio_of(pulling.raw_peak, 'printed')}
    # the paper has the longitudinal slip only; total slip needs the lateral motion as well
    slips = {'exact': pulling.total_slip, 'printed': pulling.total_slip, 'paper': pulling.slip}
    telling = pulling.total_slip > LEAST_SLIP
    return Sweep(
        pulling, passages.take(passages.slip < 0.0),
        {speed: straight(pulling.slip[pulling.speed == speed],
                         pulling.stretch[pulling.speed == speed])
         for speed in np.unique(pulling.speed).tolist()},
        ratios, {way: straight(slips[way][telling], ratios[way][telling]) for way in WAYS},
        {way: np.where(telling, brush_tire.friction_from_adhesion(
            ratios[way], slips[way], pulling.load, STIFFNESS), np.nan) for way in WAYS})


def straight(x: Floats, y: Floats) -> Line:
    """Return the best straight line through the finite points."""
    known = np.isfinite(x) & np.isfinite(y)
    x, y = x[known], y[known]
    slope, offset = np.polyfit(x, y, 1)
    return Line(float(slope), float(offset), float(np.corrcoef(x, y)[0, 1]**2))
