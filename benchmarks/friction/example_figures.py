"""A passage with the fit of its whole waveform, to be drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.friction.grid import Case, WHEEL
from benchmarks.friction.methods import estimator_params, WAVEFORM
from benchmarks.friction.records import SINGLE
from benchmarks.friction.synthesis import EXACT, Synthesiser
from smart_tire.analysis.series import Floats
from smart_tire.errors import EstimatorError
from smart_tire.estimation.contact.records import CrossingSamples, FilmSamples
from smart_tire.estimation.friction.output import OutputBuilder
from smart_tire.estimation.friction.waveform_fit import CrossingSlipPrior, WaveformFitter
from smart_tire.estimation.friction.waveform_model import WaveformModel
from smart_tire.parameters import RobotParams
from smart_tire.uncertain import Uncertain

FINE = 1e-4  # m, between points of a drawn curve


@dataclass(frozen=True)
class FilmExample:
    """One film: samples and fit above rest [V], over the rolled distance [m]."""

    number: int
    way: Floats     # (n,)
    volts: Floats
    left: Floats    # V, samples minus fit
    fine: Floats    # (m,)
    fitted: Floats


@dataclass(frozen=True)
class Example:
    """A passage of all films."""

    films: list[FilmExample]
    mu: tuple[float, float]  # that was told, and one sigma
    truth: float
    noise: float             # V, one sigma of a sample, rounding included


def example(slip: float, seed: int = 1) -> Example:
    """Return a passage on concrete at 60 rpm, fitted with the true slip."""
    case = Case(slip=slip)
    source, robot = Synthesiser(case, seed), case.robot
    passage = source.passage()
    told = OutputBuilder(WHEEL, estimator_params(WAVEFORM, robot)).build(
        passage, source.motion())
    fitter = WaveformFitter(robot, robot.film.gains(WHEEL), robot.film.bending(WHEEL))
    fit = None if passage.samples is None else fitter.fit(
        passage.samples, CrossingSlipPrior(Uncertain(slip, EXACT)))
    if passage.samples is None or fit is None:
        raise EstimatorError(f'the passage of seed {seed} at a slip of {slip:g} was not fitted')
    return Example(_films(robot, passage.samples, fit.parameters),
                   told.quantity(SINGLE), case.mu,
                   float(np.sqrt(robot.film.sample_variance)))


def _films(robot: RobotParams, passage: CrossingSamples, parameters: Floats) -> list[FilmExample]:
    fine = []
    for one in passage.films:
        way = np.arange(one.distance[0], one.distance[-1], FINE)
        none = np.zeros(len(way))
        fine.append(FilmSamples(one.film, way, none, none.astype(np.int8)))
    fitted, curves = (_output(robot, passage, films, parameters)
                      for films in (list(passage.films), fine))
    return [FilmExample(one.film + 1, one.distance, one.volts, one.volts - value, dense.distance,
                        curve)
            for one, value, dense, curve in zip(passage.films, fitted, fine, curves)]


def _output(robot: RobotParams, passage: CrossingSamples, films: list[FilmSamples],
            parameters: Floats) -> list[Floats]:
    """Return the model's output at the places of ``films``, film by film."""
    model = WaveformModel(robot, robot.film.gains(WHEEL), films, passage.reference)
    output, _ = model.linearised(parameters)
    ends = np.cumsum([len(one.distance) for one in films])
    return np.split(output, ends[:-1])
