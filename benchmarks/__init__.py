"""Benchmarks of accuracy, load and latency; not installed with the package."""
