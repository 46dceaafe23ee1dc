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
Robots drawn at random around the model of the estimators, and away from it.

``draw(row, seed)`` is one robot on the ground and the manoeuvres of a row:

>>> one = draw('sand_turn', 1001)
>>> one.robot.mass, one.true.mass != 10.9  # of the estimator, of the simulator
(10.9, True)

``one.events()`` are its messages with the ground truth. Seeds from ``TUNING_SEED`` on are for
tuning, those below for tests.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
import hashlib
import math
from pathlib import Path
import zlib

from benchmarks.events import cached_events, inputs_of, truth_of, without_efforts
from benchmarks.faults import delayed
from benchmarks.grounds import (
    CONCRETE, GRAVEL, ground, HEAVY_SURFACES, SAND, SURFACES, Surfaces, WET_TILES)
from benchmarks.robots import manoeuvres, plant
from benchmarks.robots.manoeuvres import Manoeuvre, MIXED
from benchmarks.robots.plant import (
    FALL_BEGIN, FALL_WIDTH, Lift, plant_with, Push, Traits)
from benchmarks.scenarios import Leg, sequence, STANDSTILL
from benchmarks.terrain import on_slopes
import numpy as np
from smart_tire.analysis.pipeline import EstimatorParams
from smart_tire.parameters import (
    FrictionEstimatorParams, RobotParams, SimulatorParams, SlipEstimatorParams)
from smart_tire.parameters.robot import MotorParams, TireParams, TreadFilmParams
from smart_tire.parameters.simulation import DriveParams, SensorErrorParams, SurfaceParams
from smart_tire.samples import Four, NS_PER_S, Sample, TireSample, WheelSample
from smart_tire.simulation.films import BUMP_HALF_WIDTHS
from smart_tire.simulation.offline import Event, simulate
from smart_tire.simulation.plant import LOAD_TRANSFER_TIME

Values = Mapping[str, tuple[float, ...]]

TUNING_SEED = 1001  # first of the seeds for tuning; those for tests are below
FILM = TreadFilmParams(wheels=('front_right', 'front_left'))
ICE = 'ice'
GROUNDS = {**SURFACES, ICE: (0.08, 40.0, 0.005)}  # mu [-], C_x [N], drag over load [-]
HEAVY = RobotParams(
    mass=30.0, wheel_radius=0.15, track_width=0.6, wheelbase=0.5, yaw_inertia=2.2,
    center_of_mass=(0.0, 0.0, 0.05),
    motor=MotorParams(torque_constant=3.0, coulomb_friction=0.4, inertia=0.04))
HEAVY_TIRE = TireParams(contact_length=0.08, longitudinal_stiffness=HEAVY_SURFACES[CONCRETE][1])
HEAVY_DRIVE = DriveParams(stall_torque=15.0)
PURE_BRUSH_SHARE = 1.0 / 3.0  # of the robots have no falling friction
HILLS = 0.030        # rad, slope of the row hills
PUSH_FORCE = 10.0    # N
PUSH_ARM = 0.1       # m, maximum arm of a push about the center of mass
PUSH_DURATION = 0.5  # s
LIFT_DURATION = 1.0  # s
STUCK_DURATION = 5.0  # s, in which a current is constant
DISTURBANCES = 5     # pushes, lifts; a current is stuck twice
CUT = 6.0            # s, missing before a start in motion


@dataclass(frozen=True)
class Distribution:
    """Distribution of a property: uniform between two limits, or Gaussian (mean, sigma)."""

    kind: str  # uniform, gaussian
    parameters: tuple[float, float]
    nominal: float  # as in the models, the simulator and the parameters of the estimators
    unit: str
    origin: str
    count: int = 1

    def draw(self, rng: np.random.Generator) -> tuple[float, ...]:
        """Return ``count`` values; Gaussian ones are within two and a half sigma."""
        first, second = self.parameters
        if self.kind == 'uniform':
            values = rng.uniform(first, second, self.count)
        else:
            values = first + second * np.clip(rng.standard_normal(self.count), -2.5, 2.5)
        return tuple(values.tolist())


