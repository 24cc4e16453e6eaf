"""Every public name has a docstring, an example that runs, and a stub that says what the object is."""

from __future__ import annotations

import ast
import doctest
import inspect
import shutil
from pathlib import Path

import numpy as np
import pytest

import phipsi
import phipsi.ase

from .common import AMBER, ARM, MOLECULE

PACKAGE = Path(phipsi.__file__).parent

#: Classes that are only returned: their class docstring says everything.
RETURNED = {"AssemblyInfo", "ClosureProjection", "FieldSamples", "Filtered", "ForwardInfo", "Note", "Operator", "Operators", "Problem", "Report", "RunError", "Smoothed", "State", "Trajectory", "VelocityProjectionInfo", "WorstHinge"}


def public_objects():
    """(dotted name, object) of every public class, function, method and property."""
    found = []
    places = [("phipsi", phipsi), ("phipsi.interop", phipsi.interop), ("phipsi.errors", phipsi.errors), ("phipsi.molecule", phipsi.molecule), ("phipsi.ase", phipsi.ase)]
    for prefix, module in places:
        for name in module.__all__:
            thing = getattr(module, name)
            if inspect.ismodule(thing) or isinstance(thing, str):
                continue
            found.append((f"{prefix}.{name}", thing))
            if inspect.isclass(thing) and not issubclass(thing, (tuple, Exception)):
                # Members of ASE's classes are documented there.
                for member in vars(thing) if module is phipsi.ase else dir(thing):
                    if not member.startswith("_") and not isinstance(getattr(thing, member), (list, dict)):
                        found.append((f"{prefix}.{name}.{member}", getattr(thing, member)))
    return found


OBJECTS = dict(public_objects())


def is_call(thing) -> bool:
    return inspect.isroutine(thing)


def test_objects_were_found():
    assert "phipsi.Model.forward_dynamics" in OBJECTS and "phipsi.interop.MuJoCo.a_in" in OBJECTS
    assert len(OBJECTS) > 80


@pytest.mark.parametrize("name", OBJECTS)
def test_docstring(name):
    thing = OBJECTS[name]
    text = inspect.getdoc(thing) or ""
    assert len(text) > 10, f"{name} has no docstring"
    if is_call(thing):
        assert ">>>" in text, f"{name} has no example"


#: Modules whose docstrings have examples.
MODULES = {"phipsi": phipsi, "phipsi.interop": phipsi.interop, "phipsi.molecule": phipsi.molecule, "phipsi.ase": phipsi.ase}


def example_names():
    documented = [name for name, thing in OBJECTS.items() if ">>>" in (inspect.getdoc(thing) or "")]
    return [*documented, *MODULES]


@pytest.mark.parametrize("name", example_names())
def test_example(name, tmp_path, monkeypatch):
    for file in (ARM, *MOLECULE, *AMBER):
        shutil.copy(file, tmp_path / file.name)
    monkeypatch.chdir(tmp_path)
    thing = OBJECTS.get(name) or MODULES[name]
    scope = {"phipsi": phipsi, "np": np}
    example = doctest.DocTestParser().get_doctest(inspect.getdoc(thing), scope, name, None, 0)
    said = []
    result = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(example, out=said.append)
    assert result.attempted > 0 and result.failed == 0, "".join(said)


def stub(name: str) -> ast.Module:
    return ast.parse((PACKAGE / name).read_text(encoding="utf-8"))


def parameters(node: ast.FunctionDef) -> list[tuple[str, object]]:
    """Names and defaults of a stub's parameters, the receiver left out."""
    arguments = [*node.args.posonlyargs, *node.args.args]
    defaults = [None] * (len(arguments) - len(node.args.defaults)) + list(node.args.defaults)
    pairs = list(zip(arguments, defaults)) + list(zip(node.args.kwonlyargs, node.args.kw_defaults))
    empty = inspect.Parameter.empty
    return [
        (a.arg, empty if d is None else ast.literal_eval(d)) for a, d in pairs if a.arg not in ("self", "cls")
    ]


def of_runtime(thing) -> list[tuple[str, object]]:
    found = inspect.signature(thing).parameters.values()
    return [(p.name, p.default) for p in found if p.name != "self"]


def test_stub_matches_the_module():
    tree = stub("_native.pyi")
    classes = {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
    functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
    native = phipsi._native
    public = [name for name in dir(native) if not name.startswith("_")]
    assert sorted([*classes, *functions]) == sorted(public)
    for name, node in functions.items():
        assert parameters(node) == of_runtime(getattr(native, name)), name
    for name, node in classes.items():
        thing = getattr(native, name)
        members: dict[str, list[ast.FunctionDef]] = {}
        for member in node.body:
            assert isinstance(member, ast.FunctionDef), f"{name}: {ast.dump(member)}"
            members.setdefault(member.name, []).append(member)
        runtime = {m for m in vars(thing) if not m.startswith("_")}
        assert {m for m in members if not m.startswith("_")} == runtime, name
        for member, nodes in members.items():
            words = [ast.unparse(d) for n in nodes for d in n.decorator_list]
            if member == "__new__":
                assert parameters(nodes[0]) == of_runtime(thing)
                continue
            actual = getattr(thing, member)
            assert ("property" in words) == (not is_call(actual)), (name, member)
            if "property" in words:
                assert f"{member}.setter" in words or not _settable(thing, member), (name, member)
                continue
            # Of overloads, the last has the default that the first has not: names must agree in all.
            for one in nodes:
                wanted = of_runtime(actual)
                stated = parameters(one)
                assert [p for p, _ in stated] == [p for p, _ in wanted], (name, member)
                for (_, default), (parameter, expected) in zip(stated, wanted):
                    if "overload" in words and default is inspect.Parameter.empty:
                        continue
                    assert default == expected, (name, member, parameter)


#: Properties that can be set.
SETTABLE = {
    ("Model", "gravity"),
    ("Simulator", "state"),
    ("TorsionModel", "positions"),
    ("TorsionModel", "q"),
    ("TorsionModel", "v"),
    ("TorsionModel", "velocities"),
}


def _settable(thing: type, member: str) -> bool:
    return (thing.__name__, member) in SETTABLE


def test_settable_properties_have_setters():
    text = (PACKAGE / "_native.pyi").read_text(encoding="utf-8")
    assert all(f"@{member}.setter" in text for _, member in SETTABLE)


def test_package_is_typed_and_complete():
    assert (PACKAGE / "py.typed").exists()
    for name in phipsi.__all__:
        assert hasattr(phipsi, name)
    assert RETURNED <= set(phipsi.__all__)
    assert phipsi.__version__.count(".") == 2
