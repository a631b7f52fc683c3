"""A running link and a stock pymavlink client on the other end of it."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from ports import free_port

os.environ["MAVLINK20"] = "1"

from link_vehicle import FakeVehicle
from pymavlink import mavutil

from avionics.link.ground import GroundLink
from avionics.link.vehicle import Identity, LinkGains

PATIENCE = 10.0
"""s; a test fails after this long without an answer"""


@contextmanager
def running(link: GroundLink, vehicle: FakeVehicle) -> Iterator[None]:
    """Poll and stream in a thread, as the flight process does between its ticks."""
    stop = threading.Event()
    failures: list[BaseException] = []

    def run() -> None:
        try:
            while not stop.wait(0.002):
                vehicle.apply(link.poll(time.monotonic()))
                link.stream(time.monotonic())
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
        link.close()
        if failures:
            raise failures[0]


@contextmanager
def stock_client(
    gains: LinkGains | None = None, identity: Identity | None = None
) -> Iterator[tuple[Any, FakeVehicle]]:
    """A vehicle on ``udpin`` and mavutil as its ground station."""
    port = free_port()
    vehicle = FakeVehicle()
    with running(GroundLink([f"udpin:127.0.0.1:{port}"], vehicle, identity, gains), vehicle):
        client = mavutil.mavlink_connection(
            f"udpout:127.0.0.1:{port}", source_system=255, source_component=190, dialect="development"
        )
        try:
            greet(client)
            yield client, vehicle
        finally:
            client.close()


def greet(client: Any) -> None:
    """Say HEARTBEAT until the vehicle does."""
    mavlink = mavutil.mavlink
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        client.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
        if client.wait_heartbeat(timeout=0.5) is not None:
            return
    raise AssertionError(f"no HEARTBEAT within {PATIENCE} s")


def expect(client: Any, kind: str | list[str], accept: Callable[[Any], bool] = lambda message: True) -> Any:
    """The next message of a kind that is accepted."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        message = client.recv_match(type=kind, blocking=True, timeout=0.5)
        if message is not None and accept(message):
            return message
    raise AssertionError(f"no {kind} within {PATIENCE} s")


def settle(client: Any) -> None:
    """Wait until the vehicle has applied all that was sent: the second answer comes after the first's tick."""
    for number in (1, 2):
        client.mav.ping_send(0, number, 0, 0)
        expect(client, "PING", lambda ping, number_expected=number: ping.seq == number_expected)
