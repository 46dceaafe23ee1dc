# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Tests of the closed control loop offline."""

from benchmarks.control.closed_loop import DUTY_DELAY_NS, run_closed_loop
import pytest
from smart_tire.parameters import RobotParams, SimulatorParams
from smart_tire.parameters.robot import TreadFilmParams
from smart_tire.parameters.simulation import SurfaceParams
from smart_tire.samples import NS_PER_S
from smart_tire.simulation.offline import EPOCH_NS, IMU_DELAY_NS, WHEEL_DELAY_NS

STOPPED = (0.0, 0.0, 0.0, 0.0)
PARAMS = SimulatorParams(robot=RobotParams(film=TreadFilmParams(wheels=())),
                         ground=SurfaceParams(base='concrete', patches=()))


class StepDuty:
    """Commands a duty once after some messages; notes what it gets, and when."""

    def __init__(self, duty=0.3, stop_ns=None):
        self.level, self.stop_ns = duty, stop_ns
        self.received, self.asked = [], []

    def receive(self, topic, sample, now_ns):
        self.received.append((now_ns, topic, sample))

    def duty(self, now_ns):
        self.asked.append(now_ns)
        return (self.level,) * 4

    def finished(self, now_ns):
        return self.stop_ns is not None and now_ns >= EPOCH_NS + self.stop_ns


def samples(controller, topic):
    return [(now, sample) for now, name, sample in controller.received if name == topic]


def test_messages_arrive_in_order_after_the_delay_of_their_link_until_the_controller_finishes():
    controller = StepDuty(stop_ns=NS_PER_S)
    events = run_closed_loop(PARAMS, controller, 5.0)
    assert events[-1][0] == pytest.approx(EPOCH_NS + NS_PER_S, abs=0.1e9)
    times = [now for now, _, _ in controller.received]
    assert times == sorted(times)
    assert {now - one.stamp_ns for now, one in samples(controller, 'imu/data')} == {IMU_DELAY_NS}
    delays = [now - one.stamp_ns for now, one in samples(controller, 'wheel_states')]
    assert sum(delays) / len(delays) == pytest.approx(WHEEL_DELAY_NS, abs=1e6)  # jitter of stamps


@pytest.mark.parametrize('rate', [4.0, 200.0])
def test_control_and_wheel_rates_are_independent(rate):
    controller = StepDuty()
    run_closed_loop(PARAMS, controller, 1.0, wheel_rate=rate, control_rate=50.0)
    assert len(controller.asked) == 50
    assert len(samples(controller, 'wheel_states')) == pytest.approx(rate, abs=2)


def test_a_duty_reaches_the_motors_after_the_delay_of_the_line():
    controller = StepDuty()
    run_closed_loop(PARAMS, controller, 0.2, wheel_rate=200.0, control_rate=10.0)
    first = controller.asked[0]
    moving = [one.stamp_ns for _, one in samples(controller, 'ground_truth/wheel_slip')
              if abs(one.slip_velocity[0]) > 0.0]
    assert 0 < min(moving) - first - DUTY_DELAY_NS <= 10_000_000  # period of the ground truth


def test_motors_keep_their_duty_between_two_commands():
    slow, fast = StepDuty(), StepDuty()
    end = [run_closed_loop(PARAMS, one, 3.0, control_rate=rate)[-1][0]
           for one, rate in ((slow, 4.0), (fast, 100.0))]
    final = [samples(one, 'wheel_states')[-1][1].velocity[0] for one in (slow, fast)]
    assert end[0] == end[1]
    assert final[0] == pytest.approx(final[1], rel=0.02)
    assert final[0] > 3.0  # rad/s
