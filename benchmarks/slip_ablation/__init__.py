"""Benchmark of the slip estimator with each of its special rules off."""
