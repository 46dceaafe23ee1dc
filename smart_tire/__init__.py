"""Smart tire: what a skid-steered robot feels through piezoelectric films in its tires."""

__version__ = '0.1.0'
