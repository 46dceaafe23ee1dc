# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Example crossings with their fitted waveforms, for a figure."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.friction.grid import Case, WHEEL
from benchmarks.friction.methods import estimator_params, WAVEFORM
from benchmarks.friction.records import SINGLE
from benchmarks.friction.synthesis import CrossingSynthesizer
import numpy as np
from smart_tire.analysis.series import Floats
from smart_tire.errors import EstimatorError
from smart_tire.estimation.contact.records import CrossingSamples, FilmSamples
from smart_tire.estimation.friction.output import OutputBuilder
from smart_tire.estimation.friction.waveform_model import WaveformModel
from smart_tire.parameters import RobotParams

CURVE_STEP = 1e-4  # m, between points of a drawn curve


@dataclass(frozen=True)
class FilmExample:
    """One film: samples and fit above the baseline [V], over the rolled distance [m]."""

    number: int
    distance: Floats        # (n,)
    volts: Floats
    residual: Floats        # V, samples minus fit
    curve_distance: Floats  # (m,)
    fitted: Floats


@dataclass(frozen=True)
class Example:
    """A fitted crossing of all films."""

    films: list[FilmExample]
    mu: tuple[float, float]  # estimate, standard deviation
    truth: float
    noise: float             # V, standard deviation of a sample, including quantization


def example(slip: float, seed: int = 1) -> Example:
    """Return a crossing on concrete at 60 rpm, fitted."""
    case = Case(slip=slip)
    synthesizer, robot = CrossingSynthesizer(case, seed), case.robot
    crossing = synthesizer.crossing()
    output = OutputBuilder(WHEEL, estimator_params(WAVEFORM, robot))
    result = output.method.measure(crossing)
    if result is None or result.waveform is None:
        raise EstimatorError(f'the crossing of seed {seed} with slip {slip:g} was not fitted')
    estimate, fit = output.build(crossing, result, synthesizer.state()), result.waveform
    return Example(_films(robot, fit.samples, fit.parameters),
                   estimate.quantity(SINGLE), case.mu,
                   float(np.sqrt(robot.film.sample_variance)))


def _films(robot: RobotParams, crossing: CrossingSamples, parameters: Floats) -> list[FilmExample]:
    fine = []
    for one in crossing.films:
        distance = np.arange(one.distance[0], one.distance[-1], CURVE_STEP)
        none = np.zeros(len(distance))
        fine.append(FilmSamples(one.film, distance, none, none.astype(np.int8)))
    fitted, curves = (_output(robot, crossing, films, parameters)
                      for films in (list(crossing.films), fine))
    return [FilmExample(one.film + 1, one.distance, one.volts, one.volts - value, dense.distance,
                        curve)
            for one, value, dense, curve in zip(crossing.films, fitted, fine, curves)]


def _output(robot: RobotParams, crossing: CrossingSamples, films: list[FilmSamples],
            parameters: Floats) -> list[Floats]:
    """Return the model output at the distances of ``films``, film by film."""
    model = WaveformModel(robot, robot.film.gains(WHEEL), films, crossing.reference)
    output, _ = model.linearized(parameters)
    ends = np.cumsum([len(one.distance) for one in films])
    return np.split(output, ends[:-1])
