# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Identified parameters are refused where the slip estimator is worse with them."""

from __future__ import annotations

from smart_tire.estimates import PoseEstimate
from smart_tire.identification import trial
from smart_tire.identification.robot import ANY_REFERENCE
from smart_tire.identification.trial import Recorded, refusals, TrialScore
from smart_tire.parameters import build, SlipEstimatorParams
from smart_tire.parameters.calibration_file import Identified
from support.identifying import turning_run, write_run

PARAMS = SlipEstimatorParams()
GOOD = TrialScore(0.010, 0.004, 0.2)
LATE, ROLLING, SIGMA = 'encoder.latency', 'wheel_radius', 'wheel_radius_sigma'


def found(**values):
    """Return identified parameters; the names have __ in place of points."""
    return {name.replace('__', '.'): Identified(name.replace('__', '.'), value)
            for name, value in values.items()}


def tried(monkeypatch, score):
    """Replace the runs of the estimator by a function of the parameters; return their log."""
    log = []

    def run(params, recordings):
        log.append(params)
        return score(params)
    monkeypatch.setattr(trial, '_score', run)
    return log


def test_parameters_that_are_not_worse_are_tried_once_together(monkeypatch):
    log = tried(monkeypatch, lambda params: GOOD)
    assert refusals(PARAMS, found(encoder__latency=0.01, wheel_radius=0.09), []) == {}
    assert len(log) == 2 and log[0] == PARAMS
    assert (log[1].robot.encoder.latency, log[1].robot.wheel_radius) == (0.01, 0.09)


def test_only_what_is_worse_is_refused_with_its_sigma_and_the_figures(monkeypatch):
    def score(params):
        wrong = params.robot.wheel_radius != PARAMS.robot.wheel_radius
        return GOOD._replace(end=0.5 if wrong else 0.2)
    log = tried(monkeypatch, score)
    refused = refusals(PARAMS, found(
        wheel_radius=0.09, encoder__latency=0.01, wheel_radius_sigma=0.01), [])
    assert list(refused) == [ROLLING, SIGMA]
    assert '0.5 m with it, 0.2 m without' in refused[ROLLING]
    assert log[-1].robot.encoder.latency == 0.01  # not together with what is refused
    assert log[-1].robot.wheel_radius == PARAMS.robot.wheel_radius


def test_each_figure_may_be_worse_by_what_is_chance_but_not_by_more(monkeypatch):
    for i, (unit, least, most) in enumerate((
            ('rad', 1.2, 1.3), ('m/s', 1.2, 1.3), ('m', 1.04, 1.06))):
        for factor, count in ((least, 0), (most, 1)):
            worse = GOOD._replace(**{GOOD._fields[i]: factor * GOOD[i]})
            tried(monkeypatch, lambda params, worse=worse: (
                worse if params.robot.encoder.latency else GOOD))
            refused = refusals(PARAMS, found(encoder__latency=0.01), [])
            assert len(refused) == count and all(unit in why for why in refused.values())


def test_parameters_may_not_add_up_to_a_loss(monkeypatch):
    """Each is worse by 20 %: the second one is compared with the best, not with the first."""
    def score(params):
        steps = (params.robot.encoder.latency != 0.0) + (params.icr_x != 0.0)
        return GOOD._replace(lateral=GOOD.lateral * 1.2 ** steps)
    tried(monkeypatch, score)
    assert list(refusals(PARAMS, found(encoder__latency=0.01, icr_x=0.1), [])) == ['icr_x']


def test_what_the_estimator_does_not_use_is_not_tried(monkeypatch):
    log = tried(monkeypatch, lambda params: GOOD)
    refusals(PARAMS, found(motor__torque_constant=0.9, effective_track=0.6), [])
    assert log == [PARAMS, PARAMS]
    refusals(PARAMS, found(tire__longitudinal_stiffness=90.0), [])
    assert log[-1].robot.tire.longitudinal_stiffness == 90.0


def test_a_latency_is_refused_if_it_is_wrong_only():
    run = turning_run(3, 14.0, wheel_latency=0.07)
    recorded = Recorded(run.samples, None)
    assert refusals(PARAMS, found(encoder__latency=0.07), [recorded]) == {}
    right = build(SlipEstimatorParams, {LATE: 0.07})
    refused = refusals(right, found(encoder__latency=0.3), [recorded])
    assert 'rms innovation' in refused[LATE] and 'rad without' in refused[LATE]


def test_a_radius_is_refused_by_the_end_of_the_path(tmp_path):
    run = turning_run(4, 14.0)
    bag = write_run(tmp_path / 'run', run, 'ground_truth/odom')
    recorded = trial.read_recorded(bag, PARAMS, ANY_REFERENCE)
    assert isinstance(recorded.reference, PoseEstimate)
    assert trial.read_recorded(bag, PARAMS).reference is None
    refused = refusals(PARAMS, found(wheel_radius=0.1, wheel_radius_sigma=0.001), [recorded])
    assert set(refused) == {ROLLING, SIGMA} and 'distance of the ends' in refused[SIGMA]
