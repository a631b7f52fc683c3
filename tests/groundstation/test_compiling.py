"""The first compilation is announced, once; what the cache has is not."""

from __future__ import annotations

import signal
import time

import numba
import pytest

from groundstation.command import compiling, compiling_ahead
from groundstation.command.compiling import (
    COMPILING_AIR,
    COMPILING_METHODS,
    announced,
    compile_physics,
    compiling_text,
    load_physics,
)
from groundstation.command.compiling_ahead import LATER, WHOLE, CompilationAhead
from sim_bridge.aerodynamics.models import MODELS, is_compiled_separately
from sim_bridge.compiled import PLAIN
from sim_bridge.plant import Plant
from sim_bridge.plant_parts import PARTS
from sim_bridge.vehicles import load_vehicle

Capture = pytest.CaptureFixture[str]


def test_a_compilation_is_announced_once_when_it_begins(capsys: Capture) -> None:
    one, other = numba.njit(lambda x: x + 1), numba.njit(lambda x: x + 2)
    with announced():
        assert capsys.readouterr().err == ""
        assert one(1) == 2
        assert capsys.readouterr().err == f"{COMPILING_METHODS}\n"
        assert other(1) == 3 and one(2) == 3
    assert numba.njit(lambda x: x + 3)(1) == 4
    assert capsys.readouterr() == ("", "")
    with announced(quiet=True):
        assert numba.njit(lambda x: x + 4)(1) == 5
    assert capsys.readouterr() == ("", "")


def test_air_that_is_is_compiled_separately_is_announced_in_words_of_its_own(
    capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plant that compiles a kernel when it is built stands for the lattice, which takes half a minute."""
    vehicle = load_vehicle("robo_raven_ii_d")
    monkeypatch.setattr(compiling, "_announced", set())
    monkeypatch.setattr(compiling, "physics_compiled", lambda: True)
    monkeypatch.setattr(compiling, "Plant", lambda vehicle: numba.njit(lambda x: x + 1)(1))
    load_physics(vehicle)
    assert capsys.readouterr().err == ""
    lattice = vehicle._replace(aerodynamics=vehicle.aerodynamics._replace(model="vortex_lattice"))
    load_physics(lattice, quiet=True)
    assert capsys.readouterr().err == ""
    load_physics(lattice)
    assert capsys.readouterr().err == f"{COMPILING_AIR}\n"
    load_physics(lattice)
    assert capsys.readouterr().err == ""


def test_the_lattice_alone_is_is_compiled_separately() -> None:
    assert [name for name in MODELS if is_compiled_separately(name)] == ["vortex_lattice"]


def test_the_physics_is_announced_where_it_is_not_compiled(capsys: Capture, monkeypatch: pytest.MonkeyPatch) -> None:
    vehicle, compiled = load_vehicle("robo_raven_ii_d"), []
    monkeypatch.setattr(Plant, "compile", lambda plant: compiled.append(plant))
    monkeypatch.setattr(compiling_ahead, "available_cores", lambda: 1)
    monkeypatch.setattr(compiling_ahead, "compile_part", lambda plant, name: compiled.append(name))
    monkeypatch.setattr(compiling, "physics_compiled", lambda: False)
    load_physics(vehicle)
    first, last = capsys.readouterr().err.splitlines()
    assert first == compiling_text() and last.startswith("compiled 5 parts in ")
    assert compiled[:-1] == list(PARTS)
    load_physics(vehicle, quiet=True)
    monkeypatch.setattr(compiling, "physics_compiled", lambda: True)
    load_physics(vehicle)
    assert capsys.readouterr().err == "" and len(compiled) == 2 * (len(PARTS) + 1)


@pytest.fixture
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two cores, whatever this machine has: a second process is started."""
    monkeypatch.setattr(compiling_ahead, "available_cores", lambda: 2)


needs_parts = pytest.mark.skipif(PLAIN, reason="public numba does not compile in parts")


@needs_parts
@pytest.mark.usefixtures("two_cores")
def test_a_second_process_takes_parts_and_then_compiles_for_later() -> None:
    shown = []
    with CompilationAhead(load_vehicle("robo_raven_ii_d"), tuple(LATER)) as ahead:
        assert ahead.compile_physics(lambda *progress: shown.append(progress)) == len(PARTS) + 1
        ahead.wait()
        assert not ahead._later and ahead._process is not None and ahead._process.wait(20.0) == 0
    done, totals, names = zip(*shown, strict=True)
    assert list(done) == sorted(done) and set(totals) == {len(PARTS) + 1} and names[-1] == WHOLE


@needs_parts
@pytest.mark.usefixtures("two_cores")
def test_a_second_process_that_fails_leaves_its_work_to_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        compiling_ahead, "_START", "import sys; print('ready', flush=True); sys.stdin.buffer.readline()"
    )
    with CompilationAhead(load_vehicle("robo_raven_ii_d"), tuple(LATER)) as ahead:
        compile_physics(ahead, quiet=True)
        ahead.wait()


@needs_parts
@pytest.mark.usefixtures("two_cores")
@pytest.mark.parametrize("before_hanging", ["print('ready', flush=True)", "pass"])
def test_a_second_process_that_hangs_is_ended(monkeypatch: pytest.MonkeyPatch, before_hanging: str) -> None:
    """GIVEN a process that answers no more, in a part or before, THEN nothing waits longer than `PATIENCE` for it."""
    compiled: list[str] = []

    def compile_slowly(plant: Plant, name: str) -> None:
        deadline = time.monotonic() + 20.0
        while before_hanging != "pass" and ahead._remote is None and time.monotonic() < deadline:
            time.sleep(0.01)
        compiled.append(name)

    monkeypatch.setattr(compiling_ahead, "PATIENCE", 0.2)
    monkeypatch.setattr(compiling_ahead, "_START", f"import time; {before_hanging}; time.sleep(600.0)")
    monkeypatch.setattr(compiling_ahead, "compile_part", compile_slowly)
    monkeypatch.setattr(Plant, "compile", lambda plant: compiled.append(WHOLE))
    with CompilationAhead(load_vehicle("robo_raven_ii_d"), tuple(LATER)) as ahead:
        compile_physics(ahead, quiet=True)
        ahead.wait()
        assert ahead._process is not None and ahead._process.wait(20.0) == -signal.SIGKILL
    assert len(compiled) == len(PARTS) + (before_hanging == "pass") and compiled[-1] == WHOLE


def test_kernels_of_the_sensors_are_compiled_without_a_step_of_the_plant(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(plant: Plant) -> None:
        raise AssertionError("the plant's integrator is compiled by the other process")

    monkeypatch.setattr(Plant, "step", fail)
    LATER["sensors"](load_vehicle("robo_raven_ii_d"))
