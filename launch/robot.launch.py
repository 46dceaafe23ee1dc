"""Start the drivers, the estimators and the controller of one robot."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

NODES = ('tire_receiver', 'imu_driver', 'motor_driver', 'slip_estimator', 'friction_estimator',
         'wheel_controller')
FILES = {
    'robot': 'geometry, tires, films and sensors',
    'hardware': 'ports',
    'tuning': 'estimators and controller',
}
RESPAWN_DELAY = 2.0  # s, for a port to come back and a glance at the log


def generate_launch_description():
    """Return one process per node, all with the same parameter files."""
    config = PathJoinSubstitution([FindPackageShare('smart_tire'), 'config'])
    return LaunchDescription([
        DeclareLaunchArgument('namespace', default_value='', description='of all nodes'),
        DeclareLaunchArgument('respawn', default_value='false',
                              description='start a node anew when it dies'),
        *(DeclareLaunchArgument(name, description=f'parameter file: {about}',
                                default_value=PathJoinSubstitution([config, f'{name}.yaml']))
          for name, about in FILES.items()),
        *(Node(package='smart_tire', executable=node, output='screen',
               namespace=LaunchConfiguration('namespace'),
               parameters=[LaunchConfiguration(name) for name in FILES],
               respawn=LaunchConfiguration('respawn'), respawn_delay=RESPAWN_DELAY)
          for node in NODES),
    ])
