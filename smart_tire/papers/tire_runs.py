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
Drives of the simulated robot for the figures of paper B, with the estimators of the robot.

Also: rendered images of an overhead camera above a drive, and what they show.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math

import numpy as np
from numpy.typing import NDArray

from smart_tire.analysis.friction_metrics import column, match
from smart_tire.analysis.metrics import compared_slips, SIDES, slip_scores, SlipScore
from smart_tire.analysis.overhead import estimates_of, INFO_TYPE
from smart_tire.analysis.pipeline import EstimatorParams, Pipeline
from smart_tire.arrays import Array
from smart_tire.bags.cdr import empty
from smart_tire.estimates import at
from smart_tire.messages.header import set_header
from smart_tire.models.tire import brush_tire
from smart_tire.models.vehicle.skid_steer import normal_loads
from smart_tire.numerics.least_squares import sandwich_covariance
from smart_tire.papers.printed import PrintedSlipEstimator
from smart_tire.parameters import (
    build, OverheadLocalizerParams, RobotParams, SimulatorParams, SlipEstimatorParams)
from smart_tire.parameters.overhead import ImageParams
from smart_tire.parameters.overhead import OverheadParams
from smart_tire.recording import SampleArrays, seconds
from smart_tire.samples import (
    Friction, GRAVITY, GroundState, ImuSample, NS_PER_S, WHEELS, WheelSample)
from smart_tire.simulation.offline import Schedule, simulate
from smart_tire.vision.detection import fill_image
from smart_tire.vision.overhead import CameraResult, OverheadLocalizer
from smart_tire.vision.renderer import between, Renderer

RPM = math.tau / 60.0       # rad/s
WHEEL = 'front_right'       # with the films
STANDSTILL_TIME = 1.0       # s before every drive
SETTLING_TIME = 2.0         # s of a drive that averages exclude
ROBOT = RobotParams()       # Table I of paper B
PEAK_SEARCH_MARGIN = 0.004  # m before and after a crossing, in the search of raw peaks
RENDERED_DURATIONS = {'concrete': 11.0, 'sand': 7.0}  # s: a circle, steady slip
CAMERA_HEIGHT = 3.5  # m of the camera above the floor, so that it sees this circle
IMAGE_RATE = 10.0     # Hz
IMAGE_SIZE, FOCAL_LENGTH = (960, 540), 750.0  # pixels; fewer than 1280 x 720 and 15 Hz save time


@dataclass(frozen=True)
class Drive:
    """A drive: inputs, estimates and truth."""

    inputs: SampleArrays
    estimates: SampleArrays
    printed: SampleArrays  # slips with B(7) as printed
    truth: SampleArrays
    begin_ns: int   # end of the settling time
    end_ns: int
    origin_ns: int  # start of the wheels


def drive(ground: str, schedule: Schedule, duration: float, seed: int = 1) -> Drive:
    """Return a drive of ``duration`` [s] after ``STANDSTILL_TIME`` on uniform ground."""
    params = build(SimulatorParams, {
        'seed': seed, 'ground.base': ground, 'ground.patches.names': [], 'film.wheels': [WHEEL]})
    pipeline, printed_filter = (
        Pipeline(EstimatorParams()), PrintedSlipEstimator(SlipEstimatorParams()))
    inputs, estimates, printed, truth = (SampleArrays() for _ in range(4))
    events = simulate(params, schedule, STANDSTILL_TIME + duration)
    for _, topic, sample in events:
        if topic.startswith('ground_truth/'):
            truth.add_sample(sample)
            continue
        inputs.add_sample(sample)
        found = pipeline.update(sample)
        for estimate in found:
            estimates.add_sample(estimate)
        for item in (*found, sample):
            if isinstance(item, (ImuSample, WheelSample, GroundState)):
                for estimate in printed_filter.update(item):
                    printed.add_sample(estimate)
    for estimate in pipeline.finish():
        estimates.add_sample(estimate)
    origin = int(inputs.stream(ImuSample).stamp_ns[0]) + round(STANDSTILL_TIME * NS_PER_S)
    return Drive(inputs, estimates, printed, truth, origin + round(SETTLING_TIME * NS_PER_S),
                 events[-1][0], origin)


def steady(left: float, right: float) -> Schedule:
    """Return constant wheel speeds [rpm] that start after ``STANDSTILL_TIME``."""
    return [(STANDSTILL_TIME, left, right)]


def side_slips(run: Drive, estimates: SampleArrays,
               reference: SampleArrays | None = None) -> dict[str, SlipScore]:
    """Return the slips of both sides after settling, against a reference or the truth."""
    scores = slip_scores(compared_slips(estimates.slips(), (reference or run.truth).slips()),
                         [(run.begin_ns, run.end_ns)])
    return {side: scores[side] for side in SIDES}


