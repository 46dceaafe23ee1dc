"""A node that drives by wheel speeds and keeps the newest of what the robot reports."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
import rclpy
from rclpy.signals import SignalHandlerOptions

from smart_tire.nodes.base import SmartTireNode
from smart_tire.nodes.compat import new_executor
from smart_tire.nodes.qos import subscriber_qos
from smart_tire.parameters import WheelControllerParams
from smart_tire.samples import Friction, Odometry, VelocityCommand, WheelSample, WheelSlip

COMMAND_PERIOD = 0.1  # s


class DemoDriver(SmartTireNode[WheelControllerParams]):
    """Publishes ``cmd_vel`` until told otherwise; what it hears is there to be read."""

    def __init__(self) -> None:
        super().__init__('pilot', WheelControllerParams)
        self.odometry: Odometry | None = None
        self.wheels: WheelSample | None = None
        self.slip: WheelSlip | None = None
        self.friction: dict[str, Friction] = {}
        self.crossings: dict[str, int] = {}
        self.health: dict[str, dict[str, str]] = {}  # node -> its diagnostics
        self._command = (0.0, 0.0)
        self._publish = self.advertise('cmd_vel')
        for name, field in (('odom', 'odometry'), ('wheel_states', 'wheels'),
                            ('wheel_slip', 'slip')):
            self.subscribe(name, self._keeper(field))
        self.subscribe('tire_friction', self._on_friction, wheels=4)
        self.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics,
                                 subscriber_qos('/diagnostics'))
        self.every(COMMAND_PERIOD, self._send)

    def drive(self, left_rpm: float, right_rpm: float) -> None:
        """Ask for wheel speeds [rev/min] of the sides, by way of ``cmd_vel``."""
        left, right = (rpm * 2.0 * math.pi / 60.0 * self.params.robot.wheel_radius
                       for rpm in (left_rpm, right_rpm))
        self._command = 0.5 * (left + right), (right - left) / self.params.effective_track

    def _send(self) -> None:
        self._publish(VelocityCommand(self.now_ns(), *self._command))

    def _keeper(self, field: str) -> Callable[[Any], None]:
        return lambda sample: setattr(self, field, sample)

    def _on_friction(self, friction: Friction) -> None:
        self.friction[friction.wheel] = friction
        self.crossings[friction.wheel] = self.crossings.get(friction.wheel, 0) + 1

    def _on_diagnostics(self, msg: DiagnosticArray) -> None:
        for status in msg.status:
            self.health[status.name.rsplit('/', 1)[-1]] = {
                item.key: item.value for item in status.values}


class NodeRunner:
    """A pilot with its executor, to be turned by the owner's own loop; a context."""

    def __init__(self, arguments: list[str]) -> None:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        self.pilot = DemoDriver()
        self._executor = new_executor()
        self._executor.add_node(self.pilot)

    def __enter__(self) -> NodeRunner:
        return self

    def __exit__(self, *_: object) -> None:
        self._executor.remove_node(self.pilot)
        self._executor.shutdown()
        self.pilot.destroy_node()
        rclpy.try_shutdown()

    def turn(self, seconds: float) -> None:
        """Handle what comes within ``seconds``."""
        end = self.pilot.steady_ns() + round(seconds * 1e9)
        while (left := end - self.pilot.steady_ns()) > 0:
            self._executor.spin_once(timeout_sec=min(0.1, left * 1e-9))
