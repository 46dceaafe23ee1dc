"""Accuracy of friction, compared with the method of paper B and the Cramer-Rao bound."""
