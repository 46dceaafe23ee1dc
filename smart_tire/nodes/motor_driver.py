"""Poll the encoders of two RoboClaws, publish ``wheel_states``, apply ``motor_commands``."""

from __future__ import annotations

import sys

from smart_tire.links.motor_boards import MotorBoards
from smart_tire.nodes.base import run, SILENCE
from smart_tire.nodes.diagnostics import Status
from smart_tire.nodes.driver import DriverNode
from smart_tire.parameters import MotorDriverParams
from smart_tire.samples import MotorCommand


class MotorDriver(DriverNode[MotorDriverParams]):
    """Encoder counts in, wheel states out; duties go to the boards as soon as they come."""

    def __init__(self) -> None:
        super().__init__('motor_driver', MotorDriverParams)
        params = self.params
        self._boards = MotorBoards(
            params.addresses, params.signs, params.robot.encoder.counts_per_revolution,
            params.rate, params.command_timeout,
            self.advertise('wheel_states', rate=params.rate), self._on_trouble)
        self.subscribe('motor_commands', self._on_command)
        self.connect(self._boards, self._boards.run)

    def _on_command(self, command: MotorCommand) -> None:
        self._boards.command(command.duty)

    def _on_trouble(self, text: str) -> None:
        self.get_logger().warning(text)

    def fill_status(self, status: Status) -> None:
        """Add what became of the commands, and which board keeps the wheel states away."""
        super().fill_status(status)
        status.values['command_timeouts'] = self._boards.timeouts
        status.values['motor_commands.rejected'] = self.inputs['motor_commands'].bad
        if not self._link.problem:
            for board, age in self._boards.unread().items():
                if age > SILENCE:
                    status.error(f'no wheel_states, for the {board} does not answer')


def main() -> int:
    """Run the node."""
    return run(MotorDriver)


if __name__ == '__main__':
    sys.exit(main())