GYRO_SCALE = 'gyro_scale'  # drawn on its own: the other properties are those of earlier tables
# Besides these, the simulator draws the turn-on biases and the tilt of the IMU, torque constants
# (4 % common, 1 % per motor), torque offsets and motor friction (10 %): SensorErrorParams.
DISTRIBUTIONS: Mapping[str, Distribution] = {
    'resistance_share': Distribution(
        'uniform', (0.0, 1.0), 1.0, '-', 'PHYSICS D, lateral share'),
    'stiffness_ratio': Distribution(
        'uniform', (0.6, 1.0), 1.0, '-', 'assumed, C_y / C_x'),
    'fall': Distribution(
        'uniform', (0.0, 0.45), 0.0, '-', 'Magic Formula, C = 1.65: falls to 0.52'),
    'relaxation_length': Distribution(
        'uniform', (0.0, 0.03), 0.0, 'm', 'up to 2/3 of the contact'),
    'load_transfer_time': Distribution(
        'uniform', (0.01, 0.06), LOAD_TRANSFER_TIME, 's', 'Plant: 0.02 s'),
    'slope': Distribution(
        'uniform', (0.0, 0.030), 0.0, 'rad', 'assumed, rms'),
    'center_of_mass': Distribution(
        'uniform', (-1.0, 1.0), 0.0, '-', 'of the range of the row', 2),
    'wheel_radius': Distribution(
        'uniform', (0.99, 1.01), 1.0, '-', 'assumed, of the nominal one'),
    'friction': Distribution(
        'uniform', (0.9, 1.1), 1.0, '-', 'mu of each surface, nominal', 5),
    'stiffness': Distribution(
        'uniform', (0.9, 1.1), 1.0, '-', 'C_x of each surface, nominal', 5),
    'drag': Distribution(
        'uniform', (0.9, 1.1), 1.0, '-', 'of each surface, nominal', 5),
    'stiffness_scale': Distribution(
        'gaussian', (1.0, 0.03), 1.0, '-', 'C_x of each tire', 4),
    'stamp_jitter': Distribution(
        'uniform', (0.0003, 0.0015), 0.001, 's', 'EncoderParams: 0.001 s'),
    'latency': Distribution(
        'uniform', (0.0, 0.010), 0.0, 's', 'of wheel_states, unknown'),
    'gain': Distribution(
        'gaussian', (1.0, 0.03), 1.0, '-', 'FilmParams.stretch_gain_tolerance', 4),
    'yaw_inertia': Distribution(
        'uniform', (0.9, 1.1), 1.0, '-', 'assumed, of the nominal one'),
    'mass': Distribution(
        'uniform', (0.97, 1.03), 1.0, '-', 'assumed, of the nominal one'),
    'bump_height': Distribution(
        'uniform', (0.08, 0.18), 0.125, '-', 'paper B, Fig. 11(b): 0.10-0.15', 2),
    'bump_distance': Distribution(
        'uniform', (0.008, 0.015), 0.010, 'm', 'paper B, Fig. 11(b)', 2),
    'bump_width': Distribution(
        'uniform', (0.007, 0.013), 0.009, 'm', 'paper B, Fig. 11(b)', 2),
    'bump_shape': Distribution('uniform', (0.0, len(BUMP_HALF_WIDTHS)), 0.0, '-', 'index'),
    GYRO_SCALE: Distribution(
        'gaussian', (1.0, 0.001), 1.0, '-', 'recordings of other robots: 0.0002 to 0.0035 off')}


@dataclass(frozen=True, kw_only=True)
class Row:
    """A row of the benchmark: ground, manoeuvres, disturbances and the required accuracy."""

    title: str
    base: str = CONCRETE
    manoeuvre: Manoeuvre = MIXED
    fields: tuple[tuple[str, float, float], ...] = ()  # surface, begin and end along x [m]
    sides: tuple[str, ...] = ()           # surfaces under the left and right side
    torque: bool = True
    slope: float | None = None            # rad; None: drawn
    center_of_mass: float = 0.010         # m, half range
    wheel_rate: float = 16.0              # Hz
    gears: float = 0.0                    # -, half range of gear friction and inertia, relative
    imu_arm: float = 0.0                  # m, standard deviation of the position of the IMU
    early_fall: bool = False              # friction falls before the peak of the force
    disturbance: str = ''                 # push, lift, stuck, cut
    platform: RobotParams = RobotParams()
    tire: TireParams = TireParams()
    drive: DriveParams = DriveParams()
    surfaces: Surfaces = field(default_factory=lambda: GROUNDS)
    mu: tuple[float, float] | None = None  # relative, required median and 90 %
    slip: float = 0.008                    # -, required rms while steady
    speed: float = 0.005                   # m/s, u
    lateral: float = 0.004                 # m/s, v_y


