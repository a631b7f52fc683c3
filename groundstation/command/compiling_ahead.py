"""Compilation in two processes at the same time: numba compiles one function at a time in a process.

Both put what they compile in the cache on disk, from which the other one and the processes of the flight load it.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Self

from sim_bridge.compiled import PLAIN
from sim_bridge.plant import Plant
from sim_bridge.plant_parts import PARTS, compile_part
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.cores import available_cores

WHOLE = "integrator"
"""name of what is left of the physics after `PARTS`"""
PRIORITY = 10
"""-; added to the nice value of the second process once the physics are compiled"""
PATIENCE = 180.0
"""s; without an answer for this time the second process is ended; a part takes 120 s on a slow machine"""
_START = "import sys; sys.path[:] = {path!r}; from groundstation.command import compiling_ahead as c; c.serve()"


class CompilationAhead:
    """The physics compiled by this process and a second one, which then compiles ``later`` in the background.

    A second process that fails or hangs leaves its work to this one. As a context manager it ends the second process.
    """

    def __init__(self, vehicle: SimulatedVehicle, later: Sequence[str] = ()) -> None:
        """Start the second process, if there is a core for it; ``later``: names of `LATER`."""
        self._parts, self._later = deque(PARTS), deque(later)
        self._vehicle, self._changed = vehicle, threading.Condition()
        self._finished: set[str] = set()
        self._remote: str | None = None
        self._process: subprocess.Popen[bytes] | None = None
        if not PLAIN and available_cores() > 1:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _START.format(path=sys.path)],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True,
            )  # fmt: skip

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def compile_physics(self, show: Callable[[int, int, str], None]) -> int:
        """Compile the physics; return the number of parts.

        ``show`` receives the number of finished parts and of all, and the names of those in work.

        Raises:
            InputError: invalid bodies of the vehicle.
        """
        plant = Plant(self._vehicle)
        if self._process is not None:
            threading.Thread(target=self._feed, args=(self._process,), daemon=True).start()
        total = len(PARTS) + 1
        while (name := self._take(self._parts)) is not None:
            self._show(show, total, name)
            compile_part(plant, name)
            with self._changed:
                self._finished.add(name)
        with self._changed:
            if self._remote in PARTS:
                self._show(show, total, None)
        self._wait_until(lambda: self._remote not in PARTS)
        show(len(PARTS), total, WHOLE)
        plant.compile()
        return total

    def wait(self) -> None:
        """Wait until the second process has compiled all of ``later``, or has failed or been ended."""
        self._wait_until(lambda: not self._later and self._remote is None)

    def _wait_until(self, reached: Callable[[], bool]) -> None:
        """Wait for the second process; end it, and drop its work, if it does not answer for `PATIENCE`."""
        if self._process is None:
            return
        with self._changed:
            while not reached():
                if not self._changed.wait(PATIENCE):
                    self._process.kill()
                    self._drop_its_work()

    def _drop_its_work(self) -> None:
        with self._changed:
            self._remote = None
            self._later.clear()
            self._changed.notify_all()

    def _show(self, show: Callable[[int, int, str], None], total: int, name: str | None) -> None:
        with self._changed:
            names = [one for one in (name, self._remote) if one is not None]
            show(len(self._finished), total, " and ".join(names))

    def _take(self, names: deque[str]) -> str | None:
        with self._changed:
            return names.popleft() if names else None

    def _feed(self, process: subprocess.Popen[bytes]) -> None:
        """Give the second process one name after another; it answers with a line when it is ready for one."""
        assert process.stdin is not None and process.stdout is not None
        try:
            pickle.dump(self._vehicle, process.stdin)
            process.stdin.flush()
            while process.stdout.readline():
                with self._changed:
                    if self._remote is not None:
                        self._finished.add(self._remote)
                    queue = self._parts or self._later
                    self._remote = queue.popleft() if queue else None
                    self._changed.notify_all()
                if self._remote is None:
                    break
                process.stdin.write(f"{self._remote}\n".encode())
                process.stdin.flush()
            process.stdin.close()
        except OSError:
            pass  # the second process has ended: what it has not compiled is compiled here
        finally:
            self._drop_its_work()


def serve() -> None:
    """Compile what standard input names, one name a line, after the pickled vehicle; a line is the answer."""
    vehicle = pickle.load(sys.stdin.buffer)
    plant = Plant(vehicle)
    print("ready", flush=True)
    for line in sys.stdin.buffer:
        name = line.decode().strip()
        if name in PARTS:
            compile_part(plant, name)
        else:
            LATER[name](vehicle)
        print("done", flush=True)


def _compile_sensors(vehicle: SimulatedVehicle) -> None:
    """Compile what a tick of the world needs beside the physics."""
    from sim_bridge.flight.world import Scenario, SimulatedWorld
    from sim_bridge.vibration.flight import vibration_factor

    scenario = Scenario(vibration=vibration_factor(vehicle, None))
    # Without the plant: the other process still compiles its integrator.
    SimulatedWorld(vehicle, scenario, publish=lambda topic, message: None).compile_sensors()


def _compile_identification(vehicle: SimulatedVehicle) -> None:
    """Compile what the numbers of a flight's closing text need, at a low priority: the flight has begun."""
    if hasattr(os, "nice"):
        os.nice(PRIORITY)
    import numpy as np

    from logs.identification.estimators.engine.problem import Named
    from logs.identification.models import compiled  # noqa: F401 (its kernels are compiled at the import)
    from logs.identification.models.linear import LinearModel

    names = {"x": Named("-")}, {"u": "-"}, {"y": "-"}, {"p": Named("-")}
    model = LinearModel(*names, np.zeros((2, 3)), np.zeros((1, 6)))
    model.simulate(np.zeros(1), np.zeros(1), np.zeros((2, 1)), 0.01)


LATER: dict[str, Callable[[SimulatedVehicle], Any]] = {
    "sensors": _compile_sensors,
    "identification": _compile_identification,
}
"""what the second process compiles after the physics, by name"""
