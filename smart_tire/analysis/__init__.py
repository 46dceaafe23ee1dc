"""Offline analysis: estimates from bags, accuracy against ground truth, figures."""
