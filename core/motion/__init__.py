"""Motion: poses sampled over time, made smooth enough to be differentiated twice.

Position is a cubic spline with not-a-knot ends, so a parabola (a falling body) keeps its acceleration to the very
first sample. Rotation is a cubic spline through the four components of the unit quaternions (signs made continuous),
normalised where it is read. Both are twice continuously differentiable and exact at the samples; velocity,
acceleration and angular velocity are the exact derivatives of the interpolation, not differences.
"""

from .motion import Motion, MotionSamples
from .rotation import accumulated, continuous, matrices, quaternions, rotations, singular, turns_of
from .rounded_path import RoundedPath
from .spline import Knots, Spline, second_derivatives, solve_tridiagonal

__all__ = [
    "Knots",
    "Motion",
    "MotionSamples",
    "RoundedPath",
    "Spline",
    "accumulated",
    "continuous",
    "matrices",
    "quaternions",
    "rotations",
    "second_derivatives",
    "singular",
    "solve_tridiagonal",
    "turns_of",
]
