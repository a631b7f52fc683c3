"""Wheels: the files of the tree are in the one of Python, and compiled flight code flies the same bits."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from tests.built_wheel import PACKAGES, ROOT, build_wheel, install_wheel, run_installed


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    path = build_wheel(tmp_path_factory.mktemp("wheel"))
    assert path.name.endswith("-py3-none-any.whl")
    return zipfile.ZipFile(path)


def test_wheel_has_every_file_of_the_tree(wheel: zipfile.ZipFile) -> None:
    files = (path.relative_to(ROOT) for name in PACKAGES for path in (ROOT / name).rglob("*") if path.is_file())
    expected = {
        str(path)
        for path in files
        if path.suffix != ".pyc"
        and not any(part.startswith(".") for part in path.parts)
        and (path.suffix != ".md" or "data" in path.parts)  # of data, its attribution
    }
    contained = {name for name in wheel.namelist() if ".dist-info/" not in name}
    assert contained == expected
    assert "logs/pages/templates/chapters.css" in contained  # the comparison compares something


def test_wheel_has_its_command_and_license(wheel: zipfile.ZipFile) -> None:
    (info,) = {name.split("/")[0] for name in wheel.namelist() if ".dist-info/" in name}
    assert b"wingbeat = groundstation.command.main:main" in wheel.read(f"{info}/entry_points.txt")
    assert any(name.startswith(info) and name.endswith("LICENSE") for name in wheel.namelist())


FLIGHT = """
import hashlib, sys
from avionics.autopilot import Autopilot
from avionics.missions import load_mission
from avionics.missions.script import scripted_start
from avionics.vehicles import load_vehicle as load_flight_vehicle
from sim_bridge.flight.flight import fly
from sim_bridge.flight.world import Scenario, SimulatedWorld
from sim_bridge.vehicles import load_vehicle
digest = hashlib.sha256()
publish = lambda topic, message: digest.update(repr((topic.name, message)).encode())
for seed in (1, 2, 3):
    world = SimulatedWorld(load_vehicle(sys.argv[1]), Scenario(seed=seed, vibration=1.0), publish)
    autopilot = Autopilot(load_flight_vehicle(sys.argv[1]), load_mission("circuit"), publish)
    fly(world, autopilot, scripted_start())
    text = autopilot.snapshot()
    autopilot.restore(text)
    assert autopilot.snapshot() == text
    digest.update(text.encode())
    print(seed, world.time_us, digest.hexdigest())
"""
"""all messages of whole flights, and the memory at their end"""


@pytest.mark.validate
def test_compiled_flight_code_flies_the_same_bits(tmp_path: Path) -> None:
    (tmp_path / "wheel").mkdir()
    wheel = build_wheel(tmp_path / "wheel", compiled=True)
    compiled = install_wheel(wheel, tmp_path / "compiled")
    version = ("-m", "groundstation.command.main", "--version")
    assert run_installed(compiled, *version).endswith("\nflight code: compiled\n")
    assert run_installed(ROOT, *version).endswith("\nflight code: Python\n")
    for vehicle in ("robo_raven_ii_d", "arizona_100cm"):
        flights = run_installed(compiled, "-c", FLIGHT, vehicle)
        assert flights.count("\n") == 3
        assert flights == run_installed(ROOT, "-c", FLIGHT, vehicle)
