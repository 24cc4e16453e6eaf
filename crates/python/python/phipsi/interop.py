"""Coordinates of other programs: ``_in`` turns theirs into ours, ``_out`` ours into theirs.

Joints are matched by name, so that any order is understood. A name that the model does not know stands for its free base
("root_joint" in Pinocchio; MuJoCo's free joint may have any name or none). Batch axes are allowed everywhere.

====================  =======================================  =========================================
joint                 Pinocchio                                MuJoCo
====================  =======================================  =========================================
free: q               position, quaternion x y z w             position, quaternion **w x y z**
free: v               linear, angular; body axes               linear in **world** axes, angular in body axes
free: a               componentwise rate of v                  componentwise rate of v
spherical: q          quaternion x y z w                       quaternion w x y z
continuous: q         cos, sin                                 angle
planar: q             x, y, cos, sin                           x, y, angle (three joints, NAME_TX, _TY, _RZ)
planar: v             v_x, v_y, ω; body axes                   rates of x, y, angle: axes of the **plane**
one axis              as ours                                  as ours
====================  =======================================  =========================================

MuJoCo's linear velocity is not in body axes, so v, f and a of free and planar joints need the configuration, and a the
velocity too: pass them as ``q`` and ``v``, laid out as the first argument. With Pinocchio they may be left out. Pinocchio
moves every planar joint in its frame's x-y plane, whatever the normal in the file: only those with normal z are the same
mechanism there.

>>> m = phipsi.Model.from_urdf("arm.urdf", base="free")
>>> x = phipsi.interop.MuJoCo(m, ["free", "shoulder", "elbow"])
>>> x.q_out(m.neutral())
array([0., 0., 0., 1., 0., 0., 0., 0., 0.])
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import ArgumentError, ArgumentTypeError, NumericalError

if TYPE_CHECKING:
    from ._native import Model

__all__ = ["MuJoCo", "Pinocchio"]

Array = NDArray[np.float64]

_OURS_Q = {"spherical": 4, "floating": 7, "planar": 3, "translation": 3, "universal": 2, "cylindrical": 2}
_OURS_V = {"spherical": 3, "floating": 6, "planar": 3, "translation": 3, "universal": 2, "cylindrical": 2}


def _rotation(quaternion: Array) -> Array:
    """Rotation matrices (…, 3, 3), body to world, of quaternions x y z w of any length but zero."""
    x, y, z, w = np.moveaxis(quaternion, -1, 0)
    length = np.sqrt(x * x + y * y + z * z + w * w)
    if np.any(length == 0):
        raise NumericalError(
            "`q`: a quaternion of a free joint has length 0; the identity is x y z w = 0 0 0 1",
            quantity="length of the quaternion",
            found=0.0,
            required="a positive number",
        )
    x, y, z, w = x / length, y / length, z / length, w / length
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), [0, 1], [-2, -1])


def _turn(rotation: Array, vector: Array) -> Array:
    # Term by term, so that a state's result does not depend on its batch.
    x, y, z = (vector[..., i, None] for i in range(3))
    return rotation[..., 0] * x + rotation[..., 1] * y + rotation[..., 2] * z


def _read(name: str, value: ArrayLike, size: int) -> Array:
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise ArgumentTypeError(
            f"`{name}` is no regular array, but real numbers are required", argument=name, required="real numbers"
        ) from error
    if array.dtype.kind not in "fiu":
        raise ArgumentTypeError(
            f"`{name}` holds elements of type {array.dtype}, but real numbers are required",
            argument=name,
            found=str(array.dtype),
            required="real numbers",
        )
    if array.ndim == 0 or array.shape[-1] != size:
        raise ArgumentError(
            f"`{name}` has shape {array.shape}, but (…, {size}) is required",
            argument=name,
            found=array.shape,
            required=f"(…, {size})",
        )
    array = array.astype(np.float64)
    if not np.isfinite(array).all():
        at = np.argwhere(~np.isfinite(array))[0]
        found = float(array[tuple(at)])
        raise NumericalError(
            f"`{name}`: component {int(at[-1])} is {found}, but a finite number is required",
            quantity=name,
            component=int(at[-1]),
            found=found,
            required="a finite number",
            state=tuple(int(i) for i in at[:-1]) or None,
        )
    return array


class _Joint:
    """A moving joint: its type, and its first coordinates here and there."""

    def __init__(self, name: str, kind: str, here: tuple[int, int], there: tuple[int, int], sizes: tuple[int, int]) -> None:
        self.name = name
        self.kind = kind
        nq, nv = _OURS_Q.get(kind, 1), _OURS_V.get(kind, 1)
        self.q = slice(here[0], here[0] + nq)
        self.v = slice(here[1], here[1] + nv)
        self.their_q = slice(there[0], there[0] + sizes[0])
        self.their_v = slice(there[1], there[1] + sizes[1])


class _Layout:
    """Matches joints by name; subclasses say how a joint's coordinates are written there."""

    _program = ""

    def __init__(self, m: Model, joint_names: Sequence[str]) -> None:
        kinds = dict(zip(m.joint_names, m.joint_types))
        wanted = self._match(m, list(kinds), [str(name) for name in joint_names])
        self._model = m
        self._joints: list[_Joint] = []
        there = (0, 0)
        for name in wanted:
            sizes = self._sizes(name, kinds[name])
            here = (m.joint_q_offset(name), m.joint_v_offset(name))
            self._joints.append(_Joint(name, kinds[name], here, there, sizes))
            there = (there[0] + sizes[0], there[1] + sizes[1])
        #: Their numbers of coordinates.
        self.nq, self.nv = there
        self._ours = (m.nq, m.nv)

    def _match(self, m: Model, ours: list[str], theirs: list[str]) -> list[str]:
        names = [n for n in theirs if n != "universe" or n in ours]
        known, unknown = set(ours), [n for n in names if n not in ours]
        missing = [n for n in ours if n not in names]
        # A free base that no joint of the file makes has no name of its own: theirs stands for it.
        base = missing[0] if missing and missing[0] == ours[0] and missing[0] in m.body_names else None
        if len(unknown) == 1 and len(missing) == 1 and base is not None and m.joint_types[0] == "floating":
            names[names.index(unknown[0])] = base
            unknown, missing = [], []
        repeated = sorted({n for n in names if names.count(n) > 1})
        if unknown or missing or repeated or len(names) != len(known):
            what = [
                f"{word}: {', '.join(map(repr, found[:10]))}"
                for word, found in [("unknown", unknown), ("missing", missing), ("repeated", repeated)]
                if found
            ]
            raise ArgumentError(
                f"`joint_names` must name every moving joint once; {'; '.join(what)}",
                argument="joint_names",
                found=theirs,
                required=ours,
                remedy="load the model with base=\"free\" for a free base, and with mimic=\"free\" if joints mimic others",
            )
        return names

    def _sizes(self, name: str, kind: str) -> tuple[int, int]:
        raise NotImplementedError

    def _their_q(self, joint: _Joint, q: Array) -> Array:
        return q

    def _our_q(self, joint: _Joint, q: Array) -> Array:
        return q

    def _velocity(self, joint: _Joint, v: Array, rotation: Array | None, inward: bool) -> Array:
        return v

    def _force(self, joint: _Joint, f: Array, rotation: Array | None, inward: bool) -> Array:
        return self._velocity(joint, f, rotation, inward)

    def _acceleration(
        self, joint: _Joint, a: Array, rotation: Array | None, v: Array | None, inward: bool
    ) -> Array:
        return self._velocity(joint, a, rotation, inward)

    #: Types of joints whose velocities depend on the configuration there.
    _turning: frozenset[str] = frozenset()

    def _frame(self, joint: _Joint, q: Array, ours: bool) -> Array:
        """Rotation of a joint of these types, body to parent, from its coordinates, ours or theirs."""
        raise NotImplementedError

    def _map_q(self, q: ArrayLike, inward: bool) -> Array:
        x = _read("q", q, self.nq if inward else self._ours[0])
        out = np.zeros(x.shape[:-1] + (self._ours[0] if inward else self.nq,))
        for j in self._joints:
            if inward:
                out[..., j.q] = self._our_q(j, x[..., j.their_q])
            else:
                out[..., j.their_q] = self._their_q(j, x[..., j.q])
        return out

    def _map_v(
        self, what: str, x: ArrayLike, q: ArrayLike | None, v: ArrayLike | None, inward: bool
    ) -> Array:
        n = self.nv if inward else self._ours[1]
        values = _read(what, x, n)
        turning = [j.name for j in self._joints if j.kind in self._turning]
        for name, given, needed in [("q", q, True), ("v", v, what == "a")]:
            if turning and needed and given is None:
                raise ArgumentError(
                    f"`{name}` is missing: {self._program} writes the velocity of joint `{turning[0]}` in the parent's axes",
                    argument=name,
                    found=None,
                    required=f"the configuration{' and velocity' if what == 'a' else ''}, laid out as `{what}`",
                )
        shapes = [values.shape[:-1]]
        positions = velocities = None
        if q is not None:
            positions = _read("q", q, self.nq if inward else self._ours[0])
            shapes.append(positions.shape[:-1])
        if v is not None:
            velocities = _read("v", v, n)
            shapes.append(velocities.shape[:-1])
        try:
            batch = np.broadcast_shapes(*shapes)
        except ValueError as error:
            raise ArgumentError(
                f"batch axes {shapes} of `{what}`, `q`, `v` do not broadcast", argument=what, found=shapes
            ) from error
        out = np.zeros((*batch, self._ours[1] if inward else self.nv))
        for j in self._joints:
            source, target = (j.their_v, j.v) if inward else (j.v, j.their_v)
            part = np.broadcast_to(values[..., source], (*batch, source.stop - source.start))
            rotation = speed = None
            if j.kind in self._turning and positions is not None:
                where = j.their_q if inward else j.q
                rotation = self._frame(j, positions[..., where], not inward)
                if velocities is not None:
                    speed = velocities[..., source]
            if what == "a":
                out[..., target] = self._acceleration(j, part, rotation, speed, inward)
            elif what == "f":
                out[..., target] = self._force(j, part, rotation, inward)
            else:
                out[..., target] = self._velocity(j, part, rotation, inward)
        return out

    def q_in(self, q: ArrayLike) -> Array:
        """Our configuration (…, m.nq) of theirs (…, nq).

        Raises ArgumentError, NumericalError for numbers that are not finite.

        >>> m = phipsi.Model.from_urdf("arm.urdf", base="free")
        >>> x = phipsi.interop.MuJoCo(m, ["free", "shoulder", "elbow"])
        >>> x.q_in([0, 0, 0, 1, 0, 0, 0, 0.1, 0.2])
        array([0. , 0. , 0. , 0. , 0. , 0. , 1. , 0.1, 0.2])
        """
        return self._map_q(q, True)

    def q_out(self, q: ArrayLike) -> Array:
        """Their configuration (…, nq) of ours (…, m.nq); errors as ``q_in``.

        >>> m = phipsi.Model.from_urdf("arm.urdf")
        >>> phipsi.interop.Pinocchio(m, ["elbow", "shoulder"]).q_out([0.0, 0.2])
        array([0.2, 1. , 0. ])
        """
        return self._map_q(q, False)

    def v_in(self, v: ArrayLike, q: ArrayLike | None = None) -> Array:
        """Our velocity (…, m.nv) of theirs (…, nv); ``q``: their configuration, which MuJoCo's free joints need.

        Raises ArgumentError, NumericalError for numbers that are not finite.

        >>> m = phipsi.Model.from_urdf("arm.urdf", base="free")
        >>> x = phipsi.interop.MuJoCo(m, ["free", "shoulder", "elbow"])
        >>> x.v_in([1, 2, 3, 4, 5, 6, 7, 8], q=[0, 0, 0, 1, 0, 0, 0, 0, 0])
        array([4., 5., 6., 1., 2., 3., 7., 8.])
        """
        return self._map_v("v", v, q, None, True)

    def v_out(self, v: ArrayLike, q: ArrayLike | None = None) -> Array:
        """Their velocity (…, nv) of ours (…, m.nv); ``q``: our configuration. Errors as ``v_in``.

        >>> m = phipsi.Model.from_urdf("arm.urdf", base="free")
        >>> x = phipsi.interop.Pinocchio(m, ["root_joint", "shoulder", "elbow"])
        >>> x.v_out([1, 2, 3, 4, 5, 6, 7, 8])
        array([4., 5., 6., 1., 2., 3., 7., 8.])
        """
        return self._map_v("v", v, q, None, False)

    def f_in(self, f: ArrayLike, q: ArrayLike | None = None) -> Array:
        """Our generalized forces (…, m.nv) of theirs (…, nv), power-conjugate to v; ``q``: their configuration.

        Errors as ``v_in``.

        >>> m = phipsi.Model.from_urdf("arm.urdf")
        >>> phipsi.interop.MuJoCo(m, ["elbow", "shoulder"]).f_in([1, 2])
        array([2., 1.])
        """
        return self._map_v("f", f, q, None, True)

    def f_out(self, f: ArrayLike, q: ArrayLike | None = None) -> Array:
        """Their generalized forces (…, nv) of ours (…, m.nv); ``q``: our configuration. Errors as ``v_in``.

        >>> m = phipsi.Model.from_urdf("arm.urdf")
        >>> phipsi.interop.MuJoCo(m, ["elbow", "shoulder"]).f_out([1, 2])
        array([2., 1.])
        """
        return self._map_v("f", f, q, None, False)

    def a_in(self, a: ArrayLike, q: ArrayLike | None = None, v: ArrayLike | None = None) -> Array:
        """Our accelerations (…, m.nv) of theirs (…, nv); ``q``, ``v``: their state, which MuJoCo's free joints need.

        In Pinocchio accelerations have v's layout, and ``v_in`` does the same. In MuJoCo the linear part of a free joint is
        the rate of a velocity in world axes, ours of one in body axes: v̇ = Rᵀ a − ω × v. Errors as ``v_in``.

        >>> m = phipsi.Model.from_urdf("arm.urdf", base="free")
        >>> x = phipsi.interop.MuJoCo(m, ["free", "shoulder", "elbow"])
        >>> q, v = [0, 0, 0, 1, 0, 0, 0, 0, 0], [1, 0, 0, 0, 0, 2, 0, 0]
        >>> x.a_in([0, 0, 0, 0, 0, 0, 0, 0], q, v)[3:6]
        array([ 0., -2.,  0.])
        """
        return self._map_v("a", a, q, v, True)

    def a_out(self, a: ArrayLike, q: ArrayLike | None = None, v: ArrayLike | None = None) -> Array:
        """Their accelerations (…, nv) of ours (…, m.nv); ``q``, ``v``: our state. See ``a_in``.

        >>> m = phipsi.Model.from_urdf("arm.urdf")
        >>> phipsi.interop.Pinocchio(m, ["elbow", "shoulder"]).a_out([1, 2])
        array([2., 1.])
        """
        return self._map_v("a", a, q, v, False)


