"""Parameters cannot be wrong: kinds, ranges and names are checked wherever they come from."""

from __future__ import annotations

from dataclasses import dataclass, FrozenInstanceError, replace
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest

from smart_tire.errors import ParameterError
from smart_tire.parameters import (
    build, FrictionEstimatorParams, known_names, load_files, MotorDriverParams, NODE_PARAMS,
    RobotParams, SimulatorParams, SlipEstimatorParams, Spec, specs, TireReceiverParams)
from smart_tire.parameters.files import check_names, flatten, from_arguments
from smart_tire.parameters.spec import group, param, part

SPEED = Spec('speed', 'float', 1.0, 'm/s', 'how fast', low=0.0, high=3.0)
COUNT = Spec('count', 'int', 4, '-', 'how many', low=1)
COLOUR = Spec('colour', 'str', 'red', '-', 'which one', choices=('red', 'blue'))
FLAG = Spec('flag', 'bool', False, '-', 'whether')
PAIR = Spec('pair', 'float[]', (0.0, 1.0), 'm', 'from, to', length=2)


@dataclass(frozen=True, kw_only=True)
class Wheel:
    """A wheel."""

    radius: float = param(0.1, 'm', 'rolling radius', low=0.01)


@dataclass(frozen=True, kw_only=True)
class Cart:
    """A cart whose front wheel has a prefix and whose axle has none."""

    name: str = param('cart', '-', 'what it is called')
    front: Wheel = group(Wheel)
    axle: Wheel = part(Wheel)


# One description


@pytest.mark.parametrize(('spec', 'value', 'expected'), [
    (SPEED, 2.5, 2.5), (SPEED, 2, 2.0), (SPEED, 0.0, 0.0), (SPEED, 3, 3.0),
    (COUNT, 7, 7), (COUNT, 7.0, 7),
    (COLOUR, 'blue', 'blue'), (FLAG, True, True),
    (PAIR, [1, 2.5], (1.0, 2.5)), (PAIR, (3.0, 4.0), (3.0, 4.0)),
])
def test_a_value_of_the_described_kind_is_taken(spec, value, expected):
    taken = spec.check(value)
    assert taken == expected
    assert type(taken) is type(expected)


@pytest.mark.parametrize(('spec', 'value', 'expected'), [
    (SPEED, -0.1, '0 to 3 m/s'), (SPEED, 3.1, '0 to 3 m/s'), (SPEED, math.nan, '0 to 3 m/s'),
    (SPEED, math.inf, '0 to 3 m/s'), (SPEED, '1.0', 'a float'), (SPEED, True, 'a float'),
    (SPEED, None, 'a float'), (SPEED, [1.0], 'a float'),
    (COUNT, 0, 'at least 1'), (COUNT, 1.5, 'a int'), (COUNT, False, 'a int'),
    (COLOUR, 'green', 'one of red, blue'), (COLOUR, 1, 'a str'),
    (FLAG, 1, 'a bool'), (FLAG, 'true', 'a bool'),
    (PAIR, [1.0], '2 numbers'), (PAIR, [1.0, 2.0, 3.0], '2 numbers'), (PAIR, 1.0, 'a list of'),
    (PAIR, '12', 'a list of'), (PAIR, [1.0, 'x'], 'a float'), (PAIR, [1.0, math.nan], 'finite'),
])
def test_a_refusal_names_parameter_value_and_what_was_expected(spec, value, expected):
    with pytest.raises(ParameterError) as caught:
        spec.check(value)
    assert f'parameter {spec.name}: ' in str(caught.value)
    assert expected in str(caught.value)


@given(st.floats(allow_nan=True, allow_infinity=True) | st.integers())
def test_what_passes_the_check_is_in_the_range(value):
    try:
        taken = SPEED.check(value)
    except ParameterError:
        assert not 0.0 <= value <= 3.0
    else:
        assert 0.0 <= taken <= 3.0


# A class


def test_names_of_a_group_have_its_prefix_and_those_of_a_part_have_none():
    assert list(specs(Cart)) == ['name', 'front.radius', 'radius']
    assert specs(Cart)['front.radius'].name == 'front.radius'


def test_building_puts_each_value_where_it_belongs():
    cart = build(Cart, {'front.radius': 1, 'radius': 0.5})
    assert cart == Cart(front=Wheel(radius=1.0), axle=Wheel(radius=0.5))


