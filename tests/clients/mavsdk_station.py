"""MAVSDK as a ground station: every answer is waited for, none for longer than `PATIENCE`."""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Any, TypeVar

import pytest
from simulated_vehicle import PATIENCE, PlanItem

_MISSING = "MAVSDK 4 is not installed: pip install -e '.[clients]'"
sdk = pytest.importorskip("mavsdk.asyncio", reason=_MISSING)
action = pytest.importorskip("mavsdk.asyncio.plugins.action", reason=_MISSING)
mission = pytest.importorskip("mavsdk.asyncio.plugins.mission_raw", reason=_MISSING)
param = pytest.importorskip("mavsdk.asyncio.plugins.param", reason=_MISSING)
telemetry = pytest.importorskip("mavsdk.asyncio.plugins.telemetry", reason=_MISSING)

T = TypeVar("T")


class Station:
    """The parts of MAVSDK that a flight takes."""

    def __init__(self, system: Any, started: float) -> None:
        """``started`` is the monotonic time (s) before it connected."""
        self.system = system
        self.started = started
        self.action = action.ActionAsync(system)
        self.mission = mission.MissionRawAsync(system)
        self.parameters = param.ParamAsync(system)
        self.telemetry = telemetry.TelemetryAsync(system)


@asynccontextmanager
async def station(url: str) -> AsyncIterator[Station]:
    """Connected to the autopilot on the other end of ``url``."""
    configuration = sdk.Configuration.create_with_component_type(sdk.ComponentType.GROUND_STATION)
    async with sdk.Mavsdk(configuration) as mavsdk:
        started = time.monotonic()
        await mavsdk.add_any_connection(url)
        system = await mavsdk.first_autopilot(timeout_s=PATIENCE)
        assert system is not None, f"no autopilot on {url} within {PATIENCE} s"
        yield Station(system, started)


async def first(stream: AsyncIterator[T], accept: Callable[[T], bool] = lambda value: True) -> T:
    """The first value of a subscription that is accepted."""
    seen: list[T] = []

    async def search() -> T:
        async for value in stream:
            seen.append(value)
            if accept(value):
                return value
        raise AssertionError("the subscription ended")

    try:
        return await asyncio.wait_for(search(), PATIENCE)
    except TimeoutError:
        raise AssertionError(f"none of {len(seen)} values was the one; last {seen[-1:]}") from None


def to_wire(items: list[PlanItem], mission_type: int) -> list[Any]:
    """A part of a plan as MAVSDK takes it."""
    return [
        mission.MissionItem(seq, i.frame, i.command, int(seq == 0), 1, *i.params, i.x, i.y, i.z, mission_type)
        for seq, i in enumerate(items)
    ]


def from_wire(items: list[Any]) -> list[PlanItem]:
    """A part of a plan as MAVSDK gives it."""
    return [PlanItem(i.frame, i.command, (i.param1, i.param2, i.param3, i.param4), i.x, i.y, i.z) for i in items]
