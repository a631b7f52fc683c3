"""A six-axis load cell under a flapping vehicle: inertia, weight and mount taken off, the air's load left."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from logs.identification.models.load_cell import LoadCell, StandRun, stand_coefficients, stand_motion
from logs.identification.models.multibody import wing_air
from tests.logs.identification import slow_hawk_flight as hawk
from wingbeat.errors import InputError

Floats = NDArray[np.float64]
MOUNT = LoadCell((0.02, 0.0, 0.07), np.array([(0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)]), -1.0)
"""below the origin, its axes crossed, telling the load on the vehicle"""


def stroke(name: str, airspeed: float, air: Floats | None = None, seconds: float = 1.2) -> StandRun:
    """A run at 5 Hz and what the cell tells of it, by an air load (N, 6) on the wings."""
    time = np.arange(round(seconds / 0.002)) * 0.002
    flap = 0.14 + 0.5 * np.sin(2 * np.pi * 5.0 * time)
    run = StandRun(name, time, np.zeros((len(time), 6)), flap, airspeed, 0.06, 1.225, 5.0 * time)
    held = wing_air(hawk.vehicle(), stand_motion(hawk.vehicle(), run), 1.225).load
    on_cell = (np.zeros_like(held) if air is None else air) - held
    force, moment = on_cell[:, :3], on_cell[:, 3:]
    moment = moment - np.cross(np.array(MOUNT.place), force)
    turned = [MOUNT.sign * values @ MOUNT.r_frd_from_cell for values in (force, moment)]
    return run._replace(load=np.column_stack(turned))


def air_load(count: int) -> Floats:
    phase = 2 * np.pi * 5.0 * 0.002 * np.arange(count)
    columns = np.zeros((count, 6))
    columns[:, 0], columns[:, 2] = 1.0 + np.cos(2 * phase), -4.0 - 8.0 * np.cos(phase)
    columns[:, 4] = 0.2 * np.sin(phase)
    return columns


@pytest.mark.parametrize("tared", [False, True])
def test_the_air_s_load_is_what_is_left(tared: bool) -> None:
    air = air_load(600)
    tare = stroke("tare", 0.0) if tared else None
    found = stand_coefficients(hawk.vehicle(), stroke("run", 9.2, air), MOUNT, tare)
    inside = slice(60, -60)
    assert np.abs(found.load - air)[inside].max() < 0.05
    lift = -air[:, 2] / (0.3 * found.pressure)
    assert np.abs(found.experiment.signals["C_L"] - lift)[inside].max() < 0.005
    assert found.experiment.signals["v_x"] == pytest.approx(9.2 * np.cos(0.06))


def test_inertia_is_most_of_what_the_cell_feels() -> None:
    assert np.ptp(stroke("run", 0.0).load[:, 2]) > 5.0


def test_runs_that_cannot_be_used_are_refused() -> None:
    run = stroke("run", 9.2)
    with pytest.raises(InputError, match="no rotation"):
        stand_coefficients(hawk.vehicle(), run, MOUNT._replace(r_frd_from_cell=2 * np.eye(3)))
    with pytest.raises(InputError, match="needs 60"):
        stand_coefficients(hawk.vehicle(), stroke("short", 9.2, seconds=0.1), MOUNT)
    holed = run.load.copy()
    holed[100, 2] = np.nan
    with pytest.raises(InputError, match="not numbers"):
        stand_coefficients(hawk.vehicle(), run._replace(load=holed), MOUNT)
    with pytest.raises(InputError, match="inertia differs"):
        slow = stroke("tare", 0.0)
        stand_coefficients(hawk.vehicle(), run, MOUNT, slow._replace(time=1.2 * slow.time))
    with pytest.raises(InputError, match="not equally spaced"):
        stand_coefficients(hawk.vehicle(), run._replace(time=np.sort(np.random.default_rng(0).random(600))), MOUNT)
    still = run._replace(airspeed=0.0, flap=np.full(600, 0.1))
    with pytest.raises(InputError, match="falls to zero"):
        stand_coefficients(hawk.vehicle(), still, MOUNT)
