# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Parameters: kinds, ranges, names and consistency are checked for every source."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math
from pathlib import Path

import pytest
from smart_tire import parameters
from smart_tire.errors import ParameterError
from smart_tire.parameters import (
    build, known_names, load_files, MotorDriverParams, NODE_PARAMS, RobotParams, SimulatorParams,
    SlipEstimatorParams, Spec, specs, TireReceiverParams, WheelControllerParams)
from smart_tire.parameters.files import (
    check_names, files_of, from_arguments, has_block_for, lines_in, misspelled)
from smart_tire.parameters.simulation import PatchParams
from smart_tire.parameters.spec import inlined, is_known, nested, param

SPEED = Spec('speed', 'float', 1.0, 'm/s', 'speed', low=0.0, high=3.0)
COUNT = Spec('count', 'int', 4, '-', 'count', low=1, high=99)
COLOR = Spec('color', 'str', 'red', '-', 'color', choices=('red', 'blue'))
FLAG = Spec('flag', 'bool', False, '-', 'flag')
PAIR = Spec('pair', 'float[]', (0.0, 1.0), 'm', 'minimum and maximum', low=-9.0, high=9.0,
            length=2)
ANY_LIST = Spec('list', 'float[]', (), 'm', 'any number of values', low=0.0, high=9.0)


@dataclass(frozen=True, kw_only=True)
class Wheel:
    """A wheel."""

    radius: float = param(0.1, 'm', 'rolling radius', (0.01, 2.0))


@dataclass(frozen=True, kw_only=True)
class Cart:
    """A cart whose front wheel is nested and whose axle is inlined."""

    name: str = param('cart', '-', 'name')
    front: Wheel = nested(Wheel)
    axle: Wheel = inlined(Wheel)


# Classes of the nodes


def test_every_class_of_a_node_is_an_attribute_of_the_package():
    assert all(getattr(parameters, cls.__name__) is cls for cls in NODE_PARAMS.values())
    with pytest.raises(AttributeError, match="'smart_tire.parameters' has no attribute 'Params'"):
        _ = parameters.Params


# One description


@pytest.mark.parametrize(('spec', 'value', 'expected'), [
    (SPEED, 2.5, 2.5), (SPEED, 2, 2.0), (SPEED, 0.0, 0.0), (SPEED, 3, 3.0),
    (COUNT, 7, 7), (COUNT, 7.0, 7),
    (COLOR, 'blue', 'blue'), (FLAG, True, True),
    (PAIR, [1, 2.5], (1.0, 2.5)), (PAIR, (3.0, 4.0), (3.0, 4.0)),
    (ANY_LIST, [], ()), (ANY_LIST, None, ()),  # rclpy gives None for an empty list
])
def test_a_value_of_the_described_kind_is_accepted(spec, value, expected):
    checked = spec.check(value)
    assert checked == expected
    assert type(checked) is type(expected)


@pytest.mark.parametrize(('spec', 'value', 'expected'), [
    (SPEED, -0.1, '0 to 3 m/s'), (SPEED, 3.1, '0 to 3 m/s'), (SPEED, math.nan, '0 to 3 m/s'),
    (SPEED, math.inf, '0 to 3 m/s'), (SPEED, '1.0', 'a float'), (SPEED, True, 'a float'),
    (SPEED, None, 'a float'), (SPEED, [1.0], 'a float'),
    (COUNT, 0, '1 to 99'), (COUNT, 1.5, 'an int'), (COUNT, False, 'an int'),
    (COLOR, 'green', 'one of red, blue'), (COLOR, 1, 'a str'),
    (FLAG, 1, 'a bool'), (FLAG, 'true', 'a bool'),
    (PAIR, [1.0], '2 numbers'), (PAIR, [1.0, 2.0, 3.0], '2 numbers'), (PAIR, 1.0, 'a list of'),
    (PAIR, '12', 'a list of'), (PAIR, [1.0, 'x'], 'a float'), (PAIR, [1.0, math.nan], '-9 to 9 m'),
])
def test_an_error_names_parameter_value_and_expectation(spec, value, expected):
    with pytest.raises(ParameterError) as caught:
        spec.check(value)
    assert f'parameter {spec.name}: ' in str(caught.value)
    assert expected in str(caught.value)


# A class


