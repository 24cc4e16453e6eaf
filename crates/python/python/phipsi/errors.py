"""The errors that phipsi raises. Every one says where, what was found, what is required and what to do."""

from __future__ import annotations

from typing import Any

__all__ = ["ArgumentError", "ArgumentTypeError", "Error", "ModelError", "NumericalError"]


class Error(Exception):
    """Base of all errors of phipsi."""

    def __init__(self, message: str = "") -> None:
        super().__init__(message)


class ArgumentError(Error, ValueError):
    """An argument of the wrong shape, an unknown name or an unknown choice.

    ``argument``: its name. ``found``, ``required``: shapes as tuples or text. ``remedy``: what to do, or None.
    """

    def __init__(
        self, message: str = "", *, argument: Any = None, found: Any = None, required: Any = None, remedy: Any = None
    ) -> None:
        super().__init__(message)
        self.argument = argument
        self.found = found
        self.required = required
        self.remedy = remedy


class ArgumentTypeError(ArgumentError, TypeError):
    """An argument whose elements are no real numbers, or of the wrong type. Fields: those of ArgumentError."""


class ModelError(Error, ValueError):
    """A model that cannot be used: a file with errors, or one that this calculation does not serve.

    ``report``: the reader's report, or None. ``errors``, ``warnings``: lists of Problem with
    ``line, place, found, required, remedy``.
    """

    def __init__(self, message: str = "", *, report: Any = None, errors: Any = (), warnings: Any = ()) -> None:
        super().__init__(message)
        self.report = report
        self.errors = list(errors)
        self.warnings = list(warnings)


class NumericalError(Error, ArithmeticError):
    """A number that is not finite, a singular joint, or a step that cannot be made.

    ``quantity``: what failed. ``joint``, ``component``: where, or None. ``found``: the value. ``required``, ``remedy``:
    text. ``state``: index of the failing state in the batch (a tuple), None without a batch. ``term``, ``atoms``: of a force
    field, its term and the indices of its atoms. ``time``, ``trajectory``: in simulations, the time of the last good state
    and the Trajectory so far.
    """

    def __init__(
        self,
        message: str = "",
        *,
        quantity: Any = None,
        joint: Any = None,
        component: Any = None,
        found: Any = None,
        required: Any = None,
        remedy: Any = None,
        state: Any = None,
        term: Any = None,
        atoms: Any = (),
        time: Any = None,
        trajectory: Any = None,
    ) -> None:
        super().__init__(message)
        self.quantity = quantity
        self.joint = joint
        self.component = component
        self.found = found
        self.required = required
        self.remedy = remedy
        self.state = state
        self.term = term
        self.atoms = tuple(atoms)
        self.time = time
        self.trajectory = trajectory
