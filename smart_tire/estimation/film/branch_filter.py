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
Live inverse of the Duhem operator with its standard deviation, branch by branch.

Between two turning points the inverse is exact, so the state is needed at turning points only. It
is a divided-difference filter (Noergaard, Poulsen and Ravn 2000): the nominal state and a pair of
members for each column of a root of its covariance follow the same branch, each with its own
operator, amplifier and pyroelectric coefficient. Their distances are the standard deviation, also
where a small error of the charge is a large one of the input, after a reversal. What is unknown in
addition (noise, motion in a gap, lost charge) is a further column.

A reversal is confirmed when the charge has come back by ``DEAD_BAND`` standard deviations. Until
then the two explanations, noise and reversal, are averaged by their probabilities, and their
distance is part of the variance. The extreme of n samples with noise is beyond the true turning
point by the expected maximum of n normal variables, which is subtracted.
"""

from __future__ import annotations

from enum import IntEnum
import math
from statistics import NormalDist

import numpy as np

from smart_tire.arrays import Array
from smart_tire.estimation.film.calibration import FilmParams
from smart_tire.models.film import inverse

# value, unit, meaning; origin
DEAD_BAND = 10.0   # sigmas; derived: white noise of 1e5 samples spans 9
TURNING_NOISE = 0.7  # of that of a sample: extreme of several samples; assumed, derived 0.5 to 1
MEMBER_STEP = 3.0**0.5    # sigmas of a member; derived: fourth moment of a normal variable
LAW_ERROR_FACTOR = 2.0  # of the residuals of a fit, for motion that it has not seen; assumed
MIN_LOOP = 1e-3    # of 1 - b / a of a member; assumed
MIN_SHARE = 1e-2   # of alpha and a of a member over the nominal ones; assumed
NORMAL = NormalDist()


COLUMNS = 10       # of the root: one per row of the state, and the noise
# members: the nominal one, and one a step up and one a step down each column
NOMINAL, UP, DOWN = np.split(np.eye(1 + 2 * COLUMNS), [1, 1 + COLUMNS])
NOISE = UP[-1] - DOWN[-1]  # in MEMBER_STEP sigmas
BENDS = UP + DOWN - 2.0 * NOMINAL
# mean and root of the covariance (2 COLUMNS,) from the values of the members
MEAN = NOMINAL[0] + BENDS.sum(axis=0) / 6.0
ROOT = np.vstack([(UP - DOWN) / (2.0 * MEMBER_STEP), BENDS * 2.0**0.5 / 6.0]).T


class FilmState(IntEnum):
    """Rows of the state at a turning point."""

    ALPHA = 0   # 1/input
    A = 1       # C/input
    B = 2       # C/input
    CORNER = 3  # Hz, of the charge amplifier
    DRIFT = 4   # C/s
    PYRO = 5    # C/K
    INPUT = 6   # of the operator, zero for the flat film
    Z = 7       # C, charge minus A times input
    CHARGE = 8  # C, since the zero of the sensor


class FilmSignal(IntEnum):
    """What is measured at an instant, since the zero of the sensor."""

    CHARGE = 0       # C, output of the amplifier
    INTEGRAL = 1     # C s, of the output
    TIME = 2         # s
    TEMPERATURE = 3  # K


class BranchFilter:
    """
    FilmState of a film at its latest turning point, and its input after it.

    ``noise`` [C] is the standard deviation of a charge, ``zero_sigma`` [C] that of the zero; the
    pyroelectric coefficient [C/K] has a mean and a standard deviation. ParameterError if the
    operator has no inverse.
    """

    def __init__(self, film: FilmParams, noise: float, *, fresh: bool, zero_sigma: float = 0.0,
                 pyro: tuple[float, float] = (0.0, 0.0)) -> None:
        self.turnings = 0
        # of Z by the operator, for each branch, and of a charge
        self.noise, self._law_error = noise, LAW_ERROR_FACTOR * film.model_error
        state, covariance = np.zeros(len(FilmState)), np.zeros((len(FilmState),) * 2)
        state[:FilmState.INPUT] = (film.alpha_gain, film.a_gain, film.b_gain, film.low_corner,
                                   film.drift, pyro[0])
        covariance[:FilmState.PYRO, :FilmState.PYRO] = film.covariance
        covariance[FilmState.PYRO, FilmState.PYRO] = pyro[1]**2
        # of a used film uniform over the band that attracts all states
        covariance[FilmState.Z, FilmState.Z] = (not fresh) * film.operator.band**2 / 3.0
        covariance[FilmState.CHARGE, FilmState.CHARGE] = zero_sigma**2
        # relative units: the rows differ by many orders of magnitude
        units = np.sqrt(np.diag(covariance))
        units[units == 0.0] = 1.0
        variances, axes = np.linalg.eigh(covariance / np.outer(units, units))
        self._set(state, units[:, None] * axes * np.sqrt(np.maximum(variances, 0.0)))
        self._restart_branch(self._members[FilmState.CHARGE], 0.0)

    def _set(self, nominal: Array, root: Array) -> None:
        """Replace state and root (9, n) of its covariance, reduced to nine columns."""
        reduced: Array = np.linalg.qr(root.T)[1]
        self._root = reduced.T
        steps = MEMBER_STEP * np.column_stack([self._root, np.zeros(len(FilmState))])
        members = nominal[:, None] + np.column_stack([np.zeros(len(FilmState)), steps, -steps])
        alpha, a, b = members[:3]
        np.maximum(alpha, MIN_SHARE * alpha[0], out=alpha)
        np.maximum(a, MIN_SHARE * a[0], out=a)
        np.clip(b, 0.5 * a, (1.0 - MIN_LOOP) * a, out=b)
        self._band = (a - b) / alpha
        np.clip(members[FilmState.Z], -self._band, self._band, out=members[FilmState.Z])
        self._members = members
        self._start = members[[FilmState.ALPHA, FilmState.A, FilmState.B, FilmState.INPUT,
                               FilmState.Z]]  # of the branch, in the order of ``inverse``
        self._by_signal = np.column_stack([  # of the charge, in the order of FilmSignal
            np.ones(members.shape[1]), 2.0 * math.pi * members[FilmState.CORNER],
            -members[FilmState.DRIFT], -members[FilmState.PYRO]])

    def _restart_branch(self, charge: Array, sign: float) -> None:
        self._sign, self._extreme, self._dwell = sign, charge, 1.0

    def _charges(self, signal: Array) -> Array:
        """Return the charge [C] of the film (members,) since the zero of the sensor."""
        charge: Array = self._by_signal @ signal
        return charge

    def _advanced(self, charge: Array) -> Array:
        """Return inputs and z (2, members) at ``charge`` on the branch from the turning point."""
        return inverse.advanced(self._start, charge - self._members[FilmState.CHARGE])

    def add_signal(self, signal: Array, charge_sigma: float) -> tuple[float, float]:
        """
        Return the input at ``signal`` and its standard deviation; follow reversals.

        ``charge_sigma`` [C] is that of errors of the charge in addition to noise and model.
        """
        charge = self._charges(signal)
        step = float(charge[0] - self._extreme[0])
        if self._sign:
            charge = self._follow(signal, charge, self._sign * step)
        elif abs(step) > DEAD_BAND * self.noise:
            self._restart_branch(charge, math.copysign(1.0, step))
        return self._estimate(charge, MEMBER_STEP * math.hypot(
            self.noise, charge_sigma, self._law_error))

    def _follow(self, signal: Array, charge: Array, advance: float) -> Array:
        """
        Move the extreme of the branch by ``advance`` [C], or turn there.

        Return the charge (members,), after a turn that of the new members.
        """
        band = DEAD_BAND * self.noise
        if advance >= 0.0:
            self._dwell = self._dwell * max(1.0 - advance / band, 0.0) + 1.0
            self._extreme = charge
        elif advance < -band:
            self._turn()
            charge = self._charges(signal)
            self._restart_branch(charge, -self._sign)
        else:
            self._dwell += 1.0
        return charge

    def _turning_charge(self) -> Array:
        """Return the charge (members,) at the extreme without the bias of a maximum."""
        bias = NORMAL.inv_cdf((self._dwell - 0.375) / (self._dwell + 0.25))  # Blom 1958
        charge: Array = self._extreme - self._sign * bias * self.noise
        return charge

    def _turn(self) -> None:
        """Make the extreme of the branch the new turning point."""
        self.turnings += 1
        state, root = self._moved(self._turning_charge(), TURNING_NOISE * self.noise)
        self._set(state, np.column_stack([root, self._z_column(self._law_error)]))

    def _z_column(self, sigma: float) -> Array:
        """Return a column of the root: an error of Z [C] at the same charge."""
        column = np.zeros(len(FilmState))
        column[[FilmState.Z, FilmState.INPUT]] = sigma, -sigma / self._members[FilmState.A, 0]
        return column

    def stop_at(self, signal: Array, *, charge_sigma: float = 0.0, mixing: float = 0.0,
                zero: bool = False) -> None:
        """
        Begin a branch of unknown direction at ``signal``, after the present one.

        ``charge_sigma`` [C] is lost charge, ``mixing`` the share of the hysteresis that unseen
        motion has replaced. With ``zero`` the film is flat.
        """
        state, root = self._moved(self._charges(signal), math.hypot(self.noise, charge_sigma))
        for rows in (state, root):
            rows[FilmState.INPUT] += mixing * rows[FilmState.Z] / self._members[FilmState.A, 0]
            rows[FilmState.Z] *= 1.0 - mixing
            if zero:
                rows[FilmState.INPUT] = 0.0
        self._set(state, np.column_stack([
            root, self._z_column(math.sqrt(mixing / 3.0) * self._band[0])]))
        self._restart_branch(self._members[FilmState.CHARGE], 0.0)

    def _moved(self, charge: Array, sigma: float) -> tuple[Array, Array]:
        """Return state and root on the branch at ``charge`` (members,), known to ``sigma`` [C]."""
        charge = charge + MEMBER_STEP * sigma * NOISE
        return _moments(np.vstack([
            self._members[:FilmState.INPUT], *self._advanced(charge), charge]))

    def _estimate(self, charge: Array, error: float) -> tuple[float, float]:
        """Return the input at ``charge`` (members,) with ``error`` [C], and its sigma."""
        charge, start = charge + error * NOISE, self._start
        if self._sign:
            same, turning = self._advanced(charge)[0], self._turning_charge()
            back = charge - turning
            back[self._sign * back > 0.0] = 0.0
        else:
            same, back = start[inverse.INPUT], charge - self._members[FilmState.CHARGE]
            # the noise where it means the most motion, of what z may be
            z_error = MEMBER_STEP * float(np.linalg.norm(self._root[FilmState.Z]))
            start = start.copy()
            start[inverse.Z] = np.clip(start[inverse.Z] + z_error * NOISE, -self._band, self._band)
        found, ambiguity = same, 0.0
        if back.any():
            reversal = -np.expm1(-0.5 * (back / self.noise)**2)  # probability of each member
            if self._sign:
                start = np.concatenate([start[:inverse.INPUT], self._advanced(turning)])
            turned = inverse.advanced(start, back)[0]
            found = reversal * turned + (1.0 - reversal) * same
            ambiguity = float(reversal[0] * (1.0 - reversal[0]) * (turned[0] - same[0])**2)
        mean, root = _moments(found)
        return float(mean), math.sqrt(float(root @ root) + ambiguity)


def _moments(values: Array) -> tuple[Array, Array]:
    """Return mean (...) and root (..., 2 n) of the covariance of members (..., 2 n + 1)."""
    return values @ MEAN, values @ ROOT
