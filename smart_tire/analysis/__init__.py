"""Samples in, figures and numbers out: what a run tells, and how far it is from the truth."""
