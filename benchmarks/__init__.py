"""Benchmarks: accuracy, load and latency of the package; not installed with it."""
