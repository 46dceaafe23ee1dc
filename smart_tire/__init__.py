"""Slip, pose and tire-road friction of a skid-steer robot from PVDF films in its tires."""

__version__ = '0.1.0'
