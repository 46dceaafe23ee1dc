# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Each injected fault is found, by level, place and text."""

from __future__ import annotations

from dataclasses import replace
import math

from benchmarks.faults import delayed, interrupted
import numpy as np
import pytest
from smart_tire.bags import SampleDecoder
from smart_tire.bags.cdr import empty, Encoder
from smart_tire.checks import causes, films, messages, motion, sensors
from smart_tire.checks.recording import CheckedRecording
from smart_tire.host_load import FACTOR, HostLoad
from smart_tire.messages import NodeStatus, TOPICS
from smart_tire.parameters import RobotParams
from smart_tire.parameters.robot import EncoderParams, ImuParams, TireParams, TreadFilmParams
from smart_tire.recording import Faults, SampleArrays
from smart_tire.samples import BatterySample, ImuSample, NS_PER_S, WheelSample
from smart_tire.simulation.offline import EPOCH_NS
from support.checked import changed, clean, problems, recording, texts

RNG = np.random.default_rng(4)
WRONG_RADIUS = 'ERROR wheel_radius: wheel speeds fit the IMU with a radius of 0.08'
WRONG_TRACK = 'WARNING track_width: effective track'


def found(check, events, robot=None):
    """Return the findings of one check as text."""
    return texts(check(recording(events, robot)))


def rotated(vector):
    """Return a vector as an IMU that is mounted upside down measures it."""
    return vector[0], -vector[1], -vector[2]


def scaled(vector, factor):
    """Return ``vector`` times ``factor``."""
    return tuple(factor * number for number in vector)


# --- topics, frames, films ------------------------------------------------------------------


def test_samples_of_a_wheel_that_is_not_configured_are_reported():
    robot = RobotParams(film=TreadFilmParams(wheels=('rear_left',)))
    text = found(messages.check_film_wheels, clean(), robot)
    assert 'WARNING tire_samples of rear_left: no samples' in text
    assert 'WARNING tire_samples of front_right: samples are not used' in text


def test_another_number_of_films_is_an_error():
    events = changed('tire_samples', lambda one: replace(one, volts=(*one.volts, 1.65)))
    assert 'ERROR tire_samples of front_right: 3 films (expected 2' in found(
        messages.check_film_wheels, events)


@pytest.mark.parametrize('invalid, level', [(1, 'WARNING'), (10, 'ERROR')])
def test_invalid_messages_are_counted_with_the_first_reason(invalid, level):
    samples, faults = SampleArrays(), Faults()
    read = SampleDecoder('imu/data', faults)
    sample = clean()[0][2]
    topic, encode = TOPICS['imu/data'], Encoder(TOPICS['imu/data'].type)
    for index in range(500):
        msg = topic.to_msg(empty(topic.type), replace(
            sample, rate=(0.0, 0.0, 1e4 if index < invalid else 0.0)))
        msg.header.frame_id = 'base_imu'
        for received in read(encode(msg)):
            samples.add_sample(received, index)
    checked = CheckedRecording(RobotParams(), samples, faults)
    text = texts(messages.check_rejected(checked))
    assert f'{level} imu/data: {invalid} of 500 messages are invalid' in text and 'rad/s' in text
    assert "INFO imu/data: header.frame_id is 'base_imu' in 500 messages (expected 'imu_link')" \
        in texts(messages.check_frames(checked))


def test_missing_positions_and_torques_are_mentioned():
    events = changed('wheel_states', lambda one: replace(one, position=None, effort=None))
    text = found(messages.check_columns, events)
    assert 'INFO wheel_states: effort' in text and 'INFO wheel_states: position' in text
    assert found(messages.check_columns, clean()) == ''


# --- rates and timestamps -------------------------------------------------------------------


def kept(topic, share):
    """Return the clean events with one of ``share`` messages of ``topic``."""
    seen = iter(range(10**6))
    return changed(topic, lambda one: one if next(seen) % share == 0 else None)


def test_slow_inputs_are_reported():
    assert 'WARNING imu/data: 10 Hz (expected at least 20 Hz)' in found(
        messages.check_rates, kept('imu/data', 10))
    assert 'INFO imu/data: 50 Hz' in found(messages.check_rates, kept('imu/data', 2))
    assert 'WARNING wheel_states: 3.2 Hz' in found(messages.check_rates, kept('wheel_states', 5))
    assert 'WARNING tire_samples of front_right: 200 Hz (expected film.sample_rate 400 Hz)' \
        in found(messages.check_rates, kept('tire_samples', 2))


