"""The runs of the benchmark are what they say they are."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.scenarios import Scenario, SCENARIOS, STANDSTILL
from smart_tire.samples import NS_PER_S, WheelSlip

every_scenario = pytest.mark.parametrize('scenario', SCENARIOS.values(), ids=list(SCENARIOS))


def short(name, duration=5.0):
    """Return the start of a scenario."""
    return replace(SCENARIOS[name], duration=duration)


def of(events, topic):
    """Return the samples of ``topic``."""
    return [sample for _, name, sample in events if name == topic]


@every_scenario
def test_a_run_stands_still_first_and_then_drives_to_its_end(scenario):
    starts = [leg[0] for leg in scenario.legs]
    assert starts[0] == STANDSTILL
    assert starts == sorted(starts)
    assert starts[-1] < scenario.duration
    assert any(leg[1:] != (0.0, 0.0) for leg in scenario.legs)


@every_scenario
def test_the_sensor_errors_are_those_that_the_estimator_is_told_but_for_the_biases(scenario):
    told, true = scenario.robot, scenario.simulator(1).robot
    assert replace(true, imu=told.imu, film=told.film) == told
    assert true.imu.gyro_bias == pytest.approx(scenario.bias_scale * told.imu.gyro_bias)
    assert true.imu.accel_bias == pytest.approx(scenario.bias_scale * told.imu.accel_bias)
    assert true.imu.gyro_noise == told.imu.gyro_noise


def test_the_friction_jumps_between_the_three_values_and_the_stiffness_does_not():
    ground = SCENARIOS['mu_jumps'].simulator(1).ground
    assert sorted(ground.friction) == [0.20, 0.47, 0.60]
    assert set(ground.stiffness) == {52.7}


def test_the_same_seed_gives_the_same_events_and_another_one_others():
    first, again, other = (of(short('gaps', 3.5).events(seed), 'imu/data') for seed in (1, 1, 2))
    assert first == again != other


def test_late_wheels_are_stamped_and_received_late():
    prompt, late = (short(name).events(1) for name in ('degraded', 'late_wheels'))
    turning = [next(sample.stamp_ns for sample in of(events, 'wheel_states')
                    if max(sample.velocity) > 0.1) for events in (prompt, late)]
    assert turning[1] - turning[0] == pytest.approx(0.2 * NS_PER_S, abs=0.01 * NS_PER_S)
    assert all(received >= sample.stamp_ns for received, name, sample in late
               if name == 'wheel_states')


def test_wheels_at_four_hertz_are_read_four_times_a_second():
    assert len(of(short('degraded').events(1), 'wheel_states')) == pytest.approx(20, abs=1)


def test_gaps_are_in_the_inputs_only():
    run = short('gaps', 24.0)
    whole, events = replace(run, spoil=None).events(1), run.events(1)
    assert of(events, 'ground_truth/odom') == of(whole, 'ground_truth/odom')
    start = events[0][0]
    heard = {round((received - start) / NS_PER_S - 20.0, 3) for received, name, _ in events
             if name == 'imu/data'}
    assert not any(0.03 < time < 2.0 for time in heard)


def test_a_scenario_of_ones_own_needs_legs_and_a_duration_only():
    events = Scenario(name='own', title='own', legs=((0.5, 60.0, 60.0),), duration=1.5).events(3)
    slips = [sample for _, _, sample in events if isinstance(sample, WheelSlip)]
    assert slips[-1].ratio[0] == pytest.approx(0.0, abs=0.2)
