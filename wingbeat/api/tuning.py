"""Gains from a linear model, and new vehicles from a few numbers."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from sim_bridge.flight.new_vehicle import NewVehicle, design_vehicle, write_vehicle
from sim_bridge.flight.tuning.cascade import Design, Loop, design
from sim_bridge.flight.tuning.proof import SCENARIO, Proof, fly_quality
from sim_bridge.flight.tuning.vehicle_file import places, write
from sim_bridge.tuning.model import LinearModel, is_model_file, load_model
from sim_bridge.vehicles.scaling import NewBird, checked_bird
from wingbeat.api.steady import LinearMotion, linearize
from wingbeat.api.vehicles import Vehicle, load_vehicle
from wingbeat.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Tuning", "new_bird", "tune"]


class Tuning(NamedTuple):
    """Designed gains of every loop, their margins, and the same flight with the gains before and after."""

    vehicle: Vehicle
    design: Design
    proof: Proof | None
    """flights in light gusts; None if not requested"""

    @property
    def gains(self) -> dict[str, float]:
        """Designed gains by section.key."""
        return self.design.values

    def to_pandas(self) -> pd.DataFrame:
        """Return two rows per loop: margins (dB, deg), crossover and bandwidth (rad/s) before and after."""
        import pandas as pd

        rows = [
            {"loop": loop.name, "gains": when, **_figures(loop)}
            for pair in zip(self.design.before, self.design.after, strict=True)
            for when, loop in zip(("before", "after"), pair, strict=True)
        ]
        return pd.DataFrame(rows).set_index(["loop", "gains"])

    def write(self, folder: Path | str) -> Path:
        """Write ``world.toml`` and ``avionics.toml`` with these gains to a new folder.

        Raises:
            InputError: one of the files exists.
        """
        folder = Path(folder)
        write(places(folder), self.vehicle.computer, self.design, self.vehicle.world.text)
        return folder

    def __repr__(self) -> str:
        loops = ", ".join(
            f"{loop.name} {loop.margins.gain_db:.1f} dB {math.degrees(loop.margins.phase):.0f} deg"
            for loop in self.design.after
        )
        flown = "" if self.proof is None else f"; flies {self.proof.comparison.value}"
        return f"Tuning of {self.vehicle.name}: {loops}{flown}"


def _figures(loop: Loop) -> dict[str, float | bool]:
    margins = loop.margins
    return {
        "gain_margin": margins.gain_db, "phase_margin": math.degrees(margins.phase),
        "crossover": margins.crossover, "bandwidth": loop.bandwidth, "stable": margins.stable,
    }  # fmt: skip


def tune(
    subject: str | Path | Vehicle | LinearMotion,
    *,
    vehicle: str | Path | Vehicle | None = None,
    airspeed: float | None = None,
    fly: bool = True,
    seed: int = SCENARIO.seed,
) -> Tuning:
    """Design the gains of every loop, as ``wingbeat tune``: at least 6 dB and 45 degrees.

    Args:
        subject: vehicle, its name or folder, a model file of ``identify --model``, or a linear motion.
        vehicle: vehicle of the gains, for a model that does not name it.
        airspeed: m/s, of the trim of a vehicle (default: cruise).
        fly: whether to fly with the gains before and after.
        seed: of the flights.

    Raises:
        InputError: unknown vehicle, no trim, an invalid model, or no gains within the margins.
    """
    model, chosen = _model(subject, vehicle, airspeed)
    designs = design(model, chosen.computer)
    proof = None
    if fly:
        scenario = SCENARIO._replace(seed=seed)
        flights = (fly_quality(chosen.world, chosen.computer, one, scenario)
                   for one in (chosen.computer.gains, designs.gains))  # fmt: skip
        proof = Proof(*flights)
    return Tuning(chosen, designs, proof)


def _model(
    subject: str | Path | Vehicle | LinearMotion, vehicle: str | Path | Vehicle | None, airspeed: float | None
) -> tuple[LinearModel, Vehicle]:
    """Return the linear model and the vehicle of the gains.

    Raises:
        InputError: see `tune`.
    """
    named = vehicle
    if isinstance(subject, LinearMotion):
        model = subject.model
    elif isinstance(subject, str | Path) and is_model_file(Path(subject)):
        model = load_model(Path(subject))
    else:
        chosen = subject if isinstance(subject, Vehicle) else load_vehicle(subject)
        return linearize(chosen, airspeed).model, chosen
    named = named or model.vehicle
    if not named:
        raise InputError("the model names no vehicle: specify vehicle")
    return model, named if isinstance(named, Vehicle) else load_vehicle(named)


def new_bird(
    folder: Path | str,
    *,
    mass: float,
    span: float,
    area: float,
    stroke_deg: float,
    rate: float,
    tail_area: float,
    tail_arm: float,
    cells: int,
    capacity: float,
    airspeed: float | None = None,
) -> NewVehicle:
    """Make the folder of a new ornithopter from eight numbers, as ``wingbeat new-bird``.

    Args:
        folder: new folder; its last part is the name of the vehicle.
        mass: kg, all-up.
        span: m, from tip to tip.
        area: m^2, both wings.
        stroke_deg: from the lowest to the highest wing position.
        rate: Hz, of flapping in cruise.
        tail_area: m^2, horizontal.
        tail_arm: m, from the center of mass.
        cells: lithium-polymer cells in series.
        capacity: A h.
        airspeed: m/s (default: predicted from the Strouhal number of published flights).

    Raises:
        InputError: the folder has these files, or the numbers are of no vehicle that can be trimmed and tuned.
    """
    folder = Path(folder)
    places(folder)
    given = NewBird(mass, span, area, math.radians(stroke_deg) / 2.0, rate, tail_area, tail_arm, cells, capacity)
    bird = checked_bird(given)
    vehicle = design_vehicle(bird, folder.resolve().name, airspeed)
    write_vehicle(vehicle, folder)
    return vehicle
