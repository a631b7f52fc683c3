"""Compilation at first use, and its progress."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext

from rich.status import Status

from groundstation.command.compiling_ahead import CompilationAhead
from groundstation.views.progress import ProgressBar
from groundstation.views.terminal import open_console
from sim_bridge.aerodynamics.models import is_compiled_separately
from sim_bridge.compiled import on_compilation
from sim_bridge.plant import Plant, physics_compiled
from sim_bridge.vehicles import SimulatedVehicle
from wingbeat.cores import available_cores

COMPILING_AIR = "compiling the aerodynamic model (once, about half a minute)"
COMPILING_METHODS = "compiling methods at first use (up to half a minute)"
_announced: set[str] = set()


def compiling_text() -> str:
    """Return the announcement of the physics' compilation."""
    return f"compiling the physics (once, about {'a quarter of' if available_cores() > 1 else 'half'} a minute)"


def load_physics(vehicle: SimulatedVehicle, quiet: bool = False) -> None:
    """Compile the physics, and aerodynamics compiled separately, if the cache lacks them.

    The progress is shown on stderr unless ``quiet``.

    Raises:
        InputError: invalid bodies of the vehicle.
    """
    if not physics_compiled():
        with CompilationAhead(vehicle) as ahead:
            compile_physics(ahead, quiet)
    else:
        with announced_air(vehicle, quiet):
            Plant(vehicle)


def compile_physics(ahead: CompilationAhead, quiet: bool) -> None:
    """Compile the physics with a progress bar; without a terminal, a line before and one after."""
    start, announcement = time.monotonic(), compiling_text()
    on_terminal = sys.stderr.isatty()
    if not quiet and not on_terminal:
        print(announcement, file=sys.stderr, flush=True)
    with ProgressBar(announcement, quiet) as bar:

        def show(done: int, total: int, names: str) -> None:
            bar.show(done, total, f"compiling the physics, once: {done} of {total} parts, {names}")

        total = ahead.compile_physics(show)
    if not quiet and not on_terminal:
        print(f"compiled {total} parts in {time.monotonic() - start:.0f} s", file=sys.stderr, flush=True)


def announced_air(vehicle: SimulatedVehicle, quiet: bool = False) -> AbstractContextManager[None]:
    """Announce like `announced`, once, if the aerodynamic model of the vehicle is compiled separately."""
    if COMPILING_AIR in _announced or not is_compiled_separately(vehicle.aerodynamics.model):
        return nullcontext()
    return announced(quiet, COMPILING_AIR)


@contextmanager
def announced(quiet: bool = False, text: str = COMPILING_METHODS, live: bool = True) -> Iterator[None]:
    """Report the compilation of kernels that are not in the cache on stderr.

    A terminal shows their number and names while they are compiled. Without a terminal, or where a progress bar is
    shown (``live`` false), a line is printed at the first one.
    """
    if quiet:
        yield
        return
    progress = _KernelProgress(text, live)
    with on_compilation(progress.start, progress.end):
        yield


class _KernelProgress:
    """Number and name of the kernel that is compiled, or a line at the first one."""

    def __init__(self, text: str, live: bool) -> None:
        self._text, self._count = text, 0
        self._console = open_console(stderr=True)
        self._live = live and self._console.is_terminal
        self._status: Status | None = None

    def start(self, kernel: str) -> None:
        self._count += 1
        _announced.add(self._text)
        if not self._live:
            if self._count == 1:
                print(self._text, file=sys.stderr, flush=True)
            return
        text = f"{self._text}: kernel {self._count}, {kernel.strip('_')}"
        if self._status is None:
            self._status = self._console.status(text)
            self._status.start()
        else:
            self._status.update(text)

    def end(self) -> None:
        if self._status is not None:
            self._status.stop()
            self._status = None
