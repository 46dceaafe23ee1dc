# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters: validated frozen dataclasses, filled from YAML files, from ROS or in tests."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from smart_tire.parameters.control import TrajectoryControllerParams, WheelControllerParams
from smart_tire.parameters.files import load_files
from smart_tire.parameters.film import FilmDriverParams, FilmSensorParams, FilmSimulatorParams
from smart_tire.parameters.hardware import ImuDriverParams, MotorDriverParams, TireReceiverParams
from smart_tire.parameters.mapping import FrictionMapperParams
from smart_tire.parameters.overhead import (
    ImageParams, OverheadCameraSimulatorParams, OverheadLocalizerParams)
from smart_tire.parameters.robot import JointParams, RobotParams, STANDARD_JOINTS
from smart_tire.parameters.simulation import SimulatorParams
from smart_tire.parameters.spec import build, is_known, known_names, Spec, specs
from smart_tire.parameters.tuning import FrictionEstimatorParams, SlipEstimatorParams

FILES: dict[str, dict[str, type]] = {  # in config/ -> nodes with their parameters
    'hardware.yaml': {
        'tire_receiver': TireReceiverParams, 'imu_driver': ImuDriverParams,
        'motor_driver': MotorDriverParams},
    'tuning.yaml': {
        'slip_estimator': SlipEstimatorParams, 'friction_estimator': FrictionEstimatorParams,
        'wheel_controller': WheelControllerParams,
        'trajectory_controller': TrajectoryControllerParams},
    'mapping.yaml': {'friction_mapper': FrictionMapperParams},
    'film.yaml': {
        'film_driver': FilmDriverParams, 'film_sensor': FilmSensorParams,
        'film_simulator': FilmSimulatorParams},
    'overhead.yaml': {'overhead_localizer': OverheadLocalizerParams},
    'simulation.yaml': {
        'robot_simulator': SimulatorParams,
        'overhead_camera_simulator': OverheadCameraSimulatorParams},
}
NODE_PARAMS = {node: cls for nodes in FILES.values() for node, cls in nodes.items()}


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
    'build', 'FILES', 'FrictionEstimatorParams', 'FrictionMapperParams', 'ImageParams',
    'ImuDriverParams', 'JointParams', 'known_names', 'load_files', 'load_node', 'load_robot',
    'MotorDriverParams', 'NODE_PARAMS', 'OverheadLocalizerParams', 'RobotParams',
    'SimulatorParams', 'SlipEstimatorParams', 'Spec', 'specs', 'STANDARD_JOINTS',
    'TireReceiverParams', 'TrajectoryControllerParams', 'WheelControllerParams']
