"""The physics without numba's inside and without a compiler: the same numbers."""

from __future__ import annotations

import ast
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plant_bench import air, hold_position, vehicle

from sim_bridge.plant import Plant

ROOT = Path(__file__).parents[2]
PRIVATE = ("numba.core", "llvmlite")
TICKS = 30


def last_state(name: str) -> list[float]:
    """The state after 0.15 s of flapping."""
    plant = Plant(vehicle(name))
    plant.follow([hold_position(0.4 * math.sin(0.13 * i), 0.005) for i in range(TICKS)], air())
    return [float(value) for value in plant.y]


def last_state_with(switch: str, name: str) -> list[float]:
    """`last_state` in a process with an environment variable set to 1."""
    paths = [str(ROOT), str(ROOT / "tests"), str(ROOT / "tests" / "sim_bridge")]
    code = f"import sys; sys.path[:0] = {paths!r}; import test_compiled_modes as t; print(*t.last_state({name!r}))"
    environment = os.environ | {switch: "1"}
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    assert answer.returncode == 0, answer.stderr
    return [float(word) for word in answer.stdout.split()]


@pytest.mark.parametrize("name", ["robo_raven_ii_d", "slow_hawk"])
def test_kernels_run_as_python_functions_with_the_same_result(name: str) -> None:
    np.testing.assert_allclose(last_state_with("NUMBA_DISABLE_JIT", name), last_state(name), rtol=1e-9, atol=1e-11)


@pytest.mark.validate  # numba compiles for minutes without the tricks
def test_plain_numba_gives_the_same_result() -> None:
    name = "robo_raven_ii_d"
    np.testing.assert_allclose(last_state_with("WINGBEAT_PLAIN_NUMBA", name), last_state(name), rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("switch", ["NUMBA_DISABLE_JIT", "WINGBEAT_PLAIN_NUMBA"])
def test_a_switch_leaves_numba_as_it_is(switch: str) -> None:
    code = (
        "from numba.core.codegen import CPUCodeLibrary as library; from numba.core.compiler import Flags; "
        "before = library._finalize_final_module, Flags.__hash__; import sim_bridge.plant; "
        "assert (library._finalize_final_module, Flags.__hash__) == before"
    )
    answer = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=os.environ | {switch: "1"}, cwd=ROOT
    )
    assert answer.returncode == 0, answer.stderr


def imports_of(path: Path) -> set[str]:
    tree = ast.walk(ast.parse(path.read_bytes()))
    names: set[str] = set()
    for node in tree:
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def test_only_compiled_imports_the_inside_of_numba() -> None:
    packages = ("wingbeat", "avionics", "sim_bridge", "logs", "groundstation")
    files = [path for package in packages for path in (ROOT / package).rglob("*.py")]
    private = {
        path.relative_to(ROOT).parent.as_posix()
        for path in files
        if any(name == p or name.startswith(f"{p}.") for name in imports_of(path) for p in PRIVATE)
    }
    assert private == {"sim_bridge/compiled"}