def test_nested_parameters_have_a_prefix_and_inlined_ones_do_not():
    assert list(specs(Cart)) == ['name', 'front.radius', 'radius']
    assert specs(Cart)['front.radius'].name == 'front.radius'


def test_build_assigns_values_to_nested_and_inlined_classes():
    cart = build(Cart, {'front.radius': 1, 'radius': 0.5})
    assert cart == Cart(front=Wheel(radius=1.0), axle=Wheel(radius=0.5))


def test_an_unknown_name_is_refused_with_a_suggestion():
    with pytest.raises(ParameterError, match=r'front\.radios, did you mean front\.radius\?'):
        build(Cart, {'front.radios': 1.0})


@pytest.mark.parametrize('cls', NODE_PARAMS.values())
def test_every_number_has_a_finite_range_that_holds_its_default(cls):
    for spec in specs(cls).values():
        assert spec.unit and spec.meaning
        if spec.kind.startswith(('int', 'float')):
            assert -math.inf < spec.low < spec.high < math.inf, spec.name
            assert spec.check(spec.default) in (spec.default,)  # NaN, too


@pytest.mark.parametrize('limits', [
    {}, {'low': 0.0}, {'high': 1.0}, {'low': 0.0, 'high': math.inf}])
def test_a_number_without_a_finite_range_cannot_be_declared(limits):
    with pytest.raises(ValueError, match='gain: a number needs finite low and high'):
        Spec('gain', 'float', 0.5, '-', 'gain', **limits)
    Spec('name', 'str', '', '-', 'name')


@pytest.mark.parametrize('values', [
    {'motor.coulomb_friction': 3.0}, {'motor.viscous_friction': 0.2}, {'pid.stall_torque': 0.2},
    {'mass': 1000.0, 'motor.axle_friction': 0.2}])
def test_friction_that_the_motor_cannot_overcome_is_refused(values):
    with pytest.raises(ParameterError, match='N m at free speed, expected at most 0.5 of pid.st'):
        build(WheelControllerParams, values)


def test_a_heavy_robot_is_within_all_ranges():
    build(WheelControllerParams, {
        'wheel_radius': 0.3, 'mass': 100.0, 'track_width': 1.1, 'wheelbase': 0.9,
        'effective_track': 1.9, 'yaw_inertia': 25.0, 'motor.inertia': 0.8,
        'motor.coulomb_friction': 4.0, 'pid.stall_torque': 120.0, 'pid.feed_forward': 0.12,
        'max_wheel_speed': 8.0, 'max_wheel_acceleration': 4.0, 'max_wheel_deceleration': 6.0})


# Values that contradict each other


