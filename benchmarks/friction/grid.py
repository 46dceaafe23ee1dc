"""What the synthesised passages have in common: slip, ground, speed and noise of each case."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

from smart_tire.models.tire import brush_tire
from smart_tire.models.vehicle.skid_steer import GRAVITY
from smart_tire.parameters import RobotParams
from smart_tire.parameters.robot import FilmParams

RPM = math.tau / 60.0  # rad/s
WHEEL = 'front_right'  # with the films
ROBOT = RobotParams()  # paper B's Table I
LOAD = 0.25 * ROBOT.mass * GRAVITY  # N, F_z of every wheel

SLIPS = (0.02, 0.03, 0.05, 0.1, 0.15, 0.2, 0.3)
FEW_SLIPS = (0.05, 0.1, 0.2)    # of the cases that vary something else
FASTER = 80.0                   # rpm, beside 60: the paper's two speeds
EXTREME_SPEEDS = (15.0, 120.0, 200.0)
NOISES = (0.002, 0.010, 0.020)  # V, beside the usual one
FRICTIONS = (0.1, 0.2, 0.9)     # beside concrete's
CONCRETE = 0.47                 # -, mu, Table I


@dataclass(frozen=True, kw_only=True)
class Case:
    """Passages that differ by chance only."""

    slip: float              # -, B(3)'s lambda
    mu: float = CONCRETE
    rpm: float = 60.0
    noise: float = 0.005     # V, one sigma of a sample
    turning: float = 1.0     # total slip over the longitudinal one
    release: str = 'fig8'

    @property
    def robot(self) -> RobotParams:
        """Return the robot, with films on one wheel."""
        return replace(ROBOT, film=FilmParams(
            wheels=(WHEEL,), noise=self.noise, release=self.release))

    @property
    def speed(self) -> float:
        """Return |r w| [m/s]."""
        return self.rpm * RPM * ROBOT.wheel_radius

    @property
    def total_slip(self) -> float:
        """Return the magnitude of the combined slip."""
        return self.turning * abs(self.slip)

    @property
    def critical_slip(self) -> float:
        """Return the total slip from which on the whole patch slides."""
        return float(brush_tire.critical_slip(
            self.mu, LOAD, ROBOT.tire.longitudinal_stiffness))

    @property
    def sliding(self) -> float:
        """Return total slip / critical slip."""
        return self.total_slip / self.critical_slip


def all_cases() -> dict[str, list[Case]]:
    """Return the cases by what they vary."""
    signed, few = ([sign * slip for slip in slips for sign in (1.0, -1.0)]
                   for slips in (SLIPS, FEW_SLIPS))
    return {
        'slip': [Case(slip=slip) for slip in signed],
        'slip, faster': [Case(slip=slip, rpm=FASTER) for slip in (*few, 0.3)],
        'noise': [Case(slip=slip, noise=noise) for noise in NOISES for slip in FEW_SLIPS],
        'noise, braking': [Case(slip=-slip, noise=max(NOISES)) for slip in FEW_SLIPS],
        'friction': [Case(slip=slip, mu=mu) for mu in FRICTIONS for slip in few],
        'turning: total slip 1.3 times the longitudinal one': [
            Case(slip=slip, turning=1.3) for slip in few],
        'speed': [Case(slip=0.1, rpm=rpm) for rpm in EXTREME_SPEEDS],
        'release as a state': [Case(slip=slip, release='state') for slip in (0.1, -0.1)]}


def quick_cases() -> dict[str, list[Case]]:
    """Return a few of the cases."""
    return {'slip': [Case(slip=slip) for slip in (0.03, 0.05, 0.1, 0.3, -0.1)],
            'noise': [Case(slip=0.1, noise=0.020)],
            'friction': [Case(slip=0.1, mu=mu) for mu in (0.1, 0.9)]}
