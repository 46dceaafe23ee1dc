"""
The paper's own estimator: two peaks of the raw samples, B(22) to B(26) and Fig. 8.

The highest sample stands for the stretch peak at x_m, the lowest for the release: the travel
between them tells the adhesion length, by the exact map or the printed one, and the slip is that
of the slip estimator. At 400 Hz the two are read some millimetres and 0.1 V wrong, and only in
traction are they those two peaks.
"""

from __future__ import annotations

import math

import numpy as np

from smart_tire.estimation.contact.records import FilmSamples, PatchCrossing
from smart_tire.estimation.friction.brush_inversion import SlipFit
from smart_tire.estimation.friction.motion_history import ValueSigma, WheelMotion
from smart_tire.estimation.friction.waveform_method import WaveformResult
from smart_tire.models.tire import strain_charge, tread_film
from smart_tire.parameters.robot import RobotParams


MARGIN = 0.005         # m of travel beyond which no peak is
COVERED = 0.9          # share of that way that must have been sampled
UNSEEN_TOP = 2.0       # sigmas of noise by which a sample beside the top may be the highest
STEP = 1e-4            # m, for the slope of a map
SMALLEST_SHARE = 0.01  # of the contact length that slides: a stretch peak needs some
EVENLY = 12.0          # variance of an even spread of width 1, inverted


class TwoPeakReader:
    """Reads the passages of one wheel off the peaks of raw samples; ``map`` is that of x_m."""

    def __init__(self, wheel: str, robot: RobotParams, name: str) -> None:
        self._film, self._patch, self._map = robot.film, robot.tire.contact_length, name
        self._gains = robot.film.gains(wheel)
        inside, half = 0.5 * (self._patch - robot.film.length), 0.5 * (
            self._patch + robot.film.length)
        self._from, self._to = -inside - MARGIN, half + MARGIN  # m, about a film's middle
        # V/m per volt of the bending peak, before and behind the lowest point
        x = self._patch + np.array([-STEP, 0.0, STEP])
        bend = tread_film.bending(x, robot.film.length, self._patch,
                                          robot.film.bending_alpha).value
        self._sharp = float(np.mean(np.abs(np.diff(bend)))) / STEP

    def read(self, passage: PatchCrossing, motion: WheelMotion) -> WaveformResult | None:
        """Return what ``passage`` tells, None if not in traction or where peaks are missing."""
        if passage.samples is None or not motion.slip[0] > 0.0:
            return None
        found = [film for one, seen in zip(passage.samples.films, passage.samples.sightings)
                 if (film := self._peaks(one, seen.middle, motion.slip[0])) is not None]
        if not found:
            return None
        table = np.array([(slip, slip_sigma, sliding, sliding_sigma)
                          for slip, slip_sigma, sliding, sliding_sigma, _ in found])
        slip, sliding = table[:, [0, 2]].mean(axis=0).tolist()
        noise = np.diag(np.sum(table[:, [1, 3]]**2, axis=0) / len(found)**2)
        gains = self._film.stretch_gain_tolerance * slip
        alone = SlipFit(slip, sliding, noise, np.diag([gains**2 / len(found), 0.0]))
        joined = SlipFit(motion.slip[0], sliding, np.diag([0.0, noise[1, 1]]),
                          np.diag([motion.slip[1]**2, 0.0]))
        return WaveformResult(alone, joined, 0.0, self._first(passage, found[0][4]))

    def _peaks(self, film: FilmSamples, middle: float, slip: float) -> tuple[
            float, float, float, float, tuple[int, ValueSigma, ValueSigma]] | None:
        """
        Return slip and sliding of one film with their sigmas, and the peaks themselves.

        These are the film, q_sm [V] and the travel between the peaks [m], with sigmas.
        """
        way = film.distance - middle
        near = (way > self._from) & (way < self._to)
        if np.count_nonzero(near) < 3:
            return None
        way, volts = way[near], film.volts[near]
        step = float(np.median(np.diff(way)))
        if len(way) * step < COVERED * (self._to - self._from):
            return None
        top, low = int(np.argmax(volts)), int(np.argmin(volts))
        apart, height = float(way[low] - way[top]), float(volts[top] + volts[low])
        stuck = self._stuck(apart)
        sliding = 1.0 - stuck / self._patch
        if not sliding > SMALLEST_SHARE:  # also where the exact map does not tell
            return None
        flat = self._flatness(sliding, slip, film.film, step)
        apart_sigma = math.hypot(step / math.sqrt(EVENLY), flat)
        slope = abs(self._stuck(apart + STEP) - self._stuck(apart - STEP)) / (2.0 * STEP)
        short = self._sharp * abs(float(volts[low])) * step / math.sqrt(EVENLY)
        height_sigma = math.hypot(short, math.sqrt(2.0 * self._film.sample_variance))
        unit = self._gains[film.film] * self._unit(self._patch - apart, sliding)
        if not (unit > 0.0 and math.isfinite(slope)):
            return None
        return (height / unit, height_sigma / unit, sliding, slope * apart_sigma / self._patch,
                (film.film, (height, height_sigma), (apart, apart_sigma)))

    def _stuck(self, apart: float) -> float:
        """Return the adhesion length [m] for the travel between the peaks, NaN if not told."""
        return float(strain_charge.adhesion_length(
            self._patch - apart, self._film.length, self._patch, self._map))

    def _unit(self, x: float, sliding: float) -> float:
        return float(strain_charge.overlap_integral(
            x, sliding, sliding, 1.0, self._film.length, self._patch)) / sliding

    def _flatness(self, sliding: float, slip: float, film: int, step: float) -> float:
        """Return one sigma of the place [m] of the highest sample, for the top is flat."""
        x = np.linspace(0.0, self._patch, 100)
        volts = self._gains[film] * slip * strain_charge.overlap_integral(
            x, sliding, sliding, 1.0, self._film.length, self._patch) / sliding
        high = x[volts > volts.max() - UNSEEN_TOP * math.sqrt(self._film.sample_variance)]
        return max(float(np.ptp(high)), step) / math.sqrt(EVENLY)

    def _first(self, passage: PatchCrossing,
               peaks: tuple[int, ValueSigma, ValueSigma]) -> dict[str, ValueSigma]:
        film, height, apart = peaks
        if film:
            return {}
        interval = apart[0] / passage.speed
        sigma = math.hypot(apart[1], passage.speed_sigma * interval) / passage.speed
        return {'stretch_voltage': height, 'peak_interval': (interval, sigma)}
