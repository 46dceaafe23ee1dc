# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Simulated hardware on its ports, with host time as an argument: bytes in, bytes out."""

import csv
import math
import threading

import numpy as np
import pytest
from smart_tire.errors import LinkError, ParameterError
from smart_tire.parameters import build, SimulatorParams
from smart_tire.protocol import roboclaw, tire_payload, vectornav, xbee
from smart_tire.samples import Friction, NS_PER_S, Odometry, WheelSlip
from smart_tire.simulation import realtime
from smart_tire.simulation.realtime import SimulatedHardware

START_NS = 1_700_000_000 * NS_PER_S
TICK_NS = 10_000_000
PORTS = ('tire_radio', 'imu', 'motors')


class Port:
    """A serial line in memory, in place of ``PtyPort``."""

    def __init__(self):
        self.sent = self.requests = b''

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def write(self, data):
        self.sent += data

    def read(self):
        requests, self.requests = self.requests, b''
        return requests

    def wait(self, seconds):
        pass


class Host:
    """Host side of the ports, with the host clock."""

    def __init__(self, **values):
        self.truths = []
        self.params = build(SimulatorParams, {
            'ground.base': 'concrete', 'ground.patches.names': [],
            'film.wheels': ['front_left', 'front_right'],
            **{f'ports.{name}': name for name in PORTS}, **values})
        self.ports = {}
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(realtime, 'PtyPort',
                          lambda link: self.ports.setdefault(link, Port()))
            self.hardware = SimulatedHardware(self.params, self.truths.append, START_NS)
        self.now_ns = START_NS

    def advance(self, seconds):
        for _ in range(round(seconds * NS_PER_S / TICK_NS)):
            self.now_ns += TICK_NS
            self.hardware.advance(self.now_ns)

    def drive(self, duties, seconds):
        """Send duties to the boards, which acknowledge them, and advance."""
        for address, pair in zip((0x80, 0x81), (duties[:2], duties[2:])):
            self.ask(address, roboclaw.SET_DUTY, *(roboclaw.duty_code(duty) for duty in pair))
        self.advance(seconds)

    def ask(self, address, command, *values):
        motors = self.ports['motors']
        motors.sent, motors.requests = b'', roboclaw.encode_request(address, command, *values)
        self.hardware.advance(self.now_ns)
        return roboclaw.decode_reply(address, command, motors.sent)

    def batches(self):
        """Return wheel -> batches, in the order of arrival."""
        wheel_of = {address: wheel for wheel, address in self.params.address_of().items()}
        found = {}
        for body in xbee.XBeeDeframer().extract(self.ports['tire_radio'].sent):
            packet = xbee.decode_receive_packet(body)
            found.setdefault(wheel_of[packet.source], []).append(
                tire_payload.decode_batch(packet.data))
        return found

    def of(self, kind):
        return [truth for truth in self.truths if isinstance(truth, kind)]


def test_imu_frames_come_at_their_rate_with_the_unit_s_own_time():
    host = Host()
    host.advance(2.0)
    samples = [vectornav.decode_binary(body)
               for body in vectornav.BinaryDeframer().extract(host.ports['imu'].sent)]
    assert len(samples) == 200
    steps = np.diff([device_ns for device_ns, _ in samples])
    np.testing.assert_allclose(steps, TICK_NS, rtol=1e-4)
    assert samples[0][1].acceleration[2] == pytest.approx(9.8, abs=0.5)


def test_sensor_nodes_send_every_conversion_and_the_radio_loses_some():
    host = Host(**{'radio.loss': 0.2})
    host.advance(4.1)
    for wheel, batches in host.batches().items():
        numbers = np.unwrap([batch.sequence for batch in batches], period=65536)
        missing = int(numbers[-1] - numbers[0]) + 1 - len(batches)
        # losses of the first and last batches do not leave gaps
        assert 5 < missing <= host.hardware.dropped[wheel] <= missing + 2
        assert all(len(batch.codes) == 16 and batch.period_us == 2500 for batch in batches)
    assert host.batches().keys() == {'front_left', 'front_right'}


def test_duties_move_the_robot_and_silence_stops_it():
    host = Host()
    assert host.ask(0x80, roboclaw.SET_TIMEOUT, roboclaw.timeout_code(0.5)) == ()
    assert host.ask(0x81, roboclaw.SET_TIMEOUT, roboclaw.timeout_code(0.5)) == ()
    host.drive((0.4, 0.4, 0.4, 0.4), 0.4)
    assert host.of(Odometry)[-1].linear[0] > 0.1
    host.advance(2.0)
    assert host.of(Odometry)[-1].linear[0] == pytest.approx(0.0, abs=1e-3)


def test_encoder_counts_agree_with_wheel_rotation_and_slip():
    host = Host()
    host.drive((0.3, 0.5, 0.3, 0.5), 2.0)
    counts = host.ask(0x80, roboclaw.READ_ENCODERS) + host.ask(0x81, roboclaw.READ_ENCODERS)
    slip = host.of(WheelSlip)[-1]
    assert counts[0] == pytest.approx(counts[2], abs=40)
    assert 2000 < counts[0] < counts[1]  # more than a revolution
    speed, _ = host.ask(0x80, roboclaw.READ_SPEEDS)
    v_x = host.of(Odometry)[-1].linear[0] - 0.19 * host.of(Odometry)[-1].angular[2]
    rolling_speed = speed * math.tau / 2000 * 0.087
    assert rolling_speed == pytest.approx(slip.slip_velocity[0] + v_x, rel=0.02)


