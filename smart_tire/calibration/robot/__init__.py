"""Calibration of encoders, IMU, geometry and ICR of the robot."""
