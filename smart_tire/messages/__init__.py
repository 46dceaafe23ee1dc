"""
Samples to messages and back, by attribute access and without ROS.

Messages of rclpy, of rosbags (numpy arrays) and plain namespaces (lists) all work. A decoder
raises MessageError, naming topic and field, for what the contract does not allow; it maps joints
by name, in any order, and takes more of them than ours. A filler writes a sample into a message
that is empty, or was filled by it before, and returns it.
"""

from smart_tire.messages.header import set_header, stamp_of
from smart_tire.messages.joint_state import (
    decode_friction, decode_motor_command, decode_tire, decode_wheel_command, decode_wheel_slip,
    decode_wheels, fill_friction, fill_motor_command, fill_tire, fill_wheel_command,
    fill_wheel_slip, fill_wheels, film_names)
from smart_tire.messages.odometry_imu import (
    decode_battery, decode_icr, decode_imu, decode_odometry, decode_velocity, fill_battery,
    fill_icr, fill_imu, fill_odometry, fill_transform, fill_velocity)
from smart_tire.messages.topics import find_topic, Topic, topic_of, TOPICS

__all__ = [
    'decode_battery', 'decode_friction', 'decode_icr', 'decode_imu', 'decode_motor_command',
    'decode_odometry', 'decode_tire', 'decode_velocity', 'decode_wheel_command',
    'decode_wheel_slip', 'decode_wheels', 'fill_battery', 'fill_friction', 'fill_icr', 'fill_imu',
    'fill_motor_command', 'fill_odometry', 'fill_tire', 'fill_transform', 'fill_velocity',
    'fill_wheel_command', 'fill_wheel_slip', 'fill_wheels', 'film_names', 'find_topic',
    'set_header', 'stamp_of', 'Topic', 'topic_of', 'TOPICS']
