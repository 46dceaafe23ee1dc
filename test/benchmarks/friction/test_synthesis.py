"""Synthesised passages: seen, true to their case, and different by chance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.friction.grid import all_cases, Case, LOAD, quick_cases
from benchmarks.friction.synthesis import Synthesiser
from smart_tire.estimation.friction.waveform_fit import WaveformFitter
from smart_tire.estimation.friction.waveform_model import Shared
from smart_tire.models.tire import brush_tire


def volts(passage):
    return [film.volts for film in passage.samples.films]


def test_cases_are_all_different_and_the_quick_ones_are_among_them():
    cases = [case for group in all_cases().values() for case in group]
    assert len(set(cases)) == len(cases)
    assert {case for group in quick_cases().values() for case in group} <= set(cases)
    assert {case.slip for case in cases} >= {0.02, -0.02, 0.3, -0.3}
    assert {case.mu for case in cases} >= {0.1, 0.9}
    assert {case.noise for case in cases} >= {0.002, 0.02}


@pytest.mark.parametrize('case', [Case(slip=0.1), Case(slip=-0.2, mu=0.2, turning=1.3)])
def test_the_sliding_share_of_a_case_is_that_of_the_brush_tire(case):
    ratio = brush_tire.adhesion_ratio(
        case.total_slip, case.mu, LOAD, case.robot.tire.longitudinal_stiffness)
    assert 1.0 - case.sliding == pytest.approx(float(ratio))


@pytest.mark.parametrize('case', [Case(slip=0.02), Case(slip=0.3), Case(slip=-0.3),
                                  Case(slip=0.1, rpm=200.0), Case(slip=0.1, noise=0.02),
                                  Case(slip=0.1, release='state')])
def test_every_film_of_every_passage_is_seen_near_its_place(case):
    source = Synthesiser(case, 1)
    for _ in range(20):
        passage = source.passage()
        assert [film.film for film in passage.samples.films] == [0, 1]
        for detection, place in zip(passage.samples.detections, (0.0, case.robot.film.spacing)):
            assert abs(detection.center - place) < 0.004
        assert 0 < passage.begin_ns < passage.end_ns


def test_the_same_seed_draws_the_same_passages_and_another_one_others():
    first, again, other = (volts(Synthesiser(Case(slip=0.1), seed).passage())
                           for seed in (1, 1, 2))
    assert all(np.array_equal(a, b) for a, b in zip(first, again))
    assert not any(np.array_equal(a[:40], b[:40]) for a, b in zip(first, other))


def test_samples_are_those_of_the_converter():
    film = Case(slip=0.1).robot.film
    for one in volts(Synthesiser(Case(slip=0.1), 1).passage()):
        codes = (one + film.rest_voltage) / film.code
        assert codes == pytest.approx(np.rint(codes), abs=1e-6)


def test_driving_raises_the_signal_and_braking_lowers_it():
    tops = [np.mean([volts(source.passage())[0].max() for _ in range(20)])
            for source in (Synthesiser(Case(slip=slip), 1) for slip in (-0.2, 0.0, 0.2))]
    assert tops[0] < tops[1] < tops[2]


def test_without_noise_the_model_of_the_fit_explains_a_passage():
    case = Case(slip=0.15, noise=0.0, turning=1.3)
    film = case.robot.film
    fitter = WaveformFitter(case.robot, film.gains('front_right'), film.bending('front_right'))
    fit = fitter.fit(Synthesiser(case, 3, gain_error=0.0).passage().samples)
    assert fit.residual_rms < film.code
    assert fit.shared(Shared.SLIP)[0] == pytest.approx(case.slip, rel=0.02)
    assert fit.shared(Shared.SLIDING)[0] == pytest.approx(case.sliding, rel=0.02)


def test_the_true_motion_has_the_total_slip_of_the_case():
    case = Case(slip=-0.1, turning=1.3)
    motion = Synthesiser(case, 1).motion()
    lateral = motion.lateral_velocity.value / case.speed
    assert math.hypot(motion.slip.value, lateral) == pytest.approx(0.13)
    assert motion.load == (LOAD, 0.0)
