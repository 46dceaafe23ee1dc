"""Passages at many slips as points of paper B's Fig. 12 and 13: fitted, and read off raw peaks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.friction.grid import Case, WHEEL
from benchmarks.friction.methods import estimator_params, EXACT_MAP, PRINTED_MAP, WAVEFORM
from benchmarks.friction.paper_method import ratio_read_off
from benchmarks.friction.synthesis import Synthesiser
from smart_tire.analysis.series import Floats
from smart_tire.estimation.friction.output import OutputBuilder
from smart_tire.samples import Friction

SLIPS = np.linspace(0.01, 0.3, 59)  # -, of either sign


@dataclass(frozen=True)
class Points:
    """Passages at one wheel speed, one row per slip (n,); two peaks only where there are two."""

    slip: Floats
    stretch: Floats        # V, q_sm of film 1
    stretch_sigma: Floats
    ratio: Floats          # -, L_a / L
    ratio_sigma: Floats
    raw_stretch: Floats
    raw_ratio: dict[str, Floats]  # by the map of EXACT_MAP and PRINTED_MAP


def paper_points(rpm: float, seed: int = 1) -> Points:
    """Return the passages of a wheel at ``rpm`` on concrete, with exact gains and true slip."""
    slips = np.concatenate([-SLIPS[::-1], SLIPS])
    fitted, raw, case = [], [], Case(slip=0.1, rpm=rpm)
    reporters = {method: OutputBuilder(WHEEL, estimator_params(method, case.robot))
                 for method in (WAVEFORM, PRINTED_MAP)}
    for i, slip in enumerate(slips.tolist()):
        source = Synthesiser(Case(slip=slip, rpm=rpm), seed + i, gain_error=0.0)
        passage, motion = source.passage(), source.motion()
        fitted.append(reporters[WAVEFORM].build(passage, motion))
        raw.append(reporters[PRINTED_MAP].build(passage, motion))
    interval = _column(raw, 'peak_interval')
    return Points(
        slips, _column(fitted, 'stretch_voltage'), _column(fitted, 'stretch_voltage', True),
        _column(fitted, 'adhesion_ratio'), _column(fitted, 'adhesion_ratio', True),
        _column(raw, 'stretch_voltage'),
        {method: ratio_read_off(interval, np.full(len(slips), case.speed), case.robot, method)
         for method in (EXACT_MAP, PRINTED_MAP)})


def _column(told: list[Friction], name: str, sigmas: bool = False) -> Floats:
    return np.array([one.quantity(name)[sigmas] for one in told])
