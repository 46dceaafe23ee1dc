"""Slip, pose and ICR of the robot: EKF on IMU and wheel encoders, and its RTS smoother."""
