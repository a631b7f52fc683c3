"""Wingbeat topics of a MAVLink telemetry log."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from avionics import topics as t
from avionics.messages import CHANNELS
from logs.importing.counterparts import Columns, Counterpart, View, ground_velocity, pulse_array


def _attitude(view: View) -> Columns:
    rates = {f"{name}_rate": view[f"{name}speed"] for name in ("roll", "pitch", "yaw")}
    return {name: view[name] for name in ("roll", "pitch", "yaw")} | rates


def _imu(view: View) -> Columns:
    return {
        f"{name}_{axis}": view[f"{axis}{told}"]
        for name, told in (("accel", "acc"), ("gyro", "gyro"), ("mag", "mag"))
        for axis in "xyz"
    }


def _altitude(view: View) -> Columns:
    return {"altitude": view["relative_alt"], "climb_rate": -view["vz"]}


def _local_position(view: View) -> Columns:
    place = {
        "latitude": view.latest_value("GLOBAL_POSITION_INT", "lat"),
        "longitude": view.latest_value("GLOBAL_POSITION_INT", "lon"),
    }
    return {"north": view["x"], "east": view["y"], "v_north": view["vx"], "v_east": view["vy"]} | place


def _global_position(view: View) -> Columns:
    return {"latitude": view["lat"], "longitude": view["lon"], "v_north": view["vx"], "v_east": view["vy"]}


def _power(view: View) -> Columns:
    voltage = np.where(view.raw("voltage_battery") == 65535, np.nan, view["voltage_battery"])
    current = np.where(view.raw("current_battery") < 0, np.nan, view["current_battery"])
    remaining = view.raw("battery_remaining")
    return {
        "voltage": voltage,
        "current": current,
        "power": voltage * current,
        "battery_remaining": np.where(remaining < 0, np.nan, remaining * 0.01),
    }


def _gps(view: View) -> Columns:
    unknown = (view.raw("vel") == 65535) | (view.raw("cog") == 65535)
    north, east = ground_velocity(view["vel"], view["cog"])
    satellites = view.raw("satellites_visible")
    return {
        "latitude": view["lat"],
        "longitude": view["lon"],
        "altitude": view["alt"],
        "v_north": np.where(unknown, np.nan, north),
        "v_east": np.where(unknown, np.nan, east),
        "fix_type": view["fix_type"],
        "satellites": np.where(satellites == 255, 0, satellites),
    }


def _receiver(view: View) -> Columns:
    pulses = pulse_array(view, [f"chan{number}_raw" for number in range(1, CHANNELS + 1)], CHANNELS)
    return {"pulses": pulses, "rssi": view["rssi"]}


COUNTERPARTS: Sequence[Counterpart] = (
    Counterpart(t.IMU, "HIGHRES_IMU", _imu),
    Counterpart(t.IMU, "SCALED_IMU", _imu),
    Counterpart(t.ATTITUDE, "ATTITUDE", _attitude),
    Counterpart(t.ALTITUDE, "GLOBAL_POSITION_INT", _altitude),
    Counterpart(t.POSITION, "LOCAL_POSITION_NED", _local_position),
    Counterpart(t.POSITION, "GLOBAL_POSITION_INT", _global_position),
    Counterpart(t.POWER, "SYS_STATUS", _power),
    Counterpart(t.GPS, "GPS_RAW_INT", _gps),
    Counterpart(t.RECEIVER, "RC_CHANNELS", _receiver),
)
"""In the order of preference. VFR_HUD's airspeed has none: whether it is true or indicated is unspecified."""
