"""Exceptions of this package, derived from built-in ones."""


class SmartTireError(Exception):
    """Base of all exceptions that this package raises."""


class FrameError(SmartTireError, ValueError):
    """Received bytes are not a valid frame."""


class LinkError(SmartTireError, OSError):
    """A port is absent, busy or lost."""


class ParameterError(SmartTireError, ValueError):
    """A parameter is unknown, of the wrong type, or outside its range."""


class MessageError(SmartTireError, ValueError):
    """A message has wrong names, wrong lengths or an impossible value."""


class CommandError(SmartTireError, ValueError):
    """A command is outdated or from a second publisher."""


class EstimatorError(SmartTireError, ArithmeticError):
    """An estimator received invalid input, or its state is invalid."""


class BagError(SmartTireError, OSError):
    """A bag cannot be read or written."""
