"""What a recording tells of latency, effective track and rolling radius of the wheels."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
import math

from smart_tire.errors import EstimatorError
from smart_tire.estimation.estimate import Estimate
from smart_tire.estimation.motion_record import Recording
from smart_tire.estimation.rolling_radius import fit_radius, TURN_SLIP, WayFit
from smart_tire.estimation.wheel_latency import fit_turns, TurnFit
from smart_tire.parameters import RobotParams

LATENCY, RADIUS, TRACK = 'wheel latency', 'rolling radius', 'effective track'
TRACK_LIMIT = 0.1  # relative standard error above which a track is not given


@dataclass(frozen=True)
class Quantity:
    """One line of what was found."""

    name: str
    estimate: Estimate
    unit: str
    note: str = ''
    parameter: str = ''  # that takes the value, '' where there is none


@dataclass
class Geometry:
    """What was found, what was refused with the reason, and the fits for figures."""

    quantities: list[Quantity] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)  # name -> reason
    turns: TurnFit | None = None
    ways: WayFit | None = None

    def get(self, name: str) -> Estimate | None:
        """Return the estimate of the quantity ``name``, None if it was refused."""
        return next((item.estimate for item in self.quantities if item.name == name), None)


def identify_geometry(recording: Recording, robot: RobotParams) -> Geometry:
    """Return all that ``recording`` tells; what it does not tell stands in ``refused``."""
    found = Geometry()
    _add_latency(found, recording, robot)
    _add_radius(found, recording, robot)
    _add_track(found, robot)
    return found


def _add_latency(found: Geometry, recording: Recording, robot: RobotParams) -> None:
    try:
        found.turns = fit_turns(recording, robot)
    except EstimatorError as error:
        found.refused[LATENCY] = found.refused[TRACK] = str(error)
        return
    found.quantities.append(Quantity(
        LATENCY, found.turns.latency, 's', 'of wheel_states against the gyro',
        'encoder.latency'))


def _add_radius(found: Geometry, recording: Recording, robot: RobotParams) -> None:
    if recording.reference is None:
        found.refused[RADIUS] = 'there is no reference of the pose'
        return
    latency = found.get(LATENCY) or Estimate(robot.encoder.latency, math.inf)
    turn_slip = TURN_SLIP
    if found.turns is not None:
        track = found.turns.slope.value * robot.wheel_radius
        turn_slip = min(max(1.0 - robot.track_width / track, 0.0), 1.0) if track > 0.0 else 0.0
    try:
        found.ways = fit_radius(recording.wheels, recording.reference, latency.value, robot,
                                turn_slip)
    except EstimatorError as error:
        found.refused[RADIUS] = str(error)
        return
    radius = found.ways.radius
    found.quantities.append(Quantity(RADIUS, radius, 'm', 'mean of the sides, with the slip that '
                                     'rolling straight takes', 'wheel_radius'))
    if found.turns is not None:
        unlike = found.turns.unlike
        sigma = math.hypot(radius.sigma, 0.5 * radius.value * unlike.sigma)
        for side, sign in (('left', -1.0), ('right', 1.0)):
            value = radius.value * (1.0 + 0.5 * sign * unlike.value)
            found.quantities.append(Quantity(f'{RADIUS}, {side}', Estimate(value, sigma), 'm'))


def _add_track(found: Geometry, robot: RobotParams) -> None:
    if found.turns is None:
        return
    slope = found.turns.slope
    radius = found.get(RADIUS) or Estimate(robot.wheel_radius, 0.0)
    track = Estimate(slope.value * radius.value, math.hypot(
        slope.sigma * radius.value, slope.value * radius.sigma))
    if not track.value > 0.0:
        found.refused[TRACK] = 'the robot turns against its wheels: are left and right swapped?'
    elif track.sigma > TRACK_LIMIT * track.value:
        found.refused[TRACK] = (f'standard error of {track.sigma / track.value:.0%}, expected at '
                                f'most {TRACK_LIMIT:.0%}')
    else:
        found.quantities.append(Quantity(TRACK, track, 'm', 'with the rolling radius above'
                                         if found.ways else 'with the wheel_radius given',
                                         'effective_track'))


def together(parts: list[Geometry]) -> Geometry:
    """
    Return what several recordings tell together: means weighted by the standard errors.

    Where they scatter more than their standard errors say, those grow accordingly.
    """
    if len(parts) == 1:
        return parts[0]
    merged = Geometry(turns=next((part.turns for part in parts if part.turns), None),
                      ways=next((part.ways for part in parts if part.ways), None))
    names = dict.fromkeys(item.name for part in parts for item in part.quantities)
    for name in names:
        same = [item for part in parts for item in part.quantities if item.name == name]
        merged.quantities.append(replace(
            same[0], estimate=weighted_mean([item.estimate for item in same])))
    for part in parts:
        merged.refused.update({name: why for name, why in part.refused.items()
                               if name not in names})
    return merged


def weighted_mean(estimates: list[Estimate]) -> Estimate:
    """Return the weighted mean; its sigma grows by the scatter beyond the sigmas (Birge)."""
    weights = [item.sigma ** -2 for item in estimates]
    value = sum(w * item.value for w, item in zip(weights, estimates)) / sum(weights)
    squares = sum(w * (item.value - value) ** 2 for w, item in zip(weights, estimates))
    birge = math.sqrt(max(1.0, squares / max(len(estimates) - 1, 1)))
    return Estimate(value, birge / math.sqrt(sum(weights)))