def test_an_unknown_name_is_refused_with_the_likeliest_meant():
    with pytest.raises(ParameterError, match=r'front\.radios, did you mean front\.radius\?'):
        build(Cart, {'front.radios': 1.0})


@pytest.mark.parametrize('cls', [*NODE_PARAMS.values(), RobotParams])
def test_defaults_are_their_own_values_and_lie_in_their_ranges(cls):
    described = specs(cls)
    assert build(cls, {name: spec.default for name, spec in described.items()}) == cls()


@pytest.mark.parametrize('cls', NODE_PARAMS.values())
def test_every_parameter_says_unit_and_meaning(cls):
    for spec in specs(cls).values():
        assert spec.unit
        assert spec.meaning


def test_parameters_of_one_name_are_the_same_for_all_nodes_where_the_robot_is_meant():
    for cls in NODE_PARAMS.values():
        described = specs(cls)
        for name, spec in specs(RobotParams).items():
            assert described[name] == spec


def test_parameters_do_not_change_behind_ones_back():
    with pytest.raises(FrozenInstanceError):
        RobotParams().mass = 1.0  # type: ignore[misc]


# What the contract promises


@pytest.mark.parametrize(('name', 'value', 'unit'), [
    ('wheel_radius', 0.087, 'm'), ('track_width', 0.38, 'm'), ('wheelbase', 0.26, 'm'),
    ('mass', 10.9, 'kg'), ('yaw_inertia', 0.35, 'kg m2'),
    ('center_of_mass', (0.0, 0.0, 0.11), 'm'), ('imu.position', (0.05, 0.02, 0.10), 'm'),
    ('imu.rotation', (0.0, 0.0, 0.0), 'rad'), ('imu.gyro_noise', 0.01, 'rad/s'),
    ('imu.accel_noise', 0.05, 'm/s2'), ('imu.gyro_bias', 0.01, 'rad/s'),
    ('imu.accel_bias', 0.05, 'm/s2'), ('encoder.counts_per_revolution', 2000, '-'),
    ('encoder.stamp_jitter', 0.001, 's'), ('encoder.latency', 0.0, 's'),
    ('tire.contact_length', 0.046, 'm'), ('tire.contact_width', 0.089, 'm'),
    ('tire.longitudinal_stiffness', 52.7, 'N'), ('tire.longitudinal_stiffness_sigma', 0.1, '-'),
    ('film.wheels', ('front_right',), '-'), ('film.length', 0.020, 'm'),
    ('film.width', 0.003, 'm'), ('film.spacing', 0.030, 'm'),
    ('film.stretch_gain', (307.5, 242.5), 'V/m'), ('film.stretch_gain_tolerance', 0.03, '-'),
    ('film.bending_peak', (0.83, 0.66), 'V'), ('film.bending_alpha', 67.0, '1/m'),
    ('film.release', 'fig8', '-'), ('film.noise', 0.005, 'V'),
    ('film.rest_voltage', 1.65, 'V'), ('film.voltage_range', 3.3, 'V'), ('film.bits', 10, '-'),
    ('film.sample_rate', 400, 'Hz'), ('slip.standstill_speed', 0.05, 'm/s'),
])
def test_names_defaults_and_units_are_those_of_the_papers_robot(name, value, unit):
    spec = specs(RobotParams)[name]
    assert (spec.default, spec.unit) == (value, unit)


def test_estimators_wait_as_long_as_their_slowest_input():
    assert FrictionEstimatorParams().reorder_window == 0.06
    assert SlipEstimatorParams().reorder_window == 0.03


# Values that contradict each other


