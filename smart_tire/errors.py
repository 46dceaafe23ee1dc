"""The errors of this package: one small tree, rooted in the builtins."""


class SmartTireError(Exception):
    """Base of every error that this package raises on purpose."""


class FrameError(SmartTireError, ValueError):
    """Bytes from a wire do not form what they claim to be."""


class LinkError(SmartTireError, OSError):
    """A port is absent, busy, or went away."""


class ParameterError(SmartTireError, ValueError):
    """A parameter is unknown, of the wrong type, or outside its range."""


class MessageError(SmartTireError, ValueError):
    """A message breaks the contract: wrong names, lengths, or a value that can not be."""


class CommandError(SmartTireError, ValueError):
    """A command is not from the present, or not from the one publisher that may command."""


class EstimatorError(SmartTireError, ArithmeticError):
    """An estimator was fed what it can not use, or its state broke."""


class BagError(SmartTireError, OSError):
    """A bag can not be read or written."""