@pytest.mark.parametrize(('cls', 'values', 'complaint'), [
    (RobotParams, {'film.stretch_gain': [1.0, 2.0, 3.0]}, 'film.stretch_gain has 3 values'),
    (RobotParams, {'film.positions': [0.0, 0.03, 0.06]}, 'film.stretch_gain has 2 values'),
    (RobotParams, {'film.positions': [0.03, 0.0]}, 'film.positions'),
    (RobotParams, {'film.positions': [-0.1, 0.0]}, 'film.positions'),
    (RobotParams, {'film.positions': [0.0, 0.6]}, 'more than the wheel circumference'),
    (RobotParams, {'film.wheels': ['front_left', 'front_left']}, 'contains a wheel twice'),
    (RobotParams, {'film.wheels': ['middle']}, 'one of front_left'),
    (TireReceiverParams, {'units': ['0013A20040A1B2C3']}, 'expected 16 hex digits'),
    (TireReceiverParams, {'units': ['0013=front_left']}, 'expected 16 hex digits'),
    (TireReceiverParams, {'units': ['0013A20040A1B2CX=front_left']}, 'expected 16 hex digits'),
    (TireReceiverParams, {'units': ['0013A20040A1B2C3=middle']}, 'expected 16 hex digits'),
    (TireReceiverParams, {'units': ['0013A20040A1B2C3=front_left', '0013A20040A1B2C3=rear_left']},
     'repeats'),
    (TireReceiverParams, {'units': ['0013A20040A1B2C3=front_left', '0013A20040A1B2C4=front_left']},
     'repeats'),
    (MotorDriverParams, {'addresses': [128, 128]}, 'expected two different ones'),
    (SimulatorParams, {'ground.base': 'ice'}, 'ground.base'),
    (SimulatorParams, {'ground.friction': [0.5]}, 'ground.friction has 1 values'),
    (SimulatorParams, {'ground.patches.names': ['a']}, "patches.a.surface: '', expected one"),
    (SimulatorParams, {'ground.patches.names': ['a', 'a']}, 'ground.patches.names'),
    (SimulatorParams, {'ground.patches.names': ['names']}, 'ground.patches.names'),
    (SimulatorParams, {'ground.patches.names': ['a.b']}, 'ground.patches.names'),
    (SimulatorParams, {'ground.patches.start_area.surface': 'ice'},
     "ground.patches.start_area.surface: 'ice'"),
    (SimulatorParams, {'ground.patches.start_area.x': [1, 0]}, 'patches.start_area.x: [1.0'),
    (SimulatorParams, {'ground.patches.start_area.y': [0, 0]}, 'patches.start_area.y: [0.0'),
    (SimulatorParams, {'ground.patches.start_area.y': [0]}, 'patches.start_area.y: [0], exp'),
    (SimulatorParams, {'ground.patches.start_area.z': [0, 1]},
     'unknown parameter ground.patches.start_area.z'),
    (SimulatorParams, {'units': ['0013A20040A1B2C3=front_left']}, 'units'),
    (SlipEstimatorParams, {'constraint': 'printed'}, 'smart_tire.papers.printed'),
    (WheelControllerParams, {'cmd_vel_timeouts': [0.2, 0.5]}, 'cmd_vel_timeouts: [0.2, 0.5], exp'),
    (WheelControllerParams, {'cmd_vel_timeouts': [0.0]}, 'expected 0.02 to 60 s'),
])
def test_contradictory_values_are_refused_by_name(cls, values, complaint):
    with pytest.raises(ParameterError) as caught:
        build(cls, values)
    assert complaint in str(caught.value)


def test_entries_of_units_are_parsed_into_addresses_and_wheels():
    units = ('0013A20040A1B2C3=front_right', 'FFFFFFFFFFFFFFFF=rear_left')
    assert TireReceiverParams(units=units).wheel_of() \
        == {0x0013A20040A1B2C3: 'front_right', 0xFFFFFFFFFFFFFFFF: 'rear_left'}


def test_film_lists_hold_values_for_one_wheel_or_for_each():
    film = RobotParams().film
    both = replace(film, wheels=('front_left', 'rear_right'))
    assert both.gains('front_left') == both.gains('rear_right') == (307.5, 242.5)
    own = replace(both, stretch_gain=(1.0, 2.0, 3.0, 4.0), bending_peak=(5.0, 6.0, 7.0, 8.0))
    assert own.gains('rear_right') == (3.0, 4.0)
    assert own.bending('front_left') == (5.0, 6.0)


def test_without_positions_there_are_two_films_a_spacing_apart():
    film = build(RobotParams, {'film.spacing': 0.04}).film
    assert (film.count, film.centers) == (2, (0.0, 0.04))
    three = build(RobotParams, {
        'film.positions': [0, 0.03, 0.3], 'film.wheels': ['front_left', 'front_right'],
        'film.stretch_gain': [1, 2, 3], 'film.bending_peak': [1, 2, 3, 4, 5, 6]}).film
    assert (three.count, three.centers) == (3, (0.0, 0.03, 0.3))
    assert three.gains('front_right') == (1.0, 2.0, 3.0)
    assert three.bending('front_right') == (4.0, 5.0, 6.0)


@pytest.mark.parametrize(('positions', 'groups'), [
    ([0.0], [(0,)]), ([], [(0, 1)]), ([0.0, 0.03, 0.06], [(0, 1, 2)]),
    ([0.1, 0.13, 0.3, 0.33], [(0, 1), (2, 3)]), ([0.0, 0.18, 0.36], [(0,), (1,), (2,)]),
    ([0.06 * i for i in range(9)], [(0, 1, 2, 3), (4, 5, 6, 7), (8,)])])
def test_neighboring_films_form_a_group(positions, groups):
    count = len(positions) or 2
    robot = build(RobotParams, {'film.positions': positions, 'film.stretch_gain': [300] * count,
                                'film.bending_peak': [0.8] * count})
    assert robot.film_groups == groups


# Named instances