@pytest.mark.parametrize(('cls', 'values', 'complaint'), [
    (RobotParams, {'film.stretch_gain': [1.0, 2.0, 3.0]}, 'film.stretch_gain has 3 values'),
    (RobotParams, {'film.positions': [0.0, 0.03, 0.06]}, 'film.stretch_gain has 2 values'),
    (RobotParams, {'film.positions': [0.03, 0.0]}, 'film.positions'),
    (RobotParams, {'film.positions': [-0.1, 0.0]}, 'film.positions'),
    (RobotParams, {'film.positions': [0.0, 0.6]}, 'more than the circumference'),
    (RobotParams, {'film.wheels': ['front_left', 'front_left']}, 'names a wheel twice'),
    (RobotParams, {'film.wheels': ['middle']}, 'one of front_left'),
    (TireReceiverParams, {'units': ['0013A20040A1B2C3']}, 'expected 16 hex digits'),
    (TireReceiverParams, {'units': ['0013=front_left']}, 'expected 16 hex digits'),
    (TireReceiverParams, {'units': ['0013A20040A1B2CX=front_left']}, 'expected 16 hex digits'),
    (TireReceiverParams, {'units': ['0013A20040A1B2C3=middle']}, 'expected 16 hex digits'),
    (TireReceiverParams, {'units': ['0013A20040A1B2C3=front_left', '0013A20040A1B2C3=rear_left']},
     'repeats'),
    (TireReceiverParams, {'units': ['0013A20040A1B2C3=front_left', '0013A20040A1B2C4=front_left']},
     'repeats'),
    (MotorDriverParams, {'addresses': [128, 128]}, 'the same'),
    (SimulatorParams, {'ground.base': 'ice'}, 'ground.base'),
    (SimulatorParams, {'ground.friction': [0.5]}, 'ground.friction has 1 values'),
    (SimulatorParams, {'ground.patches': ['ice=0,0,1,1']}, 'ground.patches'),
    (SimulatorParams, {'ground.patches': ['sand=0,0,1']}, 'ground.patches'),
    (SimulatorParams, {'ground.patches': ['sand=1,0,0,1']}, 'ground.patches'),
    (SimulatorParams, {'units': ['0013A20040A1B2C3=front_left']}, 'units'),
])
def test_values_that_contradict_each_other_are_refused_by_name(cls, values, complaint):
    with pytest.raises(ParameterError) as caught:
        build(cls, values)
    assert complaint in str(caught.value)


def test_units_are_read_as_addresses_of_wheels():
    units = ('0013A20040A1B2C3=front_right', 'FFFFFFFFFFFFFFFF=rear_left')
    assert TireReceiverParams(units=units).wheel_of() \
        == {0x0013A20040A1B2C3: 'front_right', 0xFFFFFFFFFFFFFFFF: 'rear_left'}


def test_two_values_serve_all_wheels_and_four_serve_two():
    film = RobotParams().film
    both = replace(film, wheels=('front_left', 'rear_right'))
    assert both.gains('front_left') == both.gains('rear_right') == (307.5, 242.5)
    own = replace(both, stretch_gain=(1.0, 2.0, 3.0, 4.0), bending_peak=(5.0, 6.0, 7.0, 8.0))
    assert own.gains('rear_right') == (3.0, 4.0)
    assert own.bending('front_left') == (5.0, 6.0)


def test_two_films_are_a_spacing_apart_unless_their_positions_are_given():
    film = build(RobotParams, {'film.spacing': 0.04}).film
    assert (film.count, film.places) == (2, (0.0, 0.04))
    three = build(RobotParams, {
        'film.positions': [0, 0.03, 0.3], 'film.wheels': ['front_left', 'front_right'],
        'film.stretch_gain': [1, 2, 3], 'film.bending_peak': [1, 2, 3, 4, 5, 6]}).film
    assert (three.count, three.places) == (3, (0.0, 0.03, 0.3))
    assert three.gains('front_right') == (1.0, 2.0, 3.0)
    assert three.bending('front_right') == (4.0, 5.0, 6.0)


@pytest.mark.parametrize(('positions', 'groups'), [
    ([0.0], [(0,)]), ([-1.0], [(0, 1)]), ([0.0, 0.03, 0.06], [(0, 1, 2)]),
    ([0.1, 0.13, 0.3, 0.33], [(0, 1), (2, 3)]), ([0.0, 0.18, 0.36], [(0,), (1,), (2,)]),
    ([0.06 * i for i in range(9)], [(0, 1, 2, 3), (4, 5, 6, 7), (8,)])])
def test_films_that_are_near_each_other_pass_together(positions, groups):
    count = 2 if positions == [-1.0] else len(positions)
    robot = build(RobotParams, {'film.positions': positions, 'film.stretch_gain': [300] * count,
                                'film.bending_peak': [0.8] * count})
    assert robot.film_groups == groups


# Files


def written(folder, name, text):
    """Return the path of a new file."""
    path = folder / name
    path.write_text(text, encoding='utf-8')
    return path