ROWS: Mapping[str, Row] = {
    'concrete': Row(title='concrete, 120/60 rpm and S-curves', manoeuvre=manoeuvres.concrete,
                    mu=(0.04, 0.08)),
    'slow_turn': Row(title='concrete, 60/80 rpm', manoeuvre=manoeuvres.slow_turn,
                     mu=(0.07, 0.15), slip=0.011),
    'sand_turn': Row(title='sand, 120/60 rpm', base=SAND, manoeuvre=manoeuvres.sand_turn,
                     mu=(0.06, 0.13), slip=0.010),
    'gravel': Row(title='gravel', base=GRAVEL, mu=(0.06, 0.13)),
    'wet_tiles': Row(title='wet tiles', base=WET_TILES, mu=(0.06, 0.13)),
    'sand_straight': Row(title='sand, straight, starts and stops', base=SAND,
                         manoeuvre=manoeuvres.sand_straight, mu=(0.08, 0.15), slip=0.010,
                         speed=0.008),
    'center_of_mass': Row(title='center of mass +-20 mm', center_of_mass=0.020,
                          manoeuvre=manoeuvres.mixed_with_spin, mu=(0.06, 0.12)),
    'jumps': Row(title='concrete, sand, gravel, concrete', manoeuvre=manoeuvres.across_fields,
                 fields=((SAND, 8.0, 15.0), (GRAVEL, 15.0, 22.0)), mu=(0.05, 0.12), slip=0.013),
    'border': Row(title='circles, outer wheels over a border to sand',
                  manoeuvre=manoeuvres.circles, fields=((SAND, 0.95, 9.0),), mu=(0.05, 0.12),
                  slip=0.013),
    'no_torque': Row(title='concrete, no torque', torque=False, mu=(0.08, 0.20)),
    'no_torque_sand': Row(title='sand, no torque', base=SAND, torque=False, mu=(0.08, 0.20),
                          slip=0.010),
    'no_torque_gravel': Row(title='gravel, no torque', base=GRAVEL, torque=False,
                            mu=(0.12, 0.25)),
    'hills': Row(title='hills, 30 mrad', slope=HILLS, mu=(0.05, 0.09)),
    'split': Row(title='concrete left, wet tiles right', sides=(CONCRETE, WET_TILES),
                 mu=(0.10, 0.22)),
    'split_gravel': Row(title='sand left, gravel right', sides=(SAND, GRAVEL), mu=(0.10, 0.22)),
    'heavy': Row(title='30 kg', platform=HEAVY, tire=HEAVY_TIRE, drive=HEAVY_DRIVE,
                 surfaces=HEAVY_SURFACES, mu=(0.05, 0.12)),
    'ice': Row(title='ice', base=ICE, slip=0.012),
    'slow_readings': Row(title='concrete, wheels at 4 Hz', wheel_rate=4.0),
    'pushes': Row(title='pushes of 10 N', disturbance='push', mu=(0.05, 0.12)),
    'lifted': Row(title='a wheel lifted', disturbance='lift', mu=(0.05, 0.12)),
    'stuck': Row(title='a current stuck', disturbance='stuck', mu=(0.05, 0.12)),
    'straight': Row(title='concrete, straight at 0.2 to 0.8 m/s, starts and stops',
                    manoeuvre=manoeuvres.walking_pace),
    'gears': Row(title='gear friction and inertia +-50 %', gears=0.5),
    'imu_arm': Row(title='IMU 0.1 m from its nominal position', imu_arm=0.1),
    'early_fall': Row(title='friction falls before the peak of the force', early_fall=True),
    'start_in_motion': Row(title='starts in motion', disturbance='cut', mu=(0.04, 0.08))}


FILMS, TORQUES = 'films', 'torques'


