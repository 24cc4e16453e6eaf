"""Multibody dynamics on the spatial operator algebra.

>>> m = phipsi.Model.from_urdf("arm.urdf")
>>> a = m.forward_dynamics(q=[0.1, 0.2], v=[0.0, 0.0], tau=[0.0, 0.0])

Conventions: six-vectors are angular first; quaternions x y z w; SI units; body velocities, Jacobians and momentum in world
axes; wrenches in body axes at the body frame's origin. Leading batch axes are always allowed. Molecules, in nm, ps, Da and
kJ/mol: ``phipsi.molecule``. Operators of the algebra: ``phipsi.operators``.
"""

from . import interop, molecule
from ._native import (
    AssemblyInfo,
    ClosureProjection,
    FieldSamples,
    Filtered,
    FlexibleBody,
    ForwardInfo,
    InverseKinematicsInfo,
    Model,
    Note,
    Operator,
    Operators,
    OperationalSpaceInfo,
    Problem,
    Report,
    RunError,
    Simulator,
    Smoothed,
    Trajectory,
    VelocityProjectionInfo,
    WorstHinge,
    __version__,
    operators,
    simulate,
)
from .errors import ArgumentError, ArgumentTypeError, Error, ModelError, NumericalError
from .state import State

__all__ = [
    "ArgumentError",
    "ArgumentTypeError",
    "AssemblyInfo",
    "ClosureProjection",
    "Error",
    "FieldSamples",
    "Filtered",
    "FlexibleBody",
    "ForwardInfo",
    "InverseKinematicsInfo",
    "Model",
    "ModelError",
    "Note",
    "NumericalError",
    "Operator",
    "Operators",
    "OperationalSpaceInfo",
    "Problem",
    "Report",
    "RunError",
    "Simulator",
    "Smoothed",
    "State",
    "Trajectory",
    "VelocityProjectionInfo",
    "WorstHinge",
    "__version__",
    "interop",
    "molecule",
    "operators",
    "simulate",
]