class Pinocchio(_Layout):
    """Pinocchio's layout: ``joint_names`` as ``model.names`` there, with or without "universe".

    Sizes ``nq``, ``nv`` are theirs. Angles of continuous and planar joints come back in (−π, π].

    >>> m = phipsi.Model.from_urdf("arm.urdf", base="free")
    >>> phipsi.interop.Pinocchio(m, ["universe", "root_joint", "shoulder", "elbow"]).nq
    10
    """

    _program = "Pinocchio"

    def _sizes(self, name: str, kind: str) -> tuple[int, int]:
        nq = {"continuous": 2, "planar": 4}.get(kind, _OURS_Q.get(kind, 1))
        return nq, _OURS_V.get(kind, 1)

    def _their_q(self, joint: _Joint, q: Array) -> Array:
        if joint.kind in ("continuous", "planar"):
            angle = q[..., -1:]
            return np.concatenate([q[..., :-1], np.cos(angle), np.sin(angle)], axis=-1)
        return q

    def _our_q(self, joint: _Joint, q: Array) -> Array:
        if joint.kind in ("continuous", "planar"):
            return np.concatenate([q[..., :-2], np.arctan2(q[..., -1:], q[..., -2:-1])], axis=-1)
        return q

    def _velocity(self, joint: _Joint, v: Array, rotation: Array | None, inward: bool) -> Array:
        if joint.kind == "floating":
            return np.roll(v, 3, axis=-1)
        if joint.kind == "planar":
            return np.roll(v, 1 if inward else -1, axis=-1)
        return v