def patch(name, surface='sand', x=(0.0, 1.0), y=(0.0, 2.0)):
    """Return the parameters of a patch."""
    return {f'ground.patches.{name}.surface': surface, f'ground.patches.{name}.x': x,
            f'ground.patches.{name}.y': y}


def test_listed_patches_are_built_in_the_order_of_the_list():
    params = build(SimulatorParams, {
        'ground.patches.names': ['b', 'a'], **patch('a'), **patch('b', 'concrete', [3, 4])})
    assert params.ground.patches == (
        PatchParams(name='b', surface='concrete', x=(3.0, 4.0), y=(0.0, 2.0)),
        PatchParams(name='a', surface='sand', x=(0.0, 1.0), y=(0.0, 2.0)))


def test_a_listed_default_patch_keeps_the_values_that_are_not_set():
    params = build(SimulatorParams, {'ground.patches.start_area.x': [-1, 1]})
    assert params.ground.patches == (
        PatchParams(name='start_area', surface='concrete', x=(-1.0, 1.0), y=(-3.0, 3.0)),)


@pytest.mark.parametrize('names', [[], (), None])
def test_patches_that_are_not_listed_are_ignored(names):
    values = {**patch('a', surface='no such surface'), 'ground.patches.names': names}
    assert build(SimulatorParams, values).ground.patches == ()


def test_the_parameters_of_a_class_include_those_of_the_listed_instances():
    listed = {'ground.patches.names': ['a', 'b']}
    found = [name for name in specs(SimulatorParams, listed) if 'patches' in name]
    assert found == ['ground.patches.names', *patch('a'), *patch('b')]
    assert specs(SimulatorParams)['ground.patches.start_area.x'].default == (-3.0, 3.0)


def test_known_names_match_any_instance():
    known = known_names([SimulatorParams])
    assert is_known('ground.patches.anywhere.surface', known)
    assert not is_known('ground.patches.anywhere.friction', known)
    assert not is_known('ground.patchs.anywhere.surface', known)


# Files


def written(folder, name, text):
    """Return the path of a new file."""
    path = folder / name
    path.write_text(text, encoding='utf-8')
    return path


def loaded(*paths, node='cart'):
    """Return the cart parameters that ``paths`` set for ``node``."""
    return load_files(paths, node, known_names([Cart]), known_names([Cart]))


def test_later_files_and_blocks_take_precedence(tmp_path):
    first = written(tmp_path, 'first.yaml', """
/**:
  ros__parameters: {name: anybody, radius: 0.2}
cart:
  ros__parameters: {name: me}
""")
    second = written(tmp_path, 'second.yaml', 'cart: {ros__parameters: {radius: 0.3}}')
    assert loaded(first, second) == {'name': 'me', 'radius': 0.3}


@pytest.mark.parametrize('block', [
    '/**', '*', 'cart', '/cart', '/**/cart', '/robot/cart'])
def test_a_block_applies_to_the_node_in_its_last_token(tmp_path, block):
    path = written(tmp_path, 'any.yaml', f'"{block}": {{ros__parameters: {{name: me}}}}')
    assert loaded(path) == {'name': 'me'}
    assert (loaded(path, node='other') == {}) == (block not in ('/**', '*'))


def test_a_namespace_may_be_a_separate_level(tmp_path):
    path = written(tmp_path, 'any.yaml', 'robot: {cart: {ros__parameters: {name: me}}}')
    assert loaded(path) == {'name': 'me'}


def test_names_may_be_nested_or_dotted(tmp_path):
    nested = written(tmp_path, 'a.yaml', 'cart: {ros__parameters: {front: {radius: 1.0}}}')
    dotted = written(tmp_path, 'b.yaml', 'cart: {ros__parameters: {front.radius: 1.0}}')
    assert loaded(nested) == loaded(dotted) == {'front.radius': 1.0}


@pytest.mark.parametrize(('text', 'said'), [
    ('/**:\n  ros__parameters: {mass: 7.0}\n/**:\n  ros__parameters: {wheel_radius: 0.1}\n',
     r'line 3: /\*\* is there twice, first in line 1'),
    ('/**: {ros__parameters: {imu: {gyro_noise: 0.1}, imu.gyro_noise: 0.2}}\n',
     'imu.gyro_noise is there twice')])
def test_a_name_that_is_there_twice_is_refused(tmp_path, text, said):
    with pytest.raises(ParameterError, match=f'a.yaml: .*{said}'):
        loaded(written(tmp_path, 'a.yaml', text))


