"""Drives of the simulated robot behind paper B's figures, estimated as on the real one."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.analysis.friction_metrics import column, match
from smart_tire.analysis.metrics import SIDES, slip_scores, SlipScore
from smart_tire.analysis.pipeline import EstimatorParams, Pipeline
from smart_tire.analysis.series import at, Floats, Series, Stamps
from smart_tire.models.tire import brush_tire
from smart_tire.models.vehicle import skid_steer
from smart_tire.parameters import build, RobotParams, SimulatorParams
from smart_tire.reproduction.experiments import Laboratory, Schedule
from smart_tire.samples import Friction, ImuSample, NS_PER_S, WHEELS

RPM = math.tau / 60.0  # rad/s
WHEEL = 'front_right'  # with the films
START = 1.0            # s of standstill before every drive
SETTLE = 2.0           # s after it that means leave out
ROBOT = RobotParams()  # paper B's Table I
MARGIN = 0.004         # m around a passage in which raw peaks are looked for


@dataclass(frozen=True)
class Run:
    """A drive: what came in, what was estimated, and what was true."""

    inputs: Series
    estimates: Series
    truth: Series
    acceleration: Floats   # (n,) m/s2, forward, of the IMU ...
    stamp_ns: Stamps       # ... and its stamps (n,)
    begin_ns: int          # when the wheels had settled
    end_ns: int
    origin_ns: int         # when the wheels began to turn


def drive(laboratory: Laboratory, ground: str, schedule: Schedule, duration: float,
          seed: int = 1) -> Run:
    """Return a drive of ``duration`` [s] after ``START`` on ground that is the same everywhere."""
    params = build(SimulatorParams, {
        'seed': seed, 'ground.base': ground, 'ground.patches': [], 'film.wheels': [WHEEL]})
    pipeline = Pipeline(EstimatorParams())
    inputs, estimates, truth = Series(), Series(), Series()
    imu: list[tuple[int, float]] = []
    newest = 0
    for receive_ns, topic, sample in laboratory.drive(params, schedule, START + duration):
        newest = receive_ns
        if topic.startswith('ground_truth/'):
            truth.add(sample)
            continue
        if isinstance(sample, ImuSample):
            imu.append((sample.stamp_ns, sample.acceleration[0]))
        inputs.add(sample)
        for estimate in pipeline.update(sample):
            estimates.add(estimate)
    stamps = np.array([stamp for stamp, _ in imu], np.int64)
    origin = int(stamps[0]) + round(START * NS_PER_S)
    return Run(inputs, estimates, truth, np.array([a for _, a in imu]), stamps,
               origin + round(SETTLE * NS_PER_S), newest, origin)


def steady(left: float, right: float) -> Schedule:
    """Return wheel speeds [rpm] that begin after ``START``."""
    return [(START, left, right)]


def side_slips(run: Run) -> dict[str, SlipScore]:
    """Return the slips of both sides once settled, against the truth."""
    scores = slip_scores(run.estimates.slips(), run.truth.slips(), [(run.begin_ns, run.end_ns)])
    return {side: scores[side] for side in SIDES}


@dataclass(frozen=True)
class Passages:
    """Passages of the films, one row each (n,); truth is that of the same passage."""

    speed: Floats          # rpm that the wheel was told
    slip: Floats           # longitudinal, estimated
    total_slip: Floats     # with the lateral one, estimated
    load: Floats           # N, estimated
    stretch: Floats        # V, q_sm of film 1 from the fitted waveform; NaN when braking
    stretch_sigma: Floats
    raw_stretch: Floats    # V, the same read off the raw samples as in the paper
    peak: Floats           # m, x_m from the fitted waveform
    peak_sigma: Floats
    raw_peak: Floats       # m, the same from raw samples
    true_slip: Floats
    true_total_slip: Floats
    true_load: Floats
    true_stretch: Floats   # V
    true_ratio: Floats     # L_a / L

    def __len__(self) -> int:
        return len(self.slip)

    def take(self, mask: NDArray[np.bool_]) -> Passages:
        """Return the rows that ``mask`` (n,) chooses."""
        return Passages(**{name: values[mask] for name, values in vars(self).items()})


def passages(run: Run, speed: float) -> Passages:
    """Return the passages of a settled drive with a matching truth."""
    pairs = [(truth, own) for truth, own in match(run.estimates.passages,
                                                  run.truth.passages).pairs
             if own is not None and truth.stamp_ns > run.begin_ns]
    true, own = [truth for truth, _ in pairs], [guess for _, guess in pairs if guess is not None]
    stamps = np.array([passage.stamp_ns for passage in own], np.int64)
    speeds_ns, speeds = run.inputs.speeds()
    rolling = ROBOT.wheel_radius * at(stamps, speeds_ns, speeds)[:, WHEELS.index(WHEEL)]
    raw = np.array([raw_peaks(run, passage, float(v)) for passage, v in zip(own, rolling)])
    raw_stretch, raw_interval = raw.reshape(-1, 2).T
    interval = column(own, 'peak_interval')
    return Passages(
        np.full(len(own), speed), column(own, 'slip'), column(own, 'total_slip'),
        column(own, 'normal_load'), column(own, 'stretch_voltage'),
        column(own, 'stretch_voltage', sigmas=True), raw_stretch,
        ROBOT.tire.contact_length - interval * rolling,
        column(own, 'peak_interval', sigmas=True) * rolling,
        ROBOT.tire.contact_length - raw_interval * rolling,
        column(true, 'slip'), column(true, 'total_slip'), column(true, 'normal_load'),
        column(true, 'stretch_voltage'), column(true, 'adhesion_ratio'))


def joined(parts: list[Passages]) -> Passages:
    """Return the rows of all ``parts``."""
    return Passages(**{name: np.concatenate([vars(part)[name] for part in parts])
                       for name in vars(parts[0])})


def raw_peaks(run: Run, passage: Friction, speed: float) -> tuple[float, float]:
    """
    Return q_sm [V] and dt_a [s] of film 1 as the paper reads them: off the largest samples.

    q_sm is the highest minus the depth of the lowest sample, dt_a the time between them. NaN
    where a sample is lost or the wheel brakes.
    """
    film, patch = ROBOT.film, ROBOT.tire.contact_length
    middle = passage.stamp_ns - round(0.5 * film.spacing / speed * NS_PER_S)
    before = 0.5 * (patch - film.length) + MARGIN  # m of travel, to just before it is all inside
    after = 0.5 * (patch + film.length) + MARGIN   # m, to just behind its release
    stamps, volts = run.inputs.films(WHEEL)
    past = (stamps - middle) / NS_PER_S * speed
    chosen = (-before < past) & (past < after)
    expected = (before + after) / speed * film.sample_rate
    if not passage.value['slip'] > 0.0 or chosen.sum() < expected - 1.0:
        return math.nan, math.nan
    signal, times = volts[chosen, 0] - film.rest_voltage, stamps[chosen]
    top, low = int(np.argmax(signal)), int(np.argmin(signal))
    return float(signal[top] + signal[low]), float(times[low] - times[top]) / NS_PER_S


@dataclass(frozen=True)
class StiffnessFit:
    """C_x from how a straight run accelerates."""

    slip: Floats       # mean of the four wheels
    force: Floats      # N per wheel, from the IMU, without its mean
    effective: Floats  # slip times the brush tire's 1 - t + t^2 / 3, without its mean
    stiffness: float   # N
    sigma: float       # N


WAVE = 2.7  # rad/s, of a speed that goes up and down; no period of blocks
BLOCK = 20  # IMU samples that are averaged to one independent one


def wavy(time: float) -> tuple[float, float]:
    """Return the speeds [rpm] of a straight run that speeds up and slows down."""
    speed = 80.0 + 40.0 * math.sin(WAVE * (time - START)) if time > START else 0.0
    return speed, speed


def stiffness(run: Run, mu: float) -> StiffnessFit:
    """Return C_x for forces that follow the brush tire with ``mu``."""
    slips = run.truth.slips()
    chosen = (run.stamp_ns > run.begin_ns) & (run.stamp_ns < slips.stamp_ns[-1])
    stamps = run.stamp_ns[chosen]
    slip = _blocks(at(stamps, slips.stamp_ns, slips.ratio).mean(axis=1))
    force = _blocks(0.25 * ROBOT.mass * run.acceleration[chosen])
    load = 0.25 * ROBOT.mass * skid_steer.GRAVITY
    force, value = force - force.mean(), ROBOT.tire.longitudinal_stiffness
    for _ in range(20):  # the share of sliding depends on the stiffness, weakly
        shape = brush_tire.brush_force(slip, 0.0, mu, load, value)[0] / value
        shape = shape - shape.mean()
        value = float(shape @ force / (shape @ shape))
    rest = force - value * shape
    sigma = math.sqrt(float(rest @ rest) / (rest.size - 2) / float(shape @ shape))
    return StiffnessFit(slip, force, shape, value, sigma)


def _blocks(values: Floats) -> Floats:
    whole = values[:values.size // BLOCK * BLOCK]
    return whole.reshape(-1, BLOCK).mean(axis=1)
