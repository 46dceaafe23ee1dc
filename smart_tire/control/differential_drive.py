"""Inverse kinematics of the equivalent differential drive."""

from __future__ import annotations

from smart_tire.samples import Four, VelocityCommand


def wheel_speeds(command: VelocityCommand, *, radius: float, effective_track: float) -> Four:
    """
    Return the wheel speeds [rad/s] of a body velocity without longitudinal slip, B(1).

    ``effective_track`` [m] is the track of the differential drive with the same yaw rate; a
    skid-steer robot slips while turning, so it is larger than the geometric track.

    >>> command = VelocityCommand(0, v_x=0.5, yaw_rate=1.0)
    >>> wheel_speeds(command, radius=0.1, effective_track=0.4)
    (3.0, 7.0, 3.0, 7.0)
    """
    difference = 0.5 * effective_track * command.yaw_rate
    left, right = (command.v_x - difference) / radius, (command.v_x + difference) / radius
    return left, right, left, right
