"""Required slip errors of the live estimator, without and with torque."""

from __future__ import annotations

# Run -> rms errors of the left and the right side: in steady intervals, on the straight run at all
# times against averaged truth.
MAX_SLIP_ERRORS = {
    'sweep_60': (0.011, 0.007),
    'sweep_80': (0.011, 0.007),
    'figure_eight': (0.006, 0.006),
    'straight': (0.038, 0.038),
}