@pytest.mark.parametrize('duty', [0.4, -0.4])
def test_currents_agree_with_the_losses_of_the_drive(duty):
    host = Host()
    host.drive((duty,) * 4, 1.0)
    accelerating = host.ask(0x80, roboclaw.READ_CURRENTS)
    host.advance(2.0)
    steady = np.mean([host.ask(address, roboclaw.READ_CURRENTS)
                      for _ in range(30) for address in (0x80, 0x81)]) * 0.01
    motor, load = host.params.robot.motor, 26.7
    torque = (motor.coulomb_friction + 0.087 * load * (motor.axle_friction + 0.015)) / 1.2
    assert steady == pytest.approx(torque, rel=0.25)  # errors of the simulated motors
    assert min(accelerating) * 0.01 > -0.1
    host.drive((0.3 * duty,) * 4, 0.02)
    assert max(host.ask(0x80, roboclaw.READ_CURRENTS)) < 0  # the motors brake


def test_ground_truth_has_host_timestamps():
    host = Host()
    host.drive((0.5, 0.5, 0.5, 0.5), 3.0)
    stamps = [odometry.stamp_ns for odometry in host.of(Odometry)]
    assert stamps == [START_NS + (i + 1) * TICK_NS for i in range(300)]
    crossings = host.of(Friction)
    assert crossings and all(START_NS < p.stamp_ns < host.now_ns for p in crossings)


@pytest.mark.parametrize('jump', [-3600.0, -2.0, 30.0, 86400.0])
def test_a_step_of_the_host_clock_does_not_affect_the_robot(jump):
    host = Host()
    host.drive((0.5, 0.5, 0.5, 0.5), 1.0)
    before = host.of(Odometry)[-1]
    host.now_ns += round(jump * NS_PER_S)
    host.advance(0.5)
    after = host.of(Odometry)[-1]
    assert host.hardware.clock_jumps == 1
    assert after.position[0] - before.position[0] == pytest.approx(0.5 * after.linear[0], rel=0.1)
    assert abs(host.now_ns - after.stamp_ns) <= 2 * TICK_NS


def test_the_simulation_catches_up_after_a_stall_of_the_host():
    host = Host()
    host.now_ns += 2 * NS_PER_S
    host.advance(1.0)
    assert host.hardware.clock_jumps == 0
    assert len(host.of(Odometry)) == 300


def test_the_log_contains_the_true_times_of_each_batch(tmp_path):
    host = Host(**{'truth_log': str(tmp_path / 'truth.csv')})
    host.advance(2.0)
    host.hardware.close()
    with open(tmp_path / 'truth.csv', encoding='utf-8') as log:
        rows = list(csv.DictReader(log))
    logged = {(row['wheel'], int(row['sequence'])): [int(ns) for ns in row['stamps_ns'].split()]
              for row in rows}
    for wheel, batches in host.batches().items():
        for batch in batches:
            stamps = logged[wheel, batch.sequence]
            np.testing.assert_allclose(np.diff(stamps), 2_500_000, rtol=1e-3)
            assert stamps[0] >= START_NS and stamps[-1] < host.now_ns
    assert len(rows) >= 98


def test_the_next_event_is_in_the_near_future():
    host = Host()
    for _ in range(300):
        next_ns = host.hardware.advance(host.now_ns)
        assert host.now_ns < next_ns <= host.now_ns + 50_000_000
        host.now_ns = next_ns


def test_run_follows_the_clock_until_it_is_stopped():
    host, stopping = Host(), threading.Event()

    def clock():
        host.now_ns += TICK_NS // 4
        if len(host.of(Odometry)) >= 10:
            stopping.set()
        return host.now_ns

    host.hardware.run(clock, stopping)
    stamps = [odometry.stamp_ns for odometry in host.of(Odometry)]
    assert stamps == [START_NS + (i + 1) * TICK_NS for i in range(len(stamps))]
    assert 0 <= host.now_ns - stamps[-1] <= TICK_NS  # it asks twice, before and after each step
    assert host.hardware.clock_jumps == 0


def test_ports_are_removed_if_the_log_cannot_be_opened(tmp_path):
    links = {f'ports.{name}': str(tmp_path / name) for name in PORTS}
    params = build(SimulatorParams, {**links, 'truth_log': str(tmp_path / 'no' / 'log.csv')})
    with pytest.raises(LinkError, match='log.csv'):
        SimulatedHardware(params, print, START_NS)
    assert not any(path.is_symlink() for path in tmp_path.iterdir())


def test_a_resolution_that_the_payload_does_not_support_is_refused():
    with pytest.raises(ParameterError, match=r'film\.bits'):
        SimulatedHardware(build(SimulatorParams, {'film.bits': 12}), print, START_NS)
