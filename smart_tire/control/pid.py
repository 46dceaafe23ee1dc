"""A PID controller with feed-forward, limits, and an integral that does not wind up."""

from __future__ import annotations

from smart_tire.parameters.tuning import PidParams


class Pid:
    """Controller of one wheel: speed [rad/s] to duty [-1, 1]."""

    def __init__(self, params: PidParams) -> None:
        self.params = params  # may be replaced while running: the integral is a duty
        self.reset()

    def reset(self) -> None:
        """Forget the past: no integral, and the output starts from zero."""
        self._integral = 0.0
        self._output = 0.0
        self._measured: float | None = None

    def update(self, wanted: float, measured: float, dt: float) -> float:
        """
        Return the duty after ``dt`` seconds, within the limits of amount and of rate.

        The derivative is that of the measurement, so a step of the set point makes no spike.
        The integral holds while a limit acts and the error would push further into it.
        """
        params = self.params
        error = wanted - measured
        slope = 0.0 if self._measured is None else (measured - self._measured) / dt
        grown = self._integral + params.integral * error * dt
        sum_ = (params.feed_forward * wanted + params.proportional * error + grown
                - params.derivative * slope)
        output = self._limited(sum_, dt)
        if output == sum_ or (sum_ - output) * error < 0.0:
            self._integral = grown
        self._measured, self._output = measured, output
        return output

    def _limited(self, output: float, dt: float) -> float:
        step = self.params.rate_limit * dt
        output = min(max(output, self._output - step), self._output + step)
        return min(max(output, -self.params.limit), self.params.limit)
