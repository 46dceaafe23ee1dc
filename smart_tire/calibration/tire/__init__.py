"""Calibration of the tire: longitudinal stiffness from straight-line driving."""
