"""Types: the stubs match the module, and the package keeps them."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import voxsplat
from voxsplat.renderer import FACTS

CONFIG = Path(__file__).parents[1] / "pyproject.toml"
INSTALLED = Path(voxsplat.__file__).parent


def run(*words: str) -> None:
    words = (sys.executable, "-m", *words)
    environment = {**os.environ, "MYPYPATH": str(INSTALLED.parent), "PYTHONPATH": str(INSTALLED.parent)}
    # Not in the folder of the sources, which have no native module.
    done = subprocess.run(words, capture_output=True, text=True, check=False, cwd=Path(__file__).parent, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr


def test_stubs_name_what_the_native_module_has() -> None:
    stub = ast.parse((INSTALLED / "_native.pyi").read_text())

    def names(of: object) -> set[str]:
        return {name for name in vars(of) if not name.startswith("_")}

    kinds = {node.name: node for node in stub.body if isinstance(node, ast.ClassDef)}
    functions = {node.name for node in stub.body if isinstance(node, ast.FunctionDef)}
    native = voxsplat._native
    assert functions | set(kinds) == names(native)
    assert set(native.__all__) == functions | set(kinds) | {"__version__"}
    for name, node in kinds.items():
        methods = {method.name for method in node.body if isinstance(method, ast.FunctionDef)}
        own = names(getattr(native, name)) - names(getattr(native, name).__base__)
        assert {method for method in methods if not method.startswith("_")} == own, name


@pytest.mark.slow
def test_stubs_describe_the_native_module() -> None:
    run("mypy.stubtest", "voxsplat._native", "--mypy-config-file", str(CONFIG))


def test_help_describes_every_option() -> None:
    fields = {field.name for kind in (voxsplat.View, voxsplat.Settings) for field in dataclasses.fields(kind)}
    facts = set(FACTS)
    functions = (voxsplat.render, voxsplat.plan, voxsplat.view)
    for function, options in (*((function, fields | facts) for function in functions), (voxsplat.info, facts)):
        described = set(re.split(r", |\n", "\n".join(re.findall(r"^[a-z]\w*(?:, \w+)*$", function.__doc__, re.MULTILINE))))
        assert options | set(inspect.signature(function).parameters) - {"options"} <= described, function.__name__


@pytest.mark.slow
def test_the_package_keeps_its_types() -> None:
    run("mypy", "--config-file", str(CONFIG), "-p", "voxsplat")
