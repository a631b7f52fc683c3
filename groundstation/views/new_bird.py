"""Report of a new vehicle: prediction, unusual properties, next commands."""

from __future__ import annotations

from pathlib import Path

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from groundstation.views import wording
from sim_bridge.flight.new_vehicle import NewVehicle
from sim_bridge.vehicles.scaling import RANGES, Remark

EFFICIENT = 0.85
"""-; efficiency of a drive above which the predicted power is too low for the model's wings"""
NAMES = {
    "wing_loading": "wing loading", "lift_coefficient": "lift coefficient", "strouhal": "Strouhal number",
    "tail_volume": "tail volume",
}  # fmt: skip
"""by code of a remark"""


def new_bird_table(vehicle: NewVehicle) -> RenderableType:
    """Return predicted cruise, short period and the checks of a new vehicle."""
    table = Table.grid(padding=(0, 3))
    table.add_column(style="dim", min_width=12)
    table.add_column()
    prediction, means = vehicle.prediction, vehicle.cruise.means
    speed, power = prediction.airspeed_error, prediction.power_error
    least, most = (vehicle.endurance / 60.0 * factor for factor in (1.0 / (1.0 + power), 1.0 + power))
    rows = [
        ("cruise", _interval(means.airspeed, speed, "m/s")),
        ("power", _interval(means.electrical_power, power, "W electrical")),
        ("endurance", f"{vehicle.endurance / 60.0:.1f} min ({least:.1f} to {most:.1f})"),
        ("short period", _short_period(vehicle)),
        ("trim", f"pitch {wording.angle(means.pitch, '+.1f')}   elevator "
         f"{wording.angle(vehicle.cruise.inputs.elevator, '+.1f')}   throttle {wording.percent(vehicle.throttle)}"),
        ("proof flight", _flight(vehicle)),
    ]  # fmt: skip
    for label, text in rows:
        table.add_row(label, text)
    for one in vehicle.remarks:
        table.add_row(NAMES[one.code], _remark(one))
    parts: list[RenderableType] = [Text(vehicle.world.title, style="bold"), table]
    if vehicle.efficiency > EFFICIENT:
        watts = means.mechanical_power
        parts.append(
            Text(f"power: the wings of the model need {watts:.3g} W: the prediction is too low", style="red")
        )
    parts += [
        Text(f"{NAMES[one.code]}: usual {RANGES[one.code][1]}", style="dim") for one in vehicle.remarks if one.unusual
    ]
    return Group(*parts)


def next_lines(folder: Path, flies: bool) -> Text:
    """Return where the files are and the next commands."""
    verdict = "" if flies else "\nit does not fly yet: more wing or tail area, or a faster stroke"
    return Text(
        f"{verdict}\nwritten {folder}/world.toml and {folder}/avionics.toml; each value has its source\n"
        f"next: wingbeat fly --vehicle {folder}      wingbeat trim {folder}      wingbeat linearize {folder}"
    )


def _interval(value: float, error: float, unit: str) -> str:
    spread = f" ({value / (1.0 + error):.3g} to {value * (1.0 + error):.3g})" if error else ""
    return f"{value:.3g} {unit}{spread}"


def _short_period(vehicle: NewVehicle) -> str:
    mode, others = vehicle.short_period[0], [one.natural_frequency for one in vehicle.short_period]
    damping = [one.damping for one in vehicle.short_period]
    return (
        f"{mode.natural_frequency:.3g} rad/s ({min(others):.3g} to {max(others):.3g}), damping {mode.damping:.2f}"
        f" ({min(damping):.2f} to {max(damping):.2f})"
    )


def _flight(vehicle: NewVehicle) -> str:
    flight = vehicle.flight
    if flight is None:
        return "did not reach its first hold"
    if not vehicle.flies:
        return "touched the ground" if flight.touched else f"{flight.completed_legs} of 2 holds"
    return (
        f"altitude {flight.altitude_rms:.2f} m RMS, heading {wording.angle(flight.heading_rms, '.1f')} RMS in gusts"
    )


def _remark(one: Remark) -> Text:
    unit = "" if RANGES[one.code][0] == "-" else f" {RANGES[one.code][0]}"
    words = f"{one.value:.3g}{unit} (usual {one.low:.3g} to {one.high:.3g})"
    return Text(f"{words}: unusual" if one.unusual else words, style="red" if one.unusual else "")
