"""Calibration of film gains, contact length and mounting angles from patch crossings."""
