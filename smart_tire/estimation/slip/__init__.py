"""Slip, pose and ICR of the robot: EKF with IMU and wheel encoders, and its RTS smoother."""