def test_a_gap_is_reported_with_its_time():
    events = interrupted(clean(), 'imu/data', [(10.0, 10.4)])
    assert '1 gap, the longest 0.41 s, the first at 10.0 s' in found(messages.check_gaps, events)
    events = interrupted(clean(), 'imu/data', [(10.0, 10.06)])
    assert 'imu/data' not in found(messages.check_gaps, events)


def test_messages_that_arrive_late_are_reported():
    events = [(receive_ns + (NS_PER_S * 3 // 10 if topic == 'wheel_states' and 100 < count < 150
                             else 0), topic, sample)
              for count, (receive_ns, topic, sample) in enumerate(clean())]
    late = sum(topic == 'wheel_states' for _, topic, _ in events[101:150])
    text = found(messages.check_late, events)
    assert f'WARNING wheel_states: {late} of ' in text
    assert 'more than 0.25 s late, up to 0.3' in text
    assert 'imu/data' not in text and 'tire_samples' not in text
    assert found(messages.check_late, clean()) == ''


def test_a_late_clock_is_no_late_message():
    """A constant delay, or one that grows by 0.2 ms per s, is that of the clock."""
    events = [(receive_ns + NS_PER_S + (receive_ns - EPOCH_NS) // 5000, topic, sample)
              for receive_ns, topic, sample in clean()]
    assert found(messages.check_late, events) == ''


def diagnosed(*statuses):
    """Return a clean recording with diagnostics from rows (second, name, level, text, values)."""
    return replace(recording(clean()), statuses=tuple(
        (EPOCH_NS + second * NS_PER_S, NodeStatus(name, level, text, values))
        for second, name, level, text, values in statuses))


def test_what_nodes_have_reported_is_grouped_by_its_text():
    host = HostLoad(0.03, 0.4, 36.0, 2)
    text = texts(messages.check_diagnostics(diagnosed(
        (1, 'r1/motor_driver', 0, 'ok', {}),
        (2, 'r1/motor_driver', 1, 'no odom for 1.5 s', {}),
        (3, 'r1/motor_driver', 1, f'no odom for 2.5 s; {host}', {}),
        (4, 'camera', 2, 'gone', {}), (4, 'slip_estimator', 1, str(host), {}),
        (5, 'imu_driver', 2, 'port lost', {}), (6, 'imu_driver', 2, 'port lost', {}),
        (7, 'recorder', 1, 'lost 2 messages of odom', {}))))
    assert text.splitlines() == [
        'WARNING r1/motor_driver: no odom for 2.5 s (2 times, the first at 2.0 s)',
        'ERROR imu_driver: port lost (2 times, the first at 5.0 s)',
        'INFO recorder: lost 2 messages of odom (1 time, the first at 7.0 s)']


@pytest.mark.parametrize('typical, level', [(0.019, ''), (0.031, 'WARNING')])
def test_a_late_host_is_named_with_its_load(typical, level):
    values = {key: str(value) for key, value in HostLoad(typical, 0.4, 36.0, 2).values.items()}
    text = texts(messages.check_host(diagnosed((1, 'motor_driver', 0, 'ok', values))))
    assert text == (level and f'{level} host: timers late by 31 ms (99%), load 36.0 on 2 cores: '
                              'end other programs')


def test_a_late_host_does_not_matter_to_a_simulated_time_that_waits_for_it():
    values = {key: str(value) for key, value in HostLoad(0.4, 0.4, 36.0, 2).values.items()}
    assert not texts(messages.check_host(diagnosed(
        (1, 'motor_driver', 0, 'ok', values), (1, 'robot_simulator', 0, 'ok', {FACTOR: '0.6'}))))


def test_many_lost_batches_are_a_warning():
    spans = [(0.4 * count, 0.4 * count + 0.04) for count in range(60)]
    assert 'WARNING tire_samples of front_right: 1' in found(
        messages.check_gaps, interrupted(clean(), 'tire_samples', spans))
    assert 'WARNING' not in found(messages.check_gaps, clean())


def test_timestamps_that_run_backwards_or_repeat_are_reported():
    seen = iter(range(10**6))
    events = changed('imu/data', lambda one: replace(
        one, stamp_ns=one.stamp_ns - 50_000_000 * (next(seen) == 500)))
    assert '1 timestamp before the previous one, by up to 0.04 s' in found(
        messages.check_stamps, events)
    events = sorted([*clean(), *clean()[:50]], key=lambda event: event[0])
    assert '12 repeated timestamps' in found(messages.check_stamps, events)


def test_timestamps_of_arrival_vary():
    events = changed('imu/data', lambda one: replace(
        one, stamp_ns=one.stamp_ns + round(RNG.normal(0.0, 5e6))))
    assert 'WARNING imu/data: periods of the timestamps vary' in found(
        messages.check_jitter, events)


def shifted(topic, seconds):
    """Return the clean events with other timestamps of ``topic``."""
    return changed(topic, lambda one: replace(
        one, stamp_ns=one.stamp_ns + round(seconds * NS_PER_S)))


def test_timestamps_after_their_reception_are_reported():
    text = found(messages.check_delays, shifted('imu/data', 0.1))
    assert 'WARNING imu/data: timestamps are 0.098 s after their reception' in text
    assert 'ERROR' not in text
    assert found(messages.check_delays, shifted('imu/data', 0.03)) == ''
    assert 'ERROR' not in found(messages.check_delays, delayed(clean(), 'imu/data', 0.3))


@pytest.mark.parametrize('drift, reported', [(2e-3, True), (-2e-3, True), (5e-5, False)])
def test_a_drifting_clock_is_reported_with_its_sign(drift, reported):
    events = changed('imu/data', lambda one: replace(
        one, stamp_ns=one.stamp_ns + round(drift * (one.stamp_ns - EPOCH_NS))))
    text = found(messages.check_drift, events)
    assert (f'imu/data: timestamps drift by {1e3 * drift:+.0f}00' in text) is reported
    assert 'wheel_states' not in text


def test_held_samples_are_reported():
    held = []

    def hold(sample):
        if len(held) % 2 == 0:
            held.append(sample)
        else:
            held.append(held[-1])
        return replace(held[-1], stamp_ns=sample.stamp_ns)

    text = found(messages.check_held, changed('imu/data', hold))
    assert '50% of the samples repeat' in text and 'only 50 Hz' in text


def test_a_simulator_without_noise_holds_no_samples():
    events = changed('imu/data', lambda one: replace(
        one, rate=(0.0, 0.0, round(one.rate[2], 1)), acceleration=tuple(
            float(round(force)) for force in one.acceleration)))
    imu = recording(events).imu.ordered
    assert (np.diff(imu.values[:, :6], axis=0) == 0.0).all(axis=1).mean() > 0.5
    assert found(messages.check_held, [
        event for event in events if event[0] - events[0][0] < 2 * NS_PER_S]) == ''


def ramps(noise):
    """Return a drive along ramps of the speed with forces of ``noise`` [m/s2]."""
    events = []
    for k in range(1200):
        stamp_ns, time = EPOCH_NS + 10_000_000 * k, 0.01 * k
        force = (0.5 if 2.0 <= time < 5.0 else -0.5 if 7.0 <= time < 10.0 else 0.0)
        speed = 0.5 * (min(max(time - 2.0, 0.0), 3.0) - min(max(time - 7.0, 0.0), 3.0))
        events.append((stamp_ns, 'imu/data', ImuSample(stamp_ns, (
            force + noise * RNG.normal(), 0.0, 9.81), (0.0, 0.0, 0.0))))
        if k % 5 == 0:
            events.append((stamp_ns, 'wheel_states', WheelSample(
                stamp_ns, (speed / 0.087,) * 4, None)))
    return events


def test_a_constant_acceleration_without_noise_is_none_that_is_stuck():
    assert found(sensors.check_constant, ramps(0.0)) == ''
    stuck = [(at, name, replace(one, acceleration=(0.0, 0.0, 9.81)) if name == 'imu/data' else one)
             for at, name, one in ramps(0.1)]
    assert 'ERROR imu/data: linear_acceleration is constant for 12' in found(
        sensors.check_constant, stuck)


def test_timestamps_of_a_simulation_are_no_fault():
    events = [(at, name, replace(sample, stamp_ns=sample.stamp_ns - EPOCH_NS + NS_PER_S))
              for at, name, sample in clean() if name != 'tire_samples']
    assert found(messages.check_delays, events) == (
        'INFO host: timestamps are those of a simulation')


def test_times_of_reception_of_a_simulation_are_named():
    events = [(at - EPOCH_NS + NS_PER_S, name, sample) for at, name, sample in clean()
              if name != 'tire_samples']
    assert found(messages.check_delays, events).startswith(
        'WARNING host: times of reception are those of a simulation, timestamps are not;')


@pytest.mark.parametrize('given', [True, False])
def test_a_radius_that_nobody_has_given_must_be_confirmed(given):
    straight = recording(clean())
    assert 'OK wheel_radius' in texts(motion.check_radius(replace(straight, radius_given=given)))
    few = [event for event in clean() if event[0] - clean()[0][0] < 4 * NS_PER_S]
    text = texts(motion.check_radius(replace(recording(few), radius_given=given)))
    assert ('ERROR wheel_radius: not given' in text) != given


# --- IMU ------------------------------------------------------------------------------------


@pytest.mark.parametrize('change, text', [
    (lambda f: (f[0] + 2.5, f[1], f[2]), 'tilted by 14 degrees'),
    (lambda f: scaled(f, 1.045), 'WARNING imu/data: specific force is 10')])
def test_a_wrong_direction_or_size_of_gravity_is_reported(change, text):
    events = changed('imu/data', lambda one: replace(one, acceleration=change(one.acceleration)))
    assert text in found(causes.check_causes, events)


def test_the_mounting_is_taken_into_account():
    events = changed('imu/data', lambda one: replace(
        one, acceleration=rotated(one.acceleration), rate=rotated(one.rate)))
    robot = RobotParams(imu=ImuParams(rotation=(math.pi, 0.0, 0.0)))
    assert texts(problems(events, robot)) == ''


def test_a_gyro_that_turns_at_rest_is_reported():
    events = changed('imu/data', lambda one: replace(
        one, rate=(one.rate[0], one.rate[1] + 0.1, one.rate[2])))
    assert 'angular rate at rest is 0.09' in found(sensors.check_gyro_bias, events)
    assert found(sensors.check_gyro_bias, clean()) == ''


# --- wheels ---------------------------------------------------------------------------------


@pytest.mark.parametrize('change, text', [
    (lambda torque: scaled(torque, 1e3), 'motor torques give'),
    (lambda torque: tuple(RNG.normal(0.0, 0.2, 4).tolist()), '')])
def test_too_large_torques_are_reported_and_those_without_a_clear_sign_are_not(change, text):
    report = found(sensors.check_torques, changed(
        'wheel_states', lambda one: replace(one, effort=change(one.effort))))
    assert text in report and bool(report) is bool(text)


# --- wheels against IMU ---------------------------------------------------------------------


@pytest.mark.parametrize('check, robot, text', [
    (motion.check_radius, RobotParams(wheel_radius=0.025), WRONG_RADIUS),
    (motion.check_radius, RobotParams(wheel_radius=0.16), WRONG_RADIUS),
    (motion.check_yaw_rate, RobotParams(track_width=1.0), WRONG_TRACK),
    (motion.check_yaw_rate, RobotParams(track_width=0.1), WRONG_TRACK)])
def test_a_wrong_geometry_is_reported_with_the_right_value(check, robot, text):
    assert text in found(check, clean(), robot)


@pytest.mark.parametrize('axis, shift', [(0, 0.5), (0, -0.4), (1, 0.6), (1, -0.4)])
def test_a_far_position_of_the_imu_is_an_error_which_the_right_one_is_not(axis, shift):
    for ground in ('concrete', 'sand'):
        events, position = clean(5, ground), list(RobotParams().imu.position)
        assert found(motion.check_imu_position, events) == ''
        position[axis] += shift
        wrong = RobotParams(imu=ImuParams(position=tuple(position)))
        text = f'imu.position: {"xy"[axis]} is '
        assert f'ERROR {text}' in found(motion.check_imu_position, events, wrong)
        unknown = RobotParams(imu=ImuParams(position=tuple(position), position_sigma=abs(shift)))
        assert found(motion.check_imu_position, events, unknown) == ''
        # of a robot whose wheels are others, nothing else is known either
        other = replace(recording(events, wrong), other_robot=True)
        assert f'WARNING {text}' in texts(motion.check_imu_position(other))


@pytest.mark.parametrize('late, configured, reported', [
    (0.1, 0.0, True), (0.1, 0.1, False), (-0.05, 0.0, False), (-0.12, 0.0, True)])
def test_late_wheels_contradict_the_configured_latency(late, configured, reported):
    """Of early ones 0.03 s of the fit are allowed, and 0.04 s by which the body follows in yaw."""
    robot = RobotParams(encoder=EncoderParams(latency=configured))
    text = found(motion.check_latency, shifted('wheel_states', late), robot)
    assert (f'timestamps of wheel_states are {late:.1f}'[:-1] in text) is reported


def test_an_imu_and_wheels_of_which_only_one_moves_contradict_each_other():
    still = changed('wheel_states', lambda one: replace(
        one, velocity=(0.0,) * 4, position=(1.0,) * 4))
    text = found(sensors.check_motion, still)
    assert text.startswith('ERROR wheel_states: the wheels never turn, but the IMU does: yaw rate')
    rest = [sample for at, topic, sample in clean()[:2000] if topic == 'imu/data'][20:120]
    at_rest = iter(range(10**6))
    lifted = changed('imu/data', lambda one: replace(
        rest[next(at_rest) * 37 % len(rest)], stamp_ns=one.stamp_ns))
    text = found(sensors.check_motion, lifted)
    assert text.startswith('ERROR imu/data: the IMU does not move, but the wheels turn: yaw rate')
    both = [(at, topic, other) for (at, topic, sample), (*_, other) in zip(lifted, still)
            if topic != 'imu/data'] + [event for event in lifted if event[1] == 'imu/data']
    assert found(sensors.check_motion, sorted(both, key=lambda event: event[0])) == ''
    assert found(sensors.check_motion, clean()) == ''


def test_a_robot_that_stands_is_not_compared():
    events = [event for event in clean() if event[0] < EPOCH_NS + 1_800_000_000]
    assert 'the robot does not drive' in found(motion.check_sides, events)


# --- films ----------------------------------------------------------------------------------


def with_volts(change):
    """Return the clean events with other film voltages."""
    return changed('tire_samples', lambda one: replace(one, volts=change(*one.volts)))


@pytest.mark.parametrize('change, text', [
    (lambda a, b: (a, b + 0.3), 'WARNING film 2 of front_right: rests at 1.9'),
    (lambda a, b: (0.0, b), 'ERROR film 1 of front_right: at a rail in 100%'),
    (lambda a, b: (max(a, 0.0) if a < 1.7 else 3.3, b), 'film 1 of front_right: clipped in')])
def test_voltages_out_of_place_are_reported(change, text):
    report = found(films.check_voltages, with_volts(change))
    assert text in report and report.count('\n') == 0


@pytest.mark.parametrize('change, text', [
    (lambda volts: RNG.normal(0.0, 0.005), 'ERROR film 2 of front_right: no signal while the'),
    (lambda volts: 0.08 * volts, 'film 2 of front_right')])
def test_a_dead_and_a_weak_film_are_reported(change, text):
    report = found(films.check_crossings,
                   with_volts(lambda a, b: (a, 1.65 + change(b - 1.65))))
    assert text in report and 'film 1' not in report


def test_swapped_films_and_another_spacing_are_reported():
    assert found(films.check_order, clean()) == ''
    text = found(films.check_order, with_volts(lambda a, b: (b, a)))
    assert text.startswith('ERROR films of front_right: film 2 enters the patch')
    robot = RobotParams(film=TreadFilmParams(spacing=0.08))
    assert 'WARNING films of front_right: film 2 follows film 1 by' in found(
        films.check_order, clean(), robot)


@pytest.mark.parametrize('volts, reported', [(3.2, True), (3.4, False)])
def test_a_low_battery_is_reported(volts, reported):
    events = [(EPOCH_NS, 'tire_battery', BatterySample(EPOCH_NS, 'front_right', volts))]
    assert ('charge' in found(films.check_battery, events)) is reported


# --- tire -----------------------------------------------------------------------------------


@pytest.mark.parametrize('stiffness, text', [
    (30.0, 'critical slip 1.3'), (2000.0, 'times the load'), (52.7, ''), (1000.0, '')])
def test_an_implausible_stiffness_is_reported(stiffness, text):
    robot = RobotParams(tire=TireParams(longitudinal_stiffness=stiffness))
    report = found(sensors.check_stiffness, clean(), robot)
    assert text in report and bool(report) is bool(text)
