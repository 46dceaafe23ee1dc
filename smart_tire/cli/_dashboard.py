"""What the robot feels, as one table that updates in place; plain lines without a terminal."""

from __future__ import annotations

import math
import time
from types import TracebackType
from typing import Protocol

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from smart_tire.samples import Friction, Odometry, WHEELS, WheelSample, WheelSlip

RPM = 60.0 / math.tau
PLAIN_PERIOD = 2.0  # s between two plain lines


class RobotStatus(Protocol):
    """What a pilot has heard of the robot."""

    odometry: Odometry | None
    wheels: WheelSample | None
    slip: WheelSlip | None
    friction: dict[str, Friction]
    passages: dict[str, int]
    health: dict[str, dict[str, str]]


class Dashboard:
    """Shows the newest of everything; a context."""

    def __init__(self, console: Console | None = None) -> None:
        self._console = console or Console()
        self._live = Live(console=self._console, auto_refresh=False)
        self._start = time.monotonic()
        self._shown = -math.inf

    def __enter__(self) -> Dashboard:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        if self._console.is_terminal:
            self._live.stop()

    def show(self, what: str, felt: RobotStatus) -> None:
        """Show what is felt while the robot does ``what``."""
        now = time.monotonic() - self._start
        if self._console.is_terminal:
            self._live.update(Group(_header(now, what, felt), _table(felt), _losses(felt)),
                              refresh=True)
        elif now >= self._shown + PLAIN_PERIOD:
            self._shown = now
            self._console.print(_line(now, what, felt), soft_wrap=True, highlight=False)


def _header(now: float, what: str, felt: RobotStatus) -> Text:
    text = Text(f'{now:5.1f} s  {what:16}', style='bold')
    if felt.odometry is not None:
        v, W = felt.odometry.linear[0], felt.odometry.angular[2]
        text.append(f'  v {v:+.2f} m/s  yaw rate {W:+.2f} rad/s', style='')
    return text


def _table(felt: RobotStatus) -> Table:
    table = Table('wheel', box=None, pad_edge=False)  # a bracket would be markup
    for column in ('speed, rpm', 'slip', 'friction, fused', 'this revolution', 'passages'):
        table.add_column(column, justify='right', min_width=len(column) + 2)
    for index, wheel in enumerate(WHEELS):
        table.add_row(wheel, *_row(index, wheel, felt))
    return table


def _row(index: int, wheel: str, felt: RobotStatus) -> tuple[str, ...]:
    speed = '' if felt.wheels is None else f'{felt.wheels.velocity[index] * RPM:.1f}'
    slip = '' if felt.slip is None else _value(felt.slip.ratio[index], felt.slip.sigma[index])
    friction = felt.friction.get(wheel)
    if friction is None:
        return speed, slip, '', '', ''
    fused, single = (_value(*quantity) for quantity in (
        friction.friction_coefficient, friction.friction_coefficient_single))
    return speed, slip, fused, single, str(felt.passages[wheel])


def _value(value: float, sigma: float) -> str:
    return '-' if math.isnan(value) else f'{value:+.2f} ± {sigma:.2f}'


def _losses(felt: RobotStatus) -> Text:
    receiver = felt.health.get('tire_receiver', {})
    simulator = felt.health.get('robot_simulator', {})
    return Text(f'radio batches: {receiver.get("batches_ok", "-")} received, '
                f'{receiver.get("batches_lost", "-")} lost, '
                f'{simulator.get("batches_dropped", "-")} dropped by the radio', style='dim')


def _line(now: float, what: str, felt: RobotStatus) -> str:
    parts = [f'{now:5.1f} s  {what:16}']
    if felt.wheels is not None and felt.slip is not None:
        for side, index in (('left', 0), ('right', 1)):
            parts.append(f'{side} {felt.wheels.velocity[index] * RPM:6.1f} rpm slip '
                         f'{_value(felt.slip.ratio[index], felt.slip.sigma[index]):>13}')
    for wheel, friction in sorted(felt.friction.items()):
        parts.append(f'mu {wheel} ' + _value(*friction.friction_coefficient))
    return '  '.join(parts)