@dataclass(frozen=True)
class Crossings:
    """Film crossings, one row each (n,), with their truth."""

    speed: Array       # rpm, commanded
    slip: Array        # longitudinal, estimated
    total_slip: Array  # including lateral slip, estimated
    load: Array        # N, estimated
    stretch: Array     # V, q_sm of film 1 from the fitted waveform; NaN when braking
    stretch_sigma: Array
    raw_stretch: Array  # V, q_sm from raw samples as in the paper
    peak: Array         # m, x_m from the fitted waveform
    peak_sigma: Array
    raw_peak: Array  # m, x_m from raw samples
    true_slip: Array
    true_total_slip: Array
    true_load: Array
    true_stretch: Array  # V
    true_ratio: Array    # L_a / L

    def __len__(self) -> int:
        return len(self.slip)

    def take(self, mask: NDArray[np.bool_]) -> Crossings:
        """Return the rows selected by ``mask`` (n,)."""
        return Crossings(**{name: values[mask] for name, values in vars(self).items()})


def crossings(run: Drive, speed: float) -> Crossings:
    """Return the crossings of a settled drive that match a true one."""
    pairs = [(truth, own) for truth, own in match(run.estimates.crossings,
                                                  run.truth.crossings).pairs
             if own is not None and truth.stamp_ns > run.begin_ns]
    true = [truth for truth, _ in pairs]
    own = [estimate for _, estimate in pairs if estimate is not None]
    stamps = np.array([crossing.stamp_ns for crossing in own], np.int64)
    speeds_ns, speeds = run.inputs.speeds()
    rolling = ROBOT.wheel_radius * at(stamps, speeds_ns, speeds)[:, WHEELS.index(WHEEL)]
    raw = np.array([raw_peaks(run, crossing, float(v)) for crossing, v in zip(own, rolling)])
    raw_stretch, raw_interval = raw.reshape(-1, 2).T
    interval = column(own, 'peak_interval')
    return Crossings(
        np.full(len(own), speed), column(own, 'slip'), column(own, 'total_slip'),
        column(own, 'normal_load'), column(own, 'stretch_voltage'),
        column(own, 'stretch_voltage', sigmas=True), raw_stretch,
        ROBOT.tire.contact_length - interval * rolling,
        column(own, 'peak_interval', sigmas=True) * rolling,
        ROBOT.tire.contact_length - raw_interval * rolling,
        column(true, 'slip'), column(true, 'total_slip'), column(true, 'normal_load'),
        column(true, 'stretch_voltage'), column(true, 'adhesion_ratio'))


def concatenated(parts: list[Crossings]) -> Crossings:
    """Return the rows of all ``parts``."""
    return Crossings(**{name: np.concatenate([vars(part)[name] for part in parts])
                        for name in vars(parts[0])})


def raw_peaks(run: Drive, crossing: Friction, speed: float) -> tuple[float, float]:
    """
    Return q_sm [V] and dt_a [s] of film 1 from the extreme samples, as in the paper.

    q_sm is the maximum minus the magnitude of the minimum, dt_a the time between them. NaN if a
    sample is lost or the wheel brakes.
    """
    film, patch = ROBOT.film, ROBOT.tire.contact_length
    center = crossing.stamp_ns - round(0.5 * film.spacing / speed * NS_PER_S)
    # m of travel, from before the film is fully in the patch until after its release
    before = 0.5 * (patch - film.length) + PEAK_SEARCH_MARGIN
    after = 0.5 * (patch + film.length) + PEAK_SEARCH_MARGIN
    stamps, volts = run.inputs.films(WHEEL)
    distance = (stamps - center) / NS_PER_S * speed
    chosen = (-before < distance) & (distance < after)
    expected = (before + after) / speed * film.sample_rate
    if not crossing.slip.value > 0.0 or chosen.sum() < expected - 1.0:
        return math.nan, math.nan
    signal, times = volts[chosen, 0] - film.rest_voltage, stamps[chosen]
    top, low = int(np.argmax(signal)), int(np.argmin(signal))
    return float(signal[top] + signal[low]), float(times[low] - times[top]) / NS_PER_S


@dataclass(frozen=True)
class AccelerationFit:
    """C_x from the acceleration in a straight drive."""

    slip: Array       # mean of the four wheels
    force: Array      # N per wheel, from the IMU, without its mean
    effective: Array  # slip times the brush tire's 1 - t + t^2 / 3, without its mean
    stiffness: float   # N
    sigma: float       # N
    lag: float         # s, of the speed over ground in the true slip behind that of the wheels


SPEED_FREQUENCY = 2.7  # rad/s, of an oscillating speed; not a multiple of the block rate
HAC_BLOCKS = 5         # whose residuals may be correlated
BLOCK_SAMPLES = 10     # IMU samples averaged to one independent sample


