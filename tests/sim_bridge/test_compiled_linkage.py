"""What a kernel computes does not depend on what its process had loaded before."""

import hashlib
import math
import subprocess
import sys
from pathlib import Path

import numba
import pytest
from llvmlite.binding import Linkage
from plant_bench import air, hold_position, rates, vehicle

import sim_bridge.compiled  # noqa: F401  (it makes numba link internally)
from sim_bridge.plant import Plant


def simulate() -> str:
    """Digest of the last state of thirty plant steps."""
    plant = Plant(vehicle("robo_raven_ii_d"))
    plant.follow([hold_position(0.4 * math.sin(0.13 * i), 0.005) for i in range(30)], air())
    return hashlib.sha256(plant.y.tobytes()).hexdigest()


def loaded_another_first() -> str:
    """The same after the rates of a crank-driven bird, whose module holds copies of the same kernels."""
    other = Plant(vehicle("slow_hawk"))
    rates(other, other.y, hold_position(), air())
    return simulate()


@pytest.mark.validate
@pytest.mark.parametrize("before", ["simulate", "loaded_another_first"])
def test_a_flight_is_the_same_to_the_bit_whatever_was_computed_before(before: str) -> None:
    here = Path(__file__).parent
    code = f"import sys; sys.path[:0] = [{str(here)!r}, {str(here.parent)!r}]; import {Path(__file__).stem} as t; "
    answer = subprocess.run([sys.executable, "-c", code + f"print(t.{before}())"], capture_output=True, text=True)
    assert answer.stdout.strip() == simulate(), answer.stderr


def test_a_module_shows_the_linker_no_copy_of_another_kernel() -> None:
    @numba.njit
    def callee(x: float, n: int) -> float:
        for i in range(n):
            x = math.sin(x) + i if x < 1e3 else callee(x / 2.0, n - i)
        return x

    @numba.njit
    def caller(x: float) -> float:
        return callee(x, 7) + callee(2.0 * x, 9)

    assert caller(1.0) == caller.py_func(1.0)
    (compiled,) = caller.overloads.values()
    defined = [f for f in compiled.library._final_module.functions if not f.is_declaration]
    copies = [f for f in defined if "callee" in f.name]
    assert copies and all(f.linkage == Linkage.internal for f in copies)
    assert any(f.linkage == Linkage.external for f in defined)
