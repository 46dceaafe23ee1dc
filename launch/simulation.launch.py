"""Start the simulated robot and everything that runs on the real one, plugged into it."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description():
    """Return the simulator and ``robot.launch.py``, whose drivers open the simulator's ports."""
    share = FindPackageShare('smart_tire')
    robot, simulation, tuning = (
        LaunchConfiguration(name) for name in ('robot', 'simulation', 'tuning'))
    return LaunchDescription([
        DeclareLaunchArgument('namespace', default_value='', description='of all nodes'),
        *(DeclareLaunchArgument(name, description=f'parameter file: {about}',
                                default_value=PathJoinSubstitution(
                                    [share, 'config', f'{name}.yaml']))
          for name, about in (('robot', 'geometry, tires, films and sensors'),
                              ('simulation', 'ground, drive, radio and ports'),
                              ('tuning', 'estimators and controller'))),
        Node(package='smart_tire', executable='robot_simulator', output='screen',
             namespace=LaunchConfiguration('namespace'), parameters=[robot, simulation]),
        IncludeLaunchDescription(
            PathJoinSubstitution([share, 'launch', 'robot.launch.py']),
            launch_arguments={
                'namespace': LaunchConfiguration('namespace'),
                'robot': robot, 'hardware': simulation, 'tuning': tuning}.items()),
    ])
