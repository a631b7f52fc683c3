"""A kernel is recompiled when what it imports changes, and not otherwise; caches of earlier sources are removed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

import sim_bridge
from sim_bridge.compiled import cache

PROGRAM = """
import sys
from sim_bridge.{0} import run
print(run(2.0), sum(run.stats.cache_misses.values()))
"""
CALLEE = "from sim_bridge.compiled import kernel\n\n\n@kernel\ndef scale(x):\n    return {factor} * x\n"
CALLER = (
    "from sim_bridge.compiled import kernel\nfrom sim_bridge.{0} import scale\n\n\n"
    "@kernel\ndef run(x):\n    return scale(x) + 1.0\n"
)
ALONE = "from sim_bridge.compiled import kernel\n\n\n@kernel\ndef run(x):\n    return 3.0 * x\n"

MIXED = """
import sys
import numpy as np
from sim_bridge.compiled import kernel
from sim_bridge.squares import run
x = np.arange(3.0)
print(run(x, x), sum(run.stats.cache_misses.values()), "scipy.linalg" in sys.modules)

@kernel
def later(x):
    return np.dot(x, x) + run(x, x)

print(later(x))
"""
SQUARES = (
    "from math import pi, sin\n\nfrom sim_bridge.compiled import kernel\n\n\n@kernel\ndef run(x, y):\n"
    "    total = sin(pi / 2.0)\n    for i in range(len(x)):\n        total += x[i] * y[i]\n    return total\n"
)


class Checkout:
    """A copy of `sim_bridge.compiled` beside three kernel files: ``caller`` imports ``callee``, ``alone`` neither."""

    def __init__(self, folder: Path) -> None:
        self.root, self.kernels = folder / "checkout", folder / "cache" / "wingbeat" / "kernels"
        self.package = self.root / "sim_bridge"
        source = Path(sim_bridge.__file__).parent
        shutil.copytree(source / "compiled", self.package / "compiled", ignore=shutil.ignore_patterns("__pycache__"))
        (self.package / "__init__.py").touch()
        self.write_callee(2.0)
        (self.package / "caller.py").write_text(CALLER.format("callee"))
        (self.package / "alone.py").write_text(ALONE)

    def write_callee(self, factor: float) -> None:
        (self.package / "callee.py").write_text(CALLEE.format(factor=factor))

    def run(self, module: str) -> tuple[float, int]:
        """Value of ``run(2.0)`` of a module in a new process, and how many kernels were compiled for it."""
        value, compiled = self.output(PROGRAM.format(module)).split()
        return float(value), int(compiled)

    def output(self, program: str) -> str:
        """Standard output of a program in a new process."""
        (self.root / "program.py").write_text(program)
        environment = {"PATH": "", "WINGBEAT_CACHE": str(self.kernels.parents[1]), "PYTHONPATH": str(self.root)}
        command = [sys.executable, "-B", "program.py"]
        answer = subprocess.run(command, env=environment, cwd=self.root, capture_output=True, text=True)
        assert answer.returncode == 0, answer.stderr
        return answer.stdout

    def states(self, module: str) -> int:
        """How many states of a module's sources the cache has kernels of."""
        return len([path for path in self.kernels.glob(f"{module}-*/*") if path.is_dir()])


def test_only_kernels_that_import_a_changed_file_are_compiled_again(tmp_path: Path) -> None:
    checkout = Checkout(tmp_path)
    assert checkout.run("caller") == (5.0, 1) and checkout.run("alone") == (6.0, 1)
    assert checkout.run("caller") == (5.0, 0) and checkout.run("alone") == (6.0, 0)
    checkout.write_callee(4.0)
    assert checkout.run("alone") == (6.0, 0)
    assert checkout.run("caller") == (9.0, 1)
    assert checkout.states("caller") == 1 and checkout.states("callee") == 1


@pytest.mark.validate
def test_kernel_of_a_removed_class_is_compiled_again(tmp_path: Path) -> None:
    """GIVEN a kernel in the cache for a named tuple WHEN its class has another name THEN it is compiled again."""
    checkout = Checkout(tmp_path)
    (checkout.package / "first.py").write_text(ALONE.replace("3.0 * x", "x[0]"))
    for name in ("Pair", "Couple", "Couple"):
        fields = "    a: float\n    b: float\n"
        (checkout.package / "pairs.py").write_text(
            f"from typing import NamedTuple\n\n\nclass {name}(NamedTuple):\n{fields}"
        )
        program = (
            f"from sim_bridge.first import run\nfrom sim_bridge.pairs import {name}\nprint(run({name}(2.0, 3.0)))"
        )
        assert checkout.output(program) == "2.0\n"