def oscillating(time: float) -> tuple[float, float]:
    """Return the speeds [rpm] of a straight drive with acceleration and braking."""
    moving = time - STANDSTILL_TIME
    speed = 80.0 + 40.0 * math.sin(SPEED_FREQUENCY * moving) if moving > 0.0 else 0.0
    return speed, speed


def stiffness(run: Drive, mu: float) -> AccelerationFit:
    """
    Return C_x for brush-tire forces with friction coefficient ``mu``.

    A lag between the speeds of wheels and body in the true slip is fitted as well: the forces in a
    step of the simulation result from the speed over ground at its start, and a lag of one
    millisecond changes C_x by 2.6 %. The standard error allows for correlated residuals.
    """
    slips, imu = run.truth.slips(), run.inputs.stream(ImuSample)
    imu = imu.where((imu.stamp_ns > run.begin_ns) & (imu.stamp_ns < slips.stamp_ns[-1]))
    stamps, acceleration = imu.stamp_ns, imu['acceleration'][:, 0]
    ratio = at(stamps, slips.stamp_ns, slips.ratio).mean(axis=1)
    speeds_ns, speeds = run.inputs.speeds()
    rolling = ROBOT.wheel_radius * at(stamps, speeds_ns, speeds).mean(axis=1)
    slip, rolling, force = (_blocks(values) for values in (
        ratio, rolling, 0.25 * ROBOT.mass * acceleration))
    force = force - force.mean()
    loads = normal_loads(ROBOT, force / (0.25 * ROBOT.mass), 0.0)
    value, lag, rate = ROBOT.tire.longitudinal_stiffness, 0.0, np.zeros(len(slip))
    for _ in range(20):  # sliding part and slope depend weakly on stiffness and lag
        shape = np.mean([brush_tire.brush_force(slip + lag * rate, 0.0, mu, load, value)[0]
                         for load in loads.T], axis=0) / value
        # the fitted acceleration: noise of the measured one is part of the residuals, too
        rate = value * shape / (0.25 * ROBOT.mass * rolling)
        shape = shape - shape.mean()
        adhesion = brush_tire.adhesion_ratio(slip, mu, 0.25 * ROBOT.mass * GRAVITY, value)
        slope = value * adhesion ** 2 * rate
        matrix = np.column_stack([shape, slope - slope.mean()])
        change = np.linalg.lstsq(matrix, force - value * shape, rcond=None)[0]
        value, lag = value + float(change[0]), lag + float(change[1])
    residual = force - value * shape
    covariance = sandwich_covariance(matrix, residual, np.full(2, np.inf), HAC_BLOCKS)
    return AccelerationFit(slip, force, shape, value, math.sqrt(covariance[0, 0]), lag)


def _blocks(values: Array) -> Array:
    whole = values[:values.size // BLOCK_SAMPLES * BLOCK_SAMPLES]
    return whole.reshape(-1, BLOCK_SAMPLES).mean(axis=1)


@dataclass(frozen=True)
class View:
    """What the camera has found in a drive."""

    found: CameraResult
    params: OverheadLocalizerParams

    @cached_property
    def estimates(self) -> SampleArrays:
        """Return poses and slips."""
        return SampleArrays(estimates_of(self.found, ROBOT.wheel_radius))


def camera_view(run: Drive, duration: float) -> View:
    """Return what a camera above the path finds in the first ``duration`` [s]."""
    truth = run.truth.poses()
    time = seconds(truth.stamp_ns, run.origin_ns) + STANDSTILL_TIME
    driven = truth.pose[time <= duration, :2]
    x, y = (0.5 * (driven.min(axis=0) + driven.max(axis=0))).tolist()
    image = ImageParams(size=IMAGE_SIZE, focal_length=FOCAL_LENGTH,
                        position=(x, y, CAMERA_HEIGHT), rate=IMAGE_RATE)
    params = OverheadLocalizerParams(robot=ROBOT, overhead=OverheadParams(
        camera_position=image.position, camera_rotation=image.rotation))
    renderer = Renderer(image, params.overhead, ROBOT.wheel_radius)
    localizer = OverheadLocalizer(params)
    localizer.add_camera_info(renderer.camera.intrinsics.fill(empty(INFO_TYPE)))
    motion = between(time, truth.pose)
    for instant in np.arange(0.5 / IMAGE_RATE, min(duration, time[-1]), 1.0 / IMAGE_RATE).tolist():
        msg = fill_image(empty('sensor_msgs/msg/Image'), renderer.image(instant, motion))
        set_header(msg, run.origin_ns + round((instant - STANDSTILL_TIME) * NS_PER_S), '')
        localizer.add_image(msg)
    return View(localizer.result(run.inputs), params)
