"""A flight computer at rest with a parameter file, on a UDP port, for a ground station in the tests."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from pathlib import Path

from ports import free_port

from avionics.board.parameter_file import ParameterFile
from avionics.link.ground import Files, GroundLink
from avionics.link.signing import Signing
from avionics.link.vehicle import Identity
from avionics.messages import ActuatorCommand, AdcBurst, EncoderSample, GpsFix, ImuSample, PressureSample, SensorFrame
from avionics.recorder import NullRecorder
from avionics.runtime.flight_computer import FlightComputer
from avionics.vehicles import load_vehicle

RAVEN = load_vehicle("robo_raven_ii_d")
TICK_US = 5000
HERE = (0.8395, 0.2025, 520.0)
"""rad, rad, m; where the receiver sees it: latitude, longitude, above the sea"""


class Bench:
    """A board at rest: 7.8 V where 8.0 V are measured, wings 12 and 20 counts off; a GPS fix ``outdoors``."""

    def __init__(self, outdoors: bool = False) -> None:
        self._outdoors = outdoors
        self.over = threading.Event()
        self._tick = 0

    def read(self) -> SensorFrame | None:
        # A pause in which the ground's thread runs, shorter than a tick.
        if self.over.wait(0.0005):
            return None
        self._tick += 1
        now = TICK_US * self._tick
        # Its last digit trembles: an IMU that repeats itself is refused as frozen.
        imu = ImuSample(now, 0.001 * (self._tick % 2), 0.0, -9.80665, 0.0, 0.0, 0.0, 0.2142, 0.0, 0.4585)
        burst = AdcBurst(now, (819,) * 60, (512,) * 60)
        indoors = SensorFrame(now, imu, EncoderSample(now, 12, 20), adc=burst)
        return self._placed(indoors) if self._outdoors else indoors

    def _placed(self, frame: SensorFrame) -> SensorFrame:
        now = frame.time_us
        air = PressureSample(now, 9_500_000 + self._tick % 3, 8192, 28_815)
        fix = GpsFix(now, *HERE, 0.0, 0.0, 0.0, 1.0, 1.5, 3, 12) if self._tick % 40 == 0 else None
        return frame._replace(pressures=air if self._tick % 5 == 0 else None, gps=fix)

    def write(self, command: ActuatorCommand) -> None:
        pass

    def close(self) -> None:
        pass


@contextlib.contextmanager
def aboard(
    path: Path, signing: Signing | None = None, calls: bool = False, outdoors_as: Identity | None = None
) -> Iterator[str]:
    """A flight computer with a parameter file, which waits or ``calls``; yields the address for a ground station.

    Outdoors it says that it is ``outdoors_as``.
    """
    its, ours = ("udpout", "udpin") if calls else ("udpin", "udpout")
    port = free_port()
    file = ParameterFile(path, RAVEN)
    onboard = FlightComputer(file.load().vehicle, (), NullRecorder())
    onboard.keep_parameters(file)
    link = GroundLink([f"{its}:127.0.0.1:{port}"], onboard.view, outdoors_as, files=Files(file, signing))
    board = Bench(outdoors_as is not None)
    thread = threading.Thread(target=onboard.fly, args=(board, link))
    thread.start()
    try:
        yield f"{ours}:127.0.0.1:{port}"
    finally:
        board.over.set()
        thread.join()
        link.close()
