"""Help on the public entry points fits a screen: no default value prints a table."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import pytest

from avionics.autopilot import Autopilot
from avionics.view import FlightView
from groundstation.command.live import shown_live
from logs.live.server import LiveServer
from logs.replay.player import ReplayView


@pytest.mark.parametrize("function", [Autopilot, FlightView, ReplayView, LiveServer, shown_live])
def test_signature_fits_a_screen(function: Callable[..., Any]) -> None:
    assert len(str(inspect.signature(function))) < 2000
