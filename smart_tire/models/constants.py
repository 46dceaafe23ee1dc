"""Physical constants."""

GRAVITY = 9.80665  # m/s2, standard acceleration of free fall (ISO 80000-3)