@dataclass(frozen=True)
class Draw:
    """A drawn robot: parameters of the estimator, of the simulator, and wheel speeds."""

    row: str
    seed: int
    robot: RobotParams        # nominal
    simulator: SimulatorParams
    traits: Traits
    legs: tuple[Leg, ...]
    duration: float           # s
    values: Values            # drawn properties, of DISTRIBUTIONS
    stuck: tuple[tuple[int, float], ...] = ()  # wheel and begin [s] of constant currents
    without: Collection[str] = ()  # inputs that other robots do not have: FILMS, TORQUES

    @property
    def true(self) -> RobotParams:
        """Return the true robot."""
        return self.simulator.robot

    @property
    def params(self) -> EstimatorParams:
        """Return the parameters of the estimators."""
        return EstimatorParams(SlipEstimatorParams(robot=self.robot),
                               FrictionEstimatorParams(robot=self.robot))

    def known_radius(self) -> Draw:
        """Return the same robot with the true wheel radius given to the estimators."""
        return replace(self, robot=replace(self.robot, wheel_radius=self.true.wheel_radius))

    def events(self) -> list[Event]:
        """Return all messages and ``ground_truth/*`` in order of reception."""
        row = ROWS[self.row]
        run = repr((_source(), self.simulator, self.traits, self.legs, self.duration,
                    row.wheel_rate))
        events = cached_events(run, self._simulated)
        if not row.torque or TORQUES in self.without:
            events = _without_efforts(events)
        if FILMS in self.without:
            events = [event for event in events if not isinstance(event[2], TireSample)]
        events = delayed(events, 'wheel_states', self.true.encoder.latency)
        start = events[0][0]
        for wheel, begin in self.stuck:
            events = _stuck(events, wheel, start + round(begin * NS_PER_S))
        if row.disturbance == 'cut':
            begin_ns = start + round(CUT * NS_PER_S)
            events = [event for event in events if event[2].stamp_ns >= begin_ns]
        return events

    def inputs(self) -> list[Sample]:
        """Return the samples that the estimators take."""
        return inputs_of(self.events())

    def truth(self) -> list[Sample]:
        """Return the ground truth."""
        return truth_of(self.events())

    def _simulated(self) -> list[Event]:
        events = simulate(self.simulator, self.legs, self.duration,
                          wheel_rate=ROWS[self.row].wheel_rate, plant=plant_with(self.traits))
        if not self.traits.slope:
            return events
        return on_slopes(events, self.true, self.traits.terrain)


def draw(name: str, seed: int, nominal: Collection[str] = ()) -> Draw:
    """
    Return the robot of row ``name`` with ``seed``.

    The properties ``nominal``, of ``DISTRIBUTIONS``, are not drawn: what each error costs.
    """
    row = ROWS[name]
    rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
    value = {one: distribution.draw(rng) for one, distribution in DISTRIBUTIONS.items()
             if one != GYRO_SCALE}
    value[GYRO_SCALE] = DISTRIBUTIONS[GYRO_SCALE].draw(np.random.default_rng(
        [seed, zlib.crc32(name.encode()), 2]))
    if row.slope is not None:
        value['slope'] = (row.slope,)
    own = np.random.default_rng([seed, zlib.crc32(name.encode()), 1])
    value['gears'] = tuple((1.0 + row.gears * own.uniform(-1.0, 1.0, 2)).tolist())
    value['imu_arm'] = tuple((row.imu_arm * own.standard_normal(2)).tolist())
    value |= {one: (DISTRIBUTIONS[one].nominal,) * len(value[one]) for one in nominal}
    robot = replace(row.platform, film=FILM, tire=row.tire, imu=replace(
        row.platform.imu, position_sigma=row.imu_arm))
    legs, duration = sequence(*((float(a), float(b), float(c)) for a, b, c in row.manoeuvre(rng)))
    simulator = SimulatorParams(
        seed=seed, ground=_ground(row, value), drive=row.drive,
        errors=_errors(value), robot=_true_robot(robot, row, value))
    pushes, lifts, stuck = _disturbances(row, duration, rng)
    value['fall'] = (value['fall'][0] * bool(rng.random() > PURE_BRUSH_SHARE),)
    onset = (0.4, 0.5) if row.early_fall else (FALL_BEGIN, FALL_WIDTH)
    if row.early_fall:
        value['fall'] = (own.uniform(0.2, 0.45),)
    traits = Traits(
        resistance_share=value['resistance_share'][0],
        stiffness_ratio=value['stiffness_ratio'][0],
        fall=value['fall'][0], fall_onset=onset, relaxation_length=value['relaxation_length'][0],
        load_transfer_time=value['load_transfer_time'][0],
        stiffness_scale=_four(value['stiffness_scale']), slope=value['slope'][0],
        terrain_seed=int(rng.integers(2**31)), sides=row.sides, pushes=pushes, lifts=lifts)
    return Draw(name, seed, robot, simulator, traits, legs, duration, value, stuck)


