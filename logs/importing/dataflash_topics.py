"""Wingbeat topics of a dataflash log."""

from __future__ import annotations

import numpy as np

from avionics import topics as t
from avionics.messages import CHANNELS
from logs.importing.counterparts import Columns, Counterpart, View, ground_velocity, pulse_array, true_airspeed
from wingbeat.atmosphere import GAS_CONSTANT


def _imu(view: View) -> Columns:
    columns = {f"accel_{axis}": view[f"Acc{axis.upper()}"] for axis in "xyz"}
    columns |= {f"gyro_{axis}": view[f"Gyr{axis.upper()}"] for axis in "xyz"}
    return columns | {f"mag_{axis}": view.latest_value("MAG", f"Mag{axis.upper()}") for axis in "xyz"}


def _attitude(view: View) -> Columns:
    rates = {
        f"{name}_rate": view.latest_value("IMU", f"Gyr{axis}")
        for name, axis in (("roll", "X"), ("pitch", "Y"), ("yaw", "Z"))
    }
    return {"roll": view["Roll"], "pitch": view["Pitch"], "yaw": view["Yaw"]} | rates


def _air_data(view: View) -> Columns:
    pressure, temperature = view.latest_value("BARO", "Press"), view.latest_value("BARO", "Temp")
    density = pressure / (GAS_CONSTANT * temperature)
    return {
        "airspeed": true_airspeed(view["Airspeed"], density),
        "dynamic_pressure": view.get("DiffPress"),
        "static_pressure": pressure,
        "temperature": temperature,
        "density": density,
        "pressure_altitude": view.latest_value("BARO", "Alt"),
    }


def _altitude(view: View) -> Columns:
    return {"altitude": view["Alt"], "climb_rate": view.get("CRt")}


def _filter_altitude(view: View) -> Columns:
    return {"altitude": -view["PD"], "climb_rate": -view["VD"]}


def _position(view: View) -> Columns:
    named = {"north": "PN", "east": "PE", "v_north": "VN", "v_east": "VE"}
    place = {"latitude": view.latest_value("POS", "Lat"), "longitude": view.latest_value("POS", "Lng")}
    return {field: view[column] for field, column in named.items()} | place


def _power(view: View) -> Columns:
    voltage, current = view["Volt"], view["Curr"]
    return {
        "voltage": voltage,
        "current": current,
        "power": voltage * current,
        "charge": view.get("CurrTot"),
        "energy": view.get("EnrgTot"),
        "resistance": view.get("Res"),
    }


def _gps(view: View) -> Columns:
    north, east = ground_velocity(view["Spd"], view["GCrs"])
    status = view["Status"]
    return {
        "latitude": view["Lat"],
        "longitude": view["Lng"],
        "altitude": view["Alt"],
        "v_north": north,
        "v_east": east,
        "v_down": view.get("VZ"),
        "horizontal_accuracy": view.latest_value("GPA", "HAcc"),
        "vertical_accuracy": view.latest_value("GPA", "VAcc"),
        "fix_type": np.where(status >= 2, status, 0),
        "satellites": view.get("NSats"),
    }


def _receiver(view: View) -> Columns:
    pulses = pulse_array(view, [f"C{number}" for number in range(1, CHANNELS + 1)], CHANNELS)
    return {"pulses": pulses, "rssi": np.full(len(pulses), 255)}


def _pitch_loop(view: View) -> Columns:
    return {"pitch_setpoint": view["DesPitch"]}


_NAVIGATION_FILTERS = ("XKF1", "NKF1", "EKF1")
COUNTERPARTS = (
    Counterpart(t.IMU, "IMU", _imu),
    Counterpart(t.ATTITUDE, "ATT", _attitude),
    Counterpart(t.AIR_DATA, "ARSP", _air_data),
    *(Counterpart(t.ALTITUDE, name, _filter_altitude) for name in _NAVIGATION_FILTERS),
    Counterpart(t.ALTITUDE, "BARO", _altitude),
    *(Counterpart(t.POSITION, name, _position) for name in _NAVIGATION_FILTERS),
    Counterpart(t.POWER, "BAT", _power),
    Counterpart(t.POWER, "CURR", _power),
    Counterpart(t.GPS, "GPS", _gps),
    Counterpart(t.RECEIVER, "RCIN", _receiver),
    Counterpart(t.PITCH_LOOP, "ATT", _pitch_loop, needs="DesPitch"),
)
"""In the order of preference."""
