"""The simulated robot and its ground (``config/simulation.yaml``)."""

from __future__ import annotations

from dataclasses import dataclass

from smart_tire.parameters.robot import RobotParams
from smart_tire.parameters.spec import param, part


@dataclass(frozen=True, kw_only=True)
class SimulatorParams:
    """Simulated robot; its sensors' errors are those of ``RobotParams``."""

    seed: int = param(1, '-', 'of every random number', low=0)
    robot: RobotParams = part(RobotParams)