@pytest.mark.validate
def test_kernels_of_files_that_are_gone_are_removed(tmp_path: Path) -> None:
    checkout = Checkout(tmp_path)
    checkout.run("alone")
    for name, age in ("unmarked and old", 2.0 * cache.UNMARKED_AGE), ("unmarked and new", 0.0):
        folder = checkout.kernels / name
        folder.mkdir()
        os.utime(folder, (time.time() - age,) * 2)
    (checkout.package / "alone.py").unlink()
    checkout.run("caller")
    names = {path.name.partition("-")[0] for path in checkout.kernels.iterdir()}
    assert names == {"callee", "caller", "unmarked and new"}


def test_dependencies_are_followed_through_every_form_of_import(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "sim_bridge"
    package.mkdir()
    for name in ("__init__", "one", "two", "three", "four", "other"):
        (package / f"{name}.py").touch()
    (package / "one.py").write_text("from sim_bridge import (\n    two,\n)\nimport numpy\n")
    (package / "two.py").write_text("def f():\n    import sim_bridge.three as t, sim_bridge.four\n")
    monkeypatch.setattr(cache, "_ROOT", tmp_path)
    for function in (cache.imported_files, cache.dependencies, cache._file_of):
        function.cache_clear()
    try:
        names = {path.stem for path in cache.dependencies(package / "one.py")}
    finally:
        for function in (cache.imported_files, cache.dependencies, cache._file_of):
            function.cache_clear()
    assert names == {"__init__", "one", "two", "three", "four"}


def test_the_plant_depends_on_its_air_and_not_on_the_sensors() -> None:
    root = Path(sim_bridge.__file__).parent
    names = {
        str(path.relative_to(root)) for path in cache.dependencies(root / "plant_kernel.py") if root in path.parents
    }
    assert {"aerodynamics/strip_theory.py", "vectors.py", "compiled/decorators.py"} <= names
    assert not any(name.startswith(("sensors", "flight", "validation", "tuning")) for name in names)


def test_cached_kernel_loads_without_the_compiler_and_others_compile(tmp_path: Path) -> None:
    """GIVEN a cached kernel, WHEN loaded, THEN the compiler is not set up until another kernel needs it."""
    checkout = Checkout(tmp_path)
    (checkout.package / "squares.py").write_text(SQUARES)
    first, second = (checkout.output(MIXED).split() for _ in range(2))
    assert first == ["6.0", "1", "True", "11.0"]
    assert second == ["6.0", "0", "False", "11.0"]


@pytest.mark.validate
def test_a_function_with_two_sets_of_options_has_two_entries(tmp_path: Path) -> None:
    """GIVEN a function of a file that imports nothing, WHEN two kernels are made of it, THEN each loads its own."""
    checkout = Checkout(tmp_path)
    (checkout.package / "leaf.py").write_text("def run(x, y):\n    return (x + y) - x\n")
    program = (
        "from sim_bridge.compiled import exact, kernel\nfrom sim_bridge.leaf import run\n"
        "for make in {0}:\n    made = make(run)\n    print(made(1e20, 1.0), sum(made.stats.cache_misses.values()))\n"
    )
    assert checkout.output(program.format("kernel, exact")).split() == ["1.0", "1", "0.0", "1"]
    assert checkout.output(program.format("exact, kernel")).split() == ["0.0", "0", "1.0", "0"]


@pytest.mark.validate
def test_a_change_of_the_decorators_recompiles_a_file_that_does_not_import_them(tmp_path: Path) -> None:
    checkout = Checkout(tmp_path)
    (checkout.package / "leaf.py").write_text("def run(x):\n    return 2.0 * x\n")
    program = (
        "from sim_bridge.compiled import kernel\nfrom sim_bridge.leaf import run\n"
        "made = kernel(run)\nprint(made(1.0), sum(made.stats.cache_misses.values()))\n"
    )
    assert [checkout.output(program) for _ in range(2)] == ["2.0 1\n", "2.0 0\n"]
    with (checkout.package / "compiled" / "decorators.py").open("a") as decorators:
        decorators.write("# another version\n")
    assert checkout.output(program) == "2.0 1\n"


@pytest.mark.validate
def test_an_error_of_rebuilding_a_kernel_is_not_taken_for_a_removed_class(tmp_path: Path) -> None:
    checkout = Checkout(tmp_path)
    assert checkout.run("alone") == (6.0, 1)
    program = (
        "from numba.core.caching import CompileResultCacheImpl as implementation\n"
        "from sim_bridge.alone import run\n"
        "def rebuild(*arguments):\n    raise AttributeError('a name that this release lacks')\n"
        "implementation.rebuild = rebuild\n"
        "try:\n    run(2.0)\nexcept AttributeError as error:\n    print(error)\n"
    )
    assert checkout.output(program) == "a name that this release lacks\n"
    assert checkout.run("alone") == (6.0, 0)
