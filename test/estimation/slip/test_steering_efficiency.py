"""The yaw rate that wheels alone promise."""

from __future__ import annotations

import numpy as np
import pytest

from smart_tire.estimation.slip.steering_efficiency import SteeringEfficiency

T = 0.0625  # s, 16 Hz


def drive(steering, share, duration, seed=0, noise=0.02):
    rng = np.random.default_rng(seed)
    for time in np.arange(0.0, duration, T):
        by_wheels = 1.5 * np.sin(time)
        steering.update(by_wheels, share * by_wheels + noise * rng.standard_normal(), T)


def test_a_robot_that_nobody_has_seen_turn_is_believed_to_have_its_geometric_track():
    rate, sigma = SteeringEfficiency().predict(1.0)
    assert rate == 1.0
    assert sigma == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize('seed', range(5))
def test_skidding_is_learned_within_seconds(seed):
    steering = SteeringEfficiency()
    drive(steering, 0.55, 5.0, seed)
    rate, sigma = steering.predict(-1.2)
    assert abs(rate + 0.66) < 2.0 * sigma
    assert sigma < 0.2


def test_another_ground_is_learned_too():
    steering = SteeringEfficiency()
    drive(steering, 0.55, 60.0)
    drive(steering, 0.8, 120.0)
    assert steering.share == pytest.approx(0.8, abs=0.02)


def test_driving_straight_teaches_and_forgets_nothing():
    steering = SteeringEfficiency()
    drive(steering, 0.55, 20.0)
    before = steering.share
    for _ in range(1000):
        steering.update(0.0, 0.01, T)
    assert steering.share == before
    assert steering.predict(0.0)[1] > 0.0
