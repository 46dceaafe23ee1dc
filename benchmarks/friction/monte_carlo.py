"""Passages of a case through the estimator, and read as the paper does, with the true slip."""

from __future__ import annotations

from dataclasses import dataclass
import math
import time

import numpy as np

from benchmarks.friction.cramer_rao import friction_bound
from benchmarks.friction.grid import Case, LOAD, WHEEL
from benchmarks.friction.methods import estimator_params, EXACT_MAP, PRINTED_MAP, WAVEFORM
from benchmarks.friction.paper_method import friction_read_off
from benchmarks.friction.records import SINGLE
from benchmarks.friction.scoring import spread
from benchmarks.friction.synthesis import Synthesiser
from smart_tire.analysis.series import Floats
from smart_tire.estimation.contact.records import PatchCrossing
from smart_tire.estimation.friction.motion_history import WheelMotion
from smart_tire.estimation.friction.output import OutputBuilder
from smart_tire.samples import Friction


@dataclass(frozen=True)
class Trial:
    """What one method told of the passages of a case; errors are relative to the true mu."""

    told: float    # share of the passages
    bias: float    # median error
    spread: float  # standard deviation, from the interquartile range
    large: float   # size that 90 % of the errors stay below
    nees: float    # mean normalised squared error: 1 is right; NaN without sigmas
    ms: float      # CPU time per passage, without that for finding it


@dataclass(frozen=True)
class CaseResult:
    """What all methods told of the passages of a case."""

    group: str
    case: Case
    bound: float   # of Cramer and Rao, relative
    passages: int
    found: float   # share of the passages that the first look saw, both films
    trials: dict[str, Trial]


def run_case(group: str, case: Case, count: int, seed: int = 1) -> CaseResult:
    """Return what all methods that can take the case tell of ``count`` passages."""
    source = Synthesiser(case, seed)
    passages, motion = [source.passage() for _ in range(count)], source.motion()
    told, ms = _report(passages, motion, case, WAVEFORM)
    trials = {WAVEFORM: trial(_column(told, SINGLE), case.mu, ms, sigma=np.array(
        [one.quantity(SINGLE).sigma for one in told]))}
    if case.release == 'fig8' and case.slip > 0.0:  # what two peaks can tell
        told, ms = _report(passages, motion, case, PRINTED_MAP)
        interval, constant = _column(told, 'peak_interval'), np.ones(count)
        for method in (EXACT_MAP, PRINTED_MAP):
            trials[method] = trial(friction_read_off(
                interval, case.speed * constant, case.total_slip * constant, LOAD * constant,
                case.robot, method), case.mu, ms)
    whole = [one.samples is not None and len(one.samples.films) == 2 for one in passages]
    return CaseResult(group, case, friction_bound(
        case.robot, WHEEL, slip=case.slip, sliding=case.sliding, speed=case.speed), count,
        float(np.mean(whole)), trials)


def _report(passages: list[PatchCrossing], motion: WheelMotion, case: Case,
            method: str) -> tuple[list[Friction], float]:
    """Return what one method says, and CPU time per passage [ms]."""
    reporter = OutputBuilder(WHEEL, estimator_params(method, case.robot))
    begin = time.thread_time()
    told = [reporter.build(passage, motion) for passage in passages]
    return told, 1e3 * (time.thread_time() - begin) / len(passages)


def _column(told: list[Friction], name: str) -> Floats:
    return np.array([one.quantity(name).value for one in told])


def trial(value: Floats, truth: float, ms: float, sigma: Floats | None = None) -> Trial:
    """Return the scores of estimates of ``truth``; those that are NaN were not told."""
    told = np.isfinite(value)
    error = value[told] / truth - 1.0
    if not len(error):
        return Trial(0.0, math.nan, math.nan, math.nan, math.nan, ms)
    nees = (math.nan if sigma is None
            else float(np.mean(((value[told] - truth) / sigma[told])**2)))
    return Trial(float(np.mean(told)), float(np.median(error)), spread(error),
                 float(np.quantile(np.abs(error), 0.9)), nees, ms)
