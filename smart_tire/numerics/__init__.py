"""Numerical methods that know nothing of robots: robust statistics and regression."""