def loaded(*paths, node='cart'):
    """Return what ``paths`` give to ``node`` of the cart's parameters."""
    return load_files(paths, node, known_names([Cart]), specs(Cart))


def test_later_files_and_blocks_win(tmp_path):
    first = written(tmp_path, 'first.yaml', """
/**:
  ros__parameters: {name: anybody, radius: 0.2}
cart:
  ros__parameters: {name: me}
""")
    second = written(tmp_path, 'second.yaml', 'cart: {ros__parameters: {radius: 0.3}}')
    assert loaded(first, second) == {'name': 'me', 'radius': 0.3}


@pytest.mark.parametrize('block', [
    '/**', 'cart', '/cart', '/**/cart', '/robot/cart', 'c*'])
def test_a_block_is_for_the_node_that_its_last_part_names(tmp_path, block):
    path = written(tmp_path, 'any.yaml', f'"{block}": {{ros__parameters: {{name: me}}}}')
    assert loaded(path) == {'name': 'me'}
    assert (loaded(path, node='other') == {}) == (block != '/**')


def test_a_namespace_may_be_a_level_of_its_own(tmp_path):
    path = written(tmp_path, 'any.yaml', 'robot: {cart: {ros__parameters: {name: me}}}')
    assert loaded(path) == {'name': 'me'}


def test_names_may_be_nested_or_dotted(tmp_path):
    nested = written(tmp_path, 'a.yaml', 'cart: {ros__parameters: {front: {radius: 1.0}}}')
    dotted = written(tmp_path, 'b.yaml', 'cart: {ros__parameters: {front.radius: 1.0}}')
    assert loaded(nested) == loaded(dotted) == {'front.radius': 1.0}


def test_a_block_without_parameters_gives_none(tmp_path):
    assert loaded(written(tmp_path, 'a.yaml', 'cart: {ros__parameters: }')) == {}


def test_a_misspelt_name_is_refused_with_its_file(tmp_path):
    path = written(tmp_path, 'a.yaml', 'other: {ros__parameters: {front: {radios: 1.0}}}')
    with pytest.raises(ParameterError, match=r'a\.yaml: .*front\.radios, did you mean'):
        loaded(path)


@pytest.mark.parametrize('text', [
    '', '[1, 2]', 'cart: 1', 'cart: {name: me}', 'cart: {ros__parameters: [1]}', 'cart: {',
    '\x00'])
def test_what_is_no_parameter_file_is_refused_with_its_name(tmp_path, text):
    with pytest.raises(ParameterError, match=r'a\.yaml: '):
        loaded(written(tmp_path, 'a.yaml', text))


def test_bytes_that_are_no_text_are_refused(tmp_path):
    path = tmp_path / 'a.yaml'
    path.write_bytes(b'\xff\xfe\x00\x01\x80')
    with pytest.raises(ParameterError, match=r'a\.yaml: '):
        loaded(path)


def test_a_missing_file_is_refused_with_its_name(tmp_path):
    with pytest.raises(ParameterError, match=r'none\.yaml: cannot be read'):
        loaded(tmp_path / 'none.yaml')


def test_names_that_every_ros_node_has_are_known():
    check_names(['use_sim_time', 'qos_overrides./tf.publisher.depth', 'radius'], ['radius'])


def test_flattening_joins_names_with_dots():
    assert flatten({'a': {'b': {'c': 1}}, 'd': [2]}) == {'a.b.c': 1, 'd': [2]}


def test_on_a_command_line_what_stands_later_wins(tmp_path):
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
    ('/robot1/**', '/robot1/imu_driver', True), ('/robot1/*', '/robot2/imu_driver', False)])
def test_the_namespace_of_a_block_counts_for_a_node_that_has_one(tmp_path, block, node, meant):
    path = tmp_path / 'some.yaml'
    path.write_text(f'{block}: {{ros__parameters: {{mass: 7}}}}')
    words = ['node', '--ros-args', '--params-file', str(path)]
    assert from_arguments(words, node) == ({'mass': 7} if meant else {})


def test_numbers_may_be_written_without_a_point(tmp_path):
    path = tmp_path / 'some.yaml'
    path.write_text('/**: {ros__parameters: {mass: 1e1, film.noise: 5E-3, film.bits: 10}}')
    words = ['node', '--ros-args', '--params-file', str(path)]
    assert from_arguments(words, '/x') == {'mass': 10.0, 'film.noise': 0.005, 'film.bits': 10}
