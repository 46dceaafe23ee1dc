"""Start the estimators on a bag: ``ros2 launch smart_tire replay.launch.py bag:=DIR rate:=5``."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, Shutdown, TimerAction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

NODES = ('slip_estimator', 'friction_estimator')
FILES = {
    'robot': 'geometry, tires, films and sensors',
    'tuning': 'estimators',
}
LAST_ESTIMATES = 1.0  # s, from the end of the bag to the end of the estimators
LONGEST_START = 30.0  # s for the estimators to start and to be matched


def end(event, context):
    """End all; a replay that failed ends the launch with an error, so that its status says so."""
    if event.returncode and not context.is_shutdown:
        raise RuntimeError(f'replay failed with status {event.returncode}, its log says why: '
                           'there are no estimates, or not all of them')
    return [TimerAction(period=LAST_ESTIMATES, actions=[Shutdown(reason='the bag has ended')])]


def generate_launch_description():
    """Return the estimators and the player, which waits for them; all end when the bag ends."""
    config = PathJoinSubstitution([FindPackageShare('smart_tire'), 'config'])
    return LaunchDescription([
        DeclareLaunchArgument('namespace', default_value='',
                              description='of the topics in the bag'),
        DeclareLaunchArgument('bag', description='rosbag2 directory'),
        DeclareLaunchArgument('rate', default_value='1', description='times real time'),
        *(DeclareLaunchArgument(name, description=f'parameter file: {about}',
                                default_value=PathJoinSubstitution([config, f'{name}.yaml']))
          for name, about in FILES.items()),
        *(Node(package='smart_tire', executable=node, output='screen',
               namespace=LaunchConfiguration('namespace'),
               parameters=[LaunchConfiguration(name) for name in FILES])
          for node in NODES),
        Node(package='smart_tire', executable='smart_tire', output='screen',
             namespace=LaunchConfiguration('namespace'),
             arguments=['replay', LaunchConfiguration('bag'),
                        '--rate', LaunchConfiguration('rate'),
                        '--wait', str(LONGEST_START), '--wait-for', *NODES],
             on_exit=end),
    ])
