"""Wheel control: velocity commands to motor duties; time is an argument."""