def test_a_block_without_parameters_is_empty(tmp_path):
    assert loaded(written(tmp_path, 'a.yaml', 'cart: {ros__parameters: }')) == {}


def test_a_misspelled_name_is_refused_with_its_file(tmp_path):
    path = written(tmp_path, 'a.yaml', 'other: {ros__parameters: {front: {radios: 1.0}}}')
    with pytest.raises(ParameterError, match=r'a\.yaml: .*front\.radios, did you mean'):
        loaded(path)


@pytest.mark.parametrize('data', [
    b'', b'[1, 2]', b'cart: 1', b'cart: {name: me}', b'cart: {ros__parameters: [1]}', b'cart: {',
    b'\x00', b'\xff\xfe\x00\x01\x80'])
def test_an_invalid_or_missing_parameter_file_is_refused_with_its_name(tmp_path, data):
    with pytest.raises(ParameterError, match=r'a\.yaml: cannot be read'):
        loaded(tmp_path / 'a.yaml')
    (tmp_path / 'a.yaml').write_bytes(data)
    with pytest.raises(ParameterError, match=r'a\.yaml: '):
        loaded(tmp_path / 'a.yaml')


def test_parameters_declared_by_rclpy_are_known():
    check_names(['use_sim_time', 'start_type_description_service', 'radius'], ['radius'])


def test_qualities_of_service_that_have_no_effect_are_refused():
    with pytest.raises(ParameterError, match=r'a\.yaml: qos_overrides\./tf\.publisher\.depth: q'):
        check_names(['radius', 'qos_overrides./tf.publisher.depth'], ['radius'], 'a.yaml: ')


@pytest.mark.parametrize(('block', 'near'), [
    ('slip_estimatr', 'slip_estimator'), ('/robot/wheelcontroller', 'wheel_controller'),
    ('/**/robot_simulater', 'robot_simulator'), ('slip_estimator', ''), ('/r/imu_driver', ''),
    ('/**', ''), ('/*', ''), ('amcl', ''), ('gps_receiver', ''), ('imu_driver_front', '')])
def test_a_block_that_almost_has_the_name_of_a_node_is_reported(tmp_path, block, near):
    path = written(tmp_path, 'a.yaml', f'"{block}": {{ros__parameters: {{}}}}')
    text = f'{path}: {block} is ignored, did you mean {near}?'
    assert list(misspelled(path, NODE_PARAMS)) == ([(near, text)] if near else [])


@pytest.mark.parametrize(('block', 'applies'), [
    ('cart', True), ('/**', True), ('/**/cart', True), ('/robot/cart', True), ('horse', False)])
def test_a_file_has_a_block_for_a_node_in_any_namespace(tmp_path, block, applies):
    path = written(tmp_path, 'a.yaml', f'"{block}": {{ros__parameters: {{}}}}')
    assert has_block_for(path, ['cart']) == has_block_for(path, ['x', 'cart']) == applies
    assert not has_block_for(path, [])


def test_the_files_of_a_command_line_are_those_in_its_ros_arguments():
    words = ['node', '--params-file', 'a', '--ros-args', '--params-file', 'b', '-p', 'x:=1',
             '--params-file', 'c', '--', '--params-file', 'd']
    assert files_of(words) == [Path('b'), Path('c')]


def test_later_arguments_of_a_command_line_take_precedence(tmp_path):
    robot, tuned = tmp_path / 'robot.yaml', tmp_path / 'tuned.yaml'
    robot.write_text('/**: {ros__parameters: {wheel_radius: 0.1}}\n'
                     'slip_estimator: {ros__parameters: {wheel_radius: 0.2, mass: 9}}')
    tuned.write_text('/**: {ros__parameters: {wheel_radius: 0.3}}')
    words = ['node', '--ros-args', '--params-file', str(robot), '--params-file', str(tuned)]
    assert from_arguments(words, '/slip_estimator') == {'wheel_radius': 0.3, 'mass': 9}
    words += ['-r', '__ns:=/', '-p', 'wheel_radius:=4e-1', '-p', 'film.wheels:=[rear_left]',
              '-p', 'imu_driver:port:=other', '-p', 'slip_estimator:mass:=8', '--', '-p', 'x:=1']
    assert from_arguments(words, '/slip_estimator') == {
        'wheel_radius': 0.4, 'mass': 8, 'film.wheels': ['rear_left']}


