"""Multibody dynamics on the spatial operator algebra.

>>> m = phipsi.Model.from_urdf("arm.urdf")
>>> a = m.forward_dynamics(q=[0.1, 0.2], v=[0.0, 0.0], tau=[0.0, 0.0])

Conventions: six-vectors are angular first; quaternions x y z w; SI units; body velocities, Jacobians and momentum in world
axes; wrenches in body axes at the body frame's origin. Leading batch axes are always allowed. Molecules, in nm, ps, Da and
kJ/mol: ``phipsi.molecule``; ASE: ``phipsi.ase``. Operators of the algebra: ``phipsi.operators``. Many runs:
``phipsi.ensemble``.
"""

from . import interop, molecule
from ._ensemble import ensemble
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
    "ensemble",
    "interop",
    "molecule",
    "operators",
    "simulate",
]


def __getattr__(name: str):
    # ASE is imported when it is asked for.
    if name == "ase":
        from importlib import import_module

        return import_module(".ase", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
