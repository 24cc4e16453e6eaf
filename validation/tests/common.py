"""Models that the tests share."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import phipsi

ARM = Path(__file__).with_name("arm.urdf")

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"

#: Alanine dipeptide: PDB and System.
MOLECULE = (EXAMPLES / "ala_dipeptide.pdb", EXAMPLES / "ala_dipeptide.xml")

#: The same molecule in AMBER's files: prmtop and inpcrd.
AMBER = (EXAMPLES / "ala_dipeptide.prmtop", EXAMPLES / "ala_dipeptide.inpcrd")

EPSILON = float(np.finfo(float).eps)

_INERTIAL = (
    '<inertial><origin xyz="{x} 0.1 -0.2" rpy="0.1 {x} 0.3"/><mass value="{mass}"/>'
    '<inertia ixx="0.31" iyy="0.4" izz="0.52" ixy="0.01" ixz="-0.02" iyz="0.03"/></inertial>'
)


def link(name: str, mass: float = 1.0, x: float = 0.1) -> str:
    """A link with an inertia that has no symmetry."""
    return f'<link name="{name}">{_INERTIAL.format(mass=mass, x=x)}</link>'


def joint(name: str, kind: str, parent: str, child: str, axis: str = "0 0 1", inside: str = "") -> str:
    """A joint at a displaced and turned frame."""
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>' if kind in ("revolute", "prismatic") else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.3 -0.2 0.5" rpy="0.2 -0.4 0.7"/><axis xyz="{axis}"/>{limit}{inside}</joint>'
    )


def mixed(*kinds: str, axes: tuple[str, ...] = ()) -> str:
    """The text of a tree with one joint of each kind, the first at the root; two branches."""
    parts = [link("body0", 3.0)]
    for i, kind in enumerate(kinds):
        parent = f"body{i}" if i != 2 else "body0"
        axis = axes[i] if i < len(axes) else "0 0 1"
        parts += [link(f"body{i + 1}", 1.0 + i, 0.1 * i), joint(f"z{9 - i}", kind, parent, f"body{i + 1}", axis)]
    return f'<robot name="mixed">{"".join(parts)}</robot>'


def arm(base: str = "fixed") -> phipsi.Model:
    """Two links."""
    return phipsi.Model.from_urdf(ARM, base=base)
