"""Motion: smooth motions through sampled poses.

Position is a cubic spline with not-a-knot ends, so that a parabola (a falling body) keeps its acceleration up to the
first sample. Rotation is a cubic spline through the four components of the unit quaternions, whose signs are made
continuous. A quaternion of this spline is normalised when it is evaluated. Position and rotation are exact at the
samples and twice continuously differentiable. Velocity, acceleration and angular velocity are the exact derivatives of
the interpolation, not differences.
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
