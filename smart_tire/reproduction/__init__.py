"""Figures and tables of papers A and B, computed by the models and estimators of this package."""
