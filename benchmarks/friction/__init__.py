"""Accuracy of friction against the method of paper B and the Cramer-Rao bound."""