def _true_robot(robot: RobotParams, row: Row, value: Values) -> RobotParams:
    """Return the true robot behind the nominal ``robot``."""
    off_x, off_y = (row.center_of_mass * part for part in value['center_of_mass'])
    x, y, z = robot.center_of_mass
    motor, imu, (gears, inertia), arm = (
        robot.motor, robot.imu, value['gears'], value['imu_arm'])
    motor = replace(motor, coulomb_friction=motor.coulomb_friction * gears,
                    axle_friction=motor.axle_friction * gears, inertia=motor.inertia * inertia)
    imu = replace(imu, gyro_scale=value[GYRO_SCALE][0], position=(
        imu.position[0] + arm[0], imu.position[1] + arm[1], imu.position[2]))
    gains = [gain for wheel in robot.film.wheels for gain in robot.film.gains(wheel)]
    film = replace(robot.film, stretch_gain=tuple(
        gain * factor for gain, factor in zip(gains, value['gain'])))
    return replace(
        robot, wheel_radius=robot.wheel_radius * value['wheel_radius'][0],
        mass=robot.mass * value['mass'][0],
        yaw_inertia=robot.yaw_inertia * value['yaw_inertia'][0],
        center_of_mass=(x + off_x, y + off_y, z), film=film, motor=motor, imu=imu,
        encoder=replace(robot.encoder, stamp_jitter=value['stamp_jitter'][0],
                        latency=value['latency'][0]))


def _ground(row: Row, value: Values) -> SurfaceParams:
    scales = zip(*(value[one] for one in ('friction', 'stiffness', 'drag')))
    surfaces = {name: (mu * a, stiffness * b, drag * c) for (name, (mu, stiffness, drag)), (
        a, b, c) in zip(row.surfaces.items(), scales)}
    return ground(row.base, surfaces, row.fields)


def _errors(value: Values) -> SensorErrorParams:
    low, high = sorted(value['bump_height'])
    return SensorErrorParams(bumps=(low, high), bump_distance=value['bump_distance'],
                             bump_width=value['bump_width'],
                             bump_shape=tuple(BUMP_HALF_WIDTHS)[int(value['bump_shape'][0])])


def _disturbances(row: Row, duration: float, rng: np.random.Generator) -> tuple[
        tuple[Push, ...], tuple[Lift, ...], tuple[tuple[int, float], ...]]:
    """Return pushes, lifts and stuck currents, one in each part of the drive."""
    edges = np.linspace(STANDSTILL + 3.0, duration - STUCK_DURATION, DISTURBANCES + 1)
    begins = rng.uniform(edges[:-1], edges[1:] - LIFT_DURATION).tolist()
    wheels = rng.integers(4, size=DISTURBANCES).tolist()
    if row.disturbance == 'push':
        angles, arms = (rng.uniform(-limit, limit, DISTURBANCES).tolist()
                        for limit in (math.pi, PUSH_ARM))
        pushes = [Push(begin, begin + PUSH_DURATION,
                       (PUSH_FORCE * math.cos(angle), PUSH_FORCE * math.sin(angle)),
                       PUSH_FORCE * arm)
                  for begin, angle, arm in zip(begins, angles, arms)]
        return tuple(pushes), (), ()
    if row.disturbance == 'lift':
        return (), tuple(Lift(begin, begin + LIFT_DURATION, wheel)
                         for begin, wheel in zip(begins, wheels)), ()
    if row.disturbance == 'stuck':
        return (), (), tuple(zip(wheels, begins))[::3]
    return (), (), ()


def _without_efforts(events: Sequence[Event]) -> list[Event]:
    samples = without_efforts(sample for _, _, sample in events)
    return [(received, topic, sample)
            for (received, topic, _), sample in zip(events, samples)]


def _stuck(events: Sequence[Event], wheel: int, begin_ns: int) -> list[Event]:
    """Return ``events`` with a constant torque of ``wheel`` for ``STUCK_DURATION``."""
    end_ns = begin_ns + round(STUCK_DURATION * NS_PER_S)
    value: float | None = None
    result: list[Event] = []
    for received, topic, sample in events:
        if isinstance(sample, WheelSample) and sample.effort and (
                begin_ns <= sample.stamp_ns < end_ns):
            value = sample.effort[wheel] if value is None else value
            effort = list(sample.effort)
            effort[wheel] = value
            sample = replace(sample, effort=_four(effort))
        result.append((received, topic, sample))
    return result


def _four(values: Sequence[float]) -> Four:
    fl, fr, rl, rr = values
    return fl, fr, rl, rr


def _source() -> str:
    """Return a digest of the plant of the drawn robots, for the cache of events."""
    return hashlib.sha256(Path(plant.__file__).read_bytes()).hexdigest()
