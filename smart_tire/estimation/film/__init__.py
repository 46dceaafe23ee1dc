"""Deflection from the charge of a calibrated film: inverse hysteresis with standard deviations."""
