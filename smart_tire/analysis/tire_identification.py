"""Bags to what is identified of tires, and what is found to parameters."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from smart_tire.analysis.identification import NO_REFERENCE, read_recording, Span
from smart_tire.estimation import stiffness_identification
from smart_tire.estimation.stiffness_identification import StiffnessFit
from smart_tire.parameters import RobotParams
from smart_tire.parameters.identified import Identified


def identify_stiffness(bags: Sequence[Path], robot: RobotParams,
                       span: Span) -> StiffnessFit:
    """
    Return the stiffness C_x that ``bags`` of one robot on one ground tell together.

    Raises BagError if one can not be read, EstimatorError with the reason where they do not tell.
    """
    return stiffness_identification.identify_stiffness(
        [read_recording(bag, robot, span, NO_REFERENCE) for bag in bags], robot)


def stiffness_parameters(found: StiffnessFit) -> list[Identified]:
    """Return what goes into a parameter file."""
    told = found.stiffness
    return [Identified('tire.longitudinal_stiffness', told.value, told.sigma),
            Identified('tire.longitudinal_stiffness_sigma', told.sigma / told.value,
                       note='of this tire on the ground of the recording')]
