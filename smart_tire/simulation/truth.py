"""Ground truth of the simulated robot: motion, slip, and what each passage should tell."""

from __future__ import annotations

from collections.abc import Iterator
import math

import numpy as np

from smart_tire import rotation
from smart_tire.arrays import Array
from smart_tire.messages import topic_of
from smart_tire.models.tire import brush_tire, tread_film
from smart_tire.models.vehicle import skid_steer
from smart_tire.parameters.robot import RobotParams
from smart_tire.samples import Four, Friction, FRICTION_QUANTITIES, NAN, Odometry, WheelSlip
from smart_tire.simulation.films import FilmSampler, locate, Trace
from smart_tire.simulation.plant import Plant


Truth = Odometry | WheelSlip | Friction

EXACT = (0.0,) * 36
MEANS = ('rolling_speed', 'slip', 'total_slip', 'friction', 'load', 'stiffness', 'force')


def truth_topic(truth: Truth) -> str:
    """Return the name of the topic that ``truth`` travels on."""
    return f'ground_truth/{topic_of(truth)}'


def true_odometry(plant: Plant, stamp_ns: int) -> Odometry:
    """Return pose and twist of the plant; ``odom`` is where it started."""
    x, y, yaw = plant.start
    cos, sin = math.cos(yaw), math.sin(yaw)
    position = (cos * (plant.x - x) + sin * (plant.y - y),
                cos * (plant.y - y) - sin * (plant.x - x), 0.0)
    return Odometry(stamp_ns, position, rotation.quaternion(0.0, 0.0, plant.yaw - yaw),
                    (plant.v_x, plant.v_y, 0.0), (0.0, 0.0, plant.yaw_rate), EXACT, EXACT)


def true_slip(plant: Plant, robot: RobotParams, stamp_ns: int) -> WheelSlip:
    """Return the slips of the plant; undefined at standstill."""
    rolling = robot.wheel_radius * np.array(plant.wheel_speed)
    ground = np.array(plant.wheel_v_x)
    ratio = skid_steer.slip_ratio(rolling, ground, robot.slip.standstill_speed)
    return WheelSlip(stamp_ns, _four(ratio), _four(rolling - ground),
                     _four(np.where(np.isnan(ratio), 1.0, 0.0)))


def _four(values: Array) -> Four:
    fl, fr, rl, rr = values.tolist()
    return fl, fr, rl, rr


class PassageTruth:
    """
    Finds the passages of a group of one wheel's films, a pair, say, through the whole patch.

    ``group`` are the films' indices, those of the first group by default.
    """

    def __init__(self, films: FilmSampler, robot: RobotParams,
                 group: tuple[int, ...] | None = None) -> None:
        group = robot.film_groups[0] if group is None else group
        self._wheel, self._robot = films.wheel, robot
        self._first, last = films.places[group[0]], films.places[group[-1]]
        self._middle = 0.5 * (self._first + last)  # rad
        # film 1 is in the first group only
        self._gain = robot.film.gains(films.wheel)[0] if group[0] == 0 else NAN
        # m, from the patch's middle to where the films are completely outside
        self._half = 0.5 * (robot.wheel_radius * (last - self._first) + robot.film.length
                            + robot.tire.contact_length)
        self._last: tuple[int, float] | None = None  # stamp and place of the films before
        self._entry = 0.0      # -1 or 1: where the present passage began; 0: none
        self._middle_ns = 0
        self._sums = np.zeros((2, len(MEANS)))  # sums and counts while the first is inside

    def update(self, trace: Trace) -> list[Friction]:
        """Return the passages that ended in ``trace``; traces come one after the other."""
        radius = self._robot.wheel_radius
        pair, _ = locate(trace.angle, self._middle, radius)
        if self._last is not None and not self._entry and np.all(np.abs(pair) >= self._half):
            self._last = trace.stamps_ns[-1], float(pair[-1])
            return []
        return list(self._follow(trace, pair.tolist()))

    def _follow(self, trace: Trace, pair: list[float]) -> Iterator[Friction]:
        table = self._table(trace)
        for i, (stamp_ns, place) in enumerate(zip(trace.stamps_ns, pair)):
            last_ns, last_place = self._last or (stamp_ns, place)
            inside, was_inside = abs(place) < self._half, abs(last_place) < self._half
            if inside and not was_inside:
                self._entry = math.copysign(1.0, last_place)
                self._sums[:] = 0.0
            if self._entry and (place < 0.0) != (last_place < 0.0):
                share = last_place / (last_place - place)
                self._middle_ns = last_ns + round(share * (stamp_ns - last_ns))
            if inside and self._entry:
                self._sums += table[i]
            if was_inside and not inside:
                if self._entry and (place > 0.0) != (self._entry > 0.0):
                    yield self._passage()
                self._entry = 0.0
            self._last = stamp_ns, place

    def _table(self, trace: Trace) -> Array:
        """Return values and weights of ``MEANS``, shape (n, 2, means)."""
        tire, robot = self._robot.tire, self._robot
        past, _ = locate(trace.angle, self._first, robot.wheel_radius)
        inside = np.abs(past) <= 0.5 * (tire.contact_length - robot.film.length)
        s_x, s_y = trace.slip_vector()
        force, _ = brush_tire.brush_force(s_x, s_y, trace.friction, trace.load, trace.stiffness)
        slip = skid_steer.slip_ratio(trace.rolling_speed, trace.v_x, robot.slip.standstill_speed)
        values = np.stack([trace.rolling_speed, slip, np.hypot(s_x, s_y), trace.friction,
                           trace.load, trace.stiffness, force])
        valid = inside & np.isfinite(values)
        return np.stack([np.where(valid, values, 0.0), valid]).transpose(2, 0, 1)

    def _passage(self) -> Friction:
        sums, counts = self._sums
        means = np.divide(sums, counts, out=np.full(len(MEANS), np.nan), where=counts > 0.0)
        value = self._quantities(**dict(zip(MEANS, means.tolist())))
        sigma = {name: math.inf if math.isnan(value[name]) else 0.0
                 for name in FRICTION_QUANTITIES}
        return Friction(self._middle_ns, self._wheel, value, sigma)

    def _quantities(self, *, rolling_speed: float, slip: float, total_slip: float,
                    friction: float, load: float, stiffness: float,
                    force: float) -> dict[str, float]:
        """Return FRICTION_QUANTITIES as they follow from the means of a passage."""
        film, length = self._robot.film.length, self._robot.tire.contact_length
        critical = float(brush_tire.critical_slip(friction, load, stiffness))
        ratio = float(brush_tire.adhesion_ratio(total_slip, friction, load, stiffness))
        stretch = interval = NAN
        if slip > 0.0 and not math.isnan(self._gain):  # two peaks exist in traction only
            x_m = float(tread_film.peak_position(ratio * length, film, length))
            stretch = self._gain * float(tread_film.stretch_integral(
                x_m, slip, total_slip, critical, film, length))
            interval = (length - x_m) / abs(rolling_speed)
        return {
            'friction_coefficient': friction, 'friction_coefficient_single': friction,
            'adhesion_ratio': ratio, 'adhesion_length': ratio * length,
            'stretch_voltage': stretch, 'peak_interval': interval,
            'slip': slip, 'film_slip': slip, 'total_slip': total_slip,
            'normal_load': load, 'stiffness': stiffness, 'critical_slip': critical,
            'traction_force': force}