class MuJoCo(_Layout):
    """MuJoCo's layout: ``joint_names`` in the order of its joints (``model.joint(i).name``).

    Sizes ``nq``, ``nv`` are theirs. Joints of several axes that MuJoCo has no type for are refused.

    >>> m = phipsi.Model.from_urdf("arm.urdf")
    >>> phipsi.interop.MuJoCo(m, ["shoulder", "elbow"]).nv
    2
    """

    _program = "MuJoCo"
    _turning = frozenset({"floating", "planar"})

    def _match(self, m: Model, ours: list[str], theirs: list[str]) -> list[str]:
        planar = {n for n, kind in zip(m.joint_names, m.joint_types) if kind == "planar"}
        names, i = [], 0
        while i < len(theirs):
            name = theirs[i].removesuffix("_TX")
            if name in planar and theirs[i : i + 3] == [name + "_TX", name + "_TY", name + "_RZ"]:
                names.append(name)
                i += 3
            else:
                names.append(theirs[i])
                i += 1
        return super()._match(m, ours, names)

    def _sizes(self, name: str, kind: str) -> tuple[int, int]:
        if kind not in ("revolute", "continuous", "prismatic", "spherical", "floating", "planar"):
            raise ArgumentError(
                f"joint `{name}` is {kind}, which MuJoCo has no joint for",
                argument="joint_names",
                found=kind,
                required="revolute, continuous, prismatic, planar, spherical or floating joints",
            )
        return _OURS_Q.get(kind, 1), _OURS_V.get(kind, 1)

    def _their_q(self, joint: _Joint, q: Array) -> Array:
        if joint.kind in ("spherical", "floating"):
            return np.concatenate([q[..., :-4], q[..., -1:], q[..., -4:-1]], axis=-1)
        return q

    def _our_q(self, joint: _Joint, q: Array) -> Array:
        if joint.kind in ("spherical", "floating"):
            return np.concatenate([q[..., :-4], q[..., -3:], q[..., -4:-3]], axis=-1)
        return q

    def _frame(self, joint: _Joint, q: Array, ours: bool) -> Array:
        if joint.kind == "planar":
            half = 0.5 * q[..., 2]
            zero = np.zeros_like(half)
            return _rotation(np.stack([zero, zero, np.sin(half), np.cos(half)], axis=-1))
        return _rotation(q[..., 3:] if ours else np.roll(q[..., 3:], -1, axis=-1))

    def _velocity(self, joint: _Joint, v: Array, rotation: Array | None, inward: bool) -> Array:
        if rotation is None:
            return v
        return _six_to(joint, _turned(_six_of(joint, v, inward), rotation, inward), not inward)

    def _acceleration(
        self, joint: _Joint, a: Array, rotation: Array | None, v: Array | None, inward: bool
    ) -> Array:
        if rotation is None or v is None:
            return a
        # With v_w = R v: its rate is R (v̇ + ω × v).
        six, speed = _six_of(joint, a, inward), _six_of(joint, v, inward)
        if inward:
            out = _turned(six, rotation, True)
            speed = _turned(speed, rotation, True)
            out[..., 3:] -= np.cross(speed[..., :3], speed[..., 3:])
        else:
            six[..., 3:] += np.cross(speed[..., :3], speed[..., 3:])
            out = _turned(six, rotation, False)
        return _six_to(joint, out, not inward)


def _six_of(joint: _Joint, x: Array, theirs: bool) -> Array:
    """Coordinates of a free or planar joint as those of a free one: ours angular first, theirs linear first."""
    if joint.kind == "floating":
        return np.array(x)
    out = np.zeros((*x.shape[:-1], 6))
    out[..., [0, 1, 5] if theirs else [2, 3, 4]] = x
    return out


def _six_to(joint: _Joint, six: Array, theirs: bool) -> Array:
    if joint.kind == "floating":
        return six
    return six[..., [0, 1, 5] if theirs else [2, 3, 4]]


def _turned(six: Array, rotation: Array, inward: bool) -> Array:
    """Theirs (linear in the parent's axes, angular) to ours (angular, linear; body axes), and back."""
    if inward:
        return np.concatenate([six[..., 3:], _turn(np.swapaxes(rotation, -1, -2), six[..., :3])], axis=-1)
    return np.concatenate([_turn(rotation, six[..., 3:]), six[..., :3]], axis=-1)
