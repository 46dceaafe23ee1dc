# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""
Parameters: validated frozen dataclasses, filled from YAML files, from ROS or in tests.

The class of a node is imported when it is used, so that other nodes start without it.
"""

from collections import UserDict
from collections.abc import Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, TYPE_CHECKING

from smart_tire.parameters.files import load_files
from smart_tire.parameters.robot import JointParams, RobotParams, STANDARD_JOINTS
from smart_tire.parameters.spec import build, is_known, known_names, Spec, specs

if TYPE_CHECKING:
    from smart_tire.parameters.control import TrajectoryControllerParams, WheelControllerParams
    from smart_tire.parameters.hardware import (
        ImuDriverParams, MotorDriverParams, TireReceiverParams)
    from smart_tire.parameters.mapping import FrictionMapperParams
    from smart_tire.parameters.overhead import OverheadLocalizerParams
    from smart_tire.parameters.simulation import SimulatorParams
    from smart_tire.parameters.tuning import FrictionEstimatorParams, SlipEstimatorParams


class NodeClasses(UserDict[str, Any]):
    """Node -> class of its parameters, made from the name of the class in this package."""

    def __getitem__(self, node: str) -> Any:
        module, name = self.data[node].split('.')
        return getattr(import_module(f'{__name__}.{module}'), name)


FILES = {  # in config/ -> nodes with their parameters
    'hardware.yaml': NodeClasses(
        tire_receiver='hardware.TireReceiverParams', imu_driver='hardware.ImuDriverParams',
        motor_driver='hardware.MotorDriverParams'),
    'tuning.yaml': NodeClasses(
        slip_estimator='tuning.SlipEstimatorParams',
        friction_estimator='tuning.FrictionEstimatorParams',
        wheel_controller='control.WheelControllerParams',
        trajectory_controller='control.TrajectoryControllerParams'),
    'mapping.yaml': NodeClasses(friction_mapper='mapping.FrictionMapperParams'),
    'film.yaml': NodeClasses(
        film_driver='film.FilmDriverParams', film_sensor='film.FilmSensorParams',
        film_simulator='film.FilmSimulatorParams'),
    'overhead.yaml': NodeClasses(overhead_localizer='overhead.OverheadLocalizerParams'),
    'simulation.yaml': NodeClasses(
        robot_simulator='simulation.SimulatorParams',
        overhead_camera_simulator='overhead.OverheadCameraSimulatorParams'),
}
NODE_PARAMS = NodeClasses({node: name for nodes in FILES.values()
                           for node, name in nodes.data.items()})


if not TYPE_CHECKING:  # a wrong name is found by the check of types
    def __getattr__(name: str) -> Any:
        """Return the parameter class ``name`` of a node (PEP 562)."""
        for node, path in NODE_PARAMS.data.items():
            if path.endswith(f'.{name}'):
                return NODE_PARAMS[node]
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def load_robot(files: Iterable[str | Path]) -> RobotParams:
    """Return the robot of the slip estimator's parameters; raise ParameterError if invalid."""
    return build(RobotParams, load_files(files, 'slip_estimator', known_names(
        NODE_PARAMS.values()), specs(RobotParams), NODE_PARAMS))


def load_node(files: Iterable[str | Path], node: str,
              values: Mapping[str, Any] | None = None) -> Any:
    """
    Return the parameters of ``node`` in ``files``, later ones override, with ``values`` on top.

    Parameters of other nodes are ignored. Raises ParameterError.
    """
    own = known_names([NODE_PARAMS[node]])
    given = {name: value for name, value in (values or {}).items() if is_known(name, own)}
    return build(NODE_PARAMS[node], {
        **load_files(files, node, known_names(NODE_PARAMS.values()), own, NODE_PARAMS), **given})


__all__ = [
    'build', 'FILES', 'FrictionEstimatorParams', 'FrictionMapperParams', 'ImuDriverParams',
    'JointParams', 'known_names', 'load_files', 'load_node', 'load_robot',
    'MotorDriverParams', 'NODE_PARAMS', 'OverheadLocalizerParams', 'RobotParams',
    'SimulatorParams', 'SlipEstimatorParams', 'Spec', 'specs', 'STANDARD_JOINTS',
    'TireReceiverParams', 'TrajectoryControllerParams', 'WheelControllerParams']
