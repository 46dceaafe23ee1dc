"""Numerical methods without robot-specific terms: robust statistics and regression."""