@pytest.mark.parametrize('block, node, meant', [
    ('/**', '/robot1/slip_estimator', True), ('/**', '/slip_estimator', True),
    ('slip_estimator', '/slip_estimator', True),
    ('slip_estimator', '/robot1/slip_estimator', False),
    ('/robot1/slip_estimator', '/robot1/slip_estimator', True),
    ('/robot2/slip_estimator', '/robot1/slip_estimator', False),
    ('/*/slip_estimator', '/robot1/slip_estimator', True),
    ('/**/slip_estimator', '/a/b/slip_estimator', True),
    ('/robot1/**', '/robot1/imu_driver', True), ('/robot1/*', '/robot2/imu_driver', False),
    ('/robot1/*', '/robot1/imu_driver', True), ('/robot1/*', '/robot1/a/imu_driver', False),
    ('/*', '/robot1/imu_driver', False), ('imu_*', '/imu_driver', False),
    ('/**/a/**/b', '/x/a/b', True), ('/**/a/**/b', '/a/x/y/b', True), ('/**/a/*/b', '/a/b', False),
    ('/**' * 10_000 + '/b', '/a/a/a/a/a/a/a/c', False)])
def test_the_namespace_of_a_block_must_match_a_fully_qualified_node(tmp_path, block, node, meant):
    path = tmp_path / 'some.yaml'
    path.write_text(f'? {block}\n: {{ros__parameters: {{mass: 7}}}}')
    words = ['node', '--ros-args', '--params-file', str(path)]
    assert from_arguments(words, node) == ({'mass': 7} if meant else {})


def test_numbers_may_be_written_without_a_point(tmp_path):
    path = tmp_path / 'some.yaml'
    path.write_text('/**: {ros__parameters: {mass: 1e1, film.noise: 5E-3, film.bits: 10}}')
    words = ['node', '--ros-args', '--params-file', str(path)]
    assert from_arguments(words, '/x') == {'mass': 10.0, 'film.noise': 0.005, 'film.bits': 10}


@pytest.mark.parametrize('given', [math.nan, 'nan', 'NaN'])
def test_nan_is_accepted_where_it_means_not_given_only(given):
    spec = specs(NODE_PARAMS['overhead_localizer'])['overhead.time_offset']
    assert spec.check(given) is math.nan
    with pytest.raises(ParameterError):
        specs(NODE_PARAMS['overhead_localizer'])['overhead.lag'].check(given)
    with pytest.raises(ParameterError):
        spec.check(11)


def test_one_tag_may_have_its_yaw_as_a_number():
    spec = specs(NODE_PARAMS['overhead_localizer'])['overhead.tag_yaw']
    assert spec.check(1) == spec.check([1.0]) == (1.0,)
    with pytest.raises(ParameterError):
        specs(NODE_PARAMS['overhead_localizer'])['overhead.tag_position'].check(1.0)


@pytest.mark.parametrize(('values', 'said'), [
    ({'overhead.camera_position': [1.0, 2.0]}, 'camera_position has 2 numbers'),
    ({'overhead.camera_correlation': [0.1] * 6}, 'camera_correlation has 6 numbers'),
    ({'overhead.camera_correlation': [-0.5] * 15}, 'not positive semidefinite'),
    ({'overhead.tag_ids': [1, 1]}, 'expected different ids'),
    ({'overhead.tag_ids': []}, 'expected different ids'),
    ({'overhead.tag_ids': [1, 2]}, '3 and 1 for each of 2 tags')])
def test_parameters_of_tags_must_fit_together(values, said):
    with pytest.raises(ParameterError, match=said):
        build(NODE_PARAMS['overhead_localizer'], values)


def test_each_parameter_has_its_line(tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text(
        '# a robot\n/**:\n  ros__parameters:\n    wheel_radius: 0.1\n    imu:\n'
        '      position: [0.0,\n                 0.0, 0.0]\n    film.wheels: []\n'
        '/r1:\n  slip_estimator:\n    ros__parameters: {icr_x: 0.1, wheel_radius: 0.2}\n')
    assert lines_in(path) == {'wheel_radius': 11, 'imu': 5, 'imu.position': 6, 'film.wheels': 8,
                              'icr_x': 11}
