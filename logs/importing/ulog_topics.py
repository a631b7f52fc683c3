"""Wingbeat topics of a PX4 ULog."""

from __future__ import annotations

import numpy as np

from avionics import topics as t
from avionics.messages import CHANNELS
from logs.importing.counterparts import Columns, Counterpart, View, true_airspeed
from logs.importing.source import Array
from wingbeat.rotation_arrays import euler_from_quaternions


def _axes(name: str, values: Array) -> Columns:
    return {f"{name}_{axis}": values[:, place] for place, axis in enumerate("xyz")}


def _imu(view: View) -> Columns:
    field = {
        f"mag_{axis}": view.latest_value("vehicle_magnetometer", "magnetometer_ga", place)
        for place, axis in enumerate("xyz")
    }
    return _axes("accel", view["accelerometer_m_s2"]) | _axes("gyro", view["gyro_rad"]) | field


def _attitude(view: View) -> Columns:
    columns = {f"quaternion_{axis}": view["q"][:, place] for place, axis in enumerate("wxyz")}
    for place, name in enumerate(("roll", "pitch", "yaw")):
        old = f"{name}speed"
        now = view.latest_value("vehicle_angular_velocity", "xyz", place)
        columns[f"{name}_rate"] = view[old] if old in view.here.columns else now
    for place, axis in enumerate("xyz"):
        columns[f"bias_{axis}"] = np.nan_to_num(view.latest_value("estimator_sensor_bias", "gyro_bias", place))
    return columns


def _air_data(view: View) -> Columns:
    told = "true_airspeed_m_s" if "true_airspeed_m_s" in view.here.columns else "true_airspeed"
    density = view.latest_value("vehicle_air_data", "rho")
    known = told in view.here.columns
    return {
        "airspeed": view[told] if known else true_airspeed(view["indicated_airspeed_m_s"], density),
        "dynamic_pressure": view.latest_value("differential_pressure", "differential_pressure_pa"),
        "static_pressure": view.latest_value("vehicle_air_data", "baro_pressure_pa"),
        "temperature": view.latest_value("vehicle_air_data", "baro_temp_celcius"),
        "density": density,
    }


def _altitude(view: View) -> Columns:
    return {"altitude": -view["z"], "climb_rate": -view["vz"]}


def _position(view: View) -> Columns:
    wind = "wind" if view.has("wind") else "wind_estimate"
    return {
        "north": view["x"],
        "east": view["y"],
        "v_north": view["vx"],
        "v_east": view["vy"],
        "wind_north": view.latest_value(wind, "windspeed_north"),
        "wind_east": view.latest_value(wind, "windspeed_east"),
        "latitude": np.radians(view.latest_value("vehicle_global_position", "lat")),
        "longitude": np.radians(view.latest_value("vehicle_global_position", "lon")),
    } | ({"valid": view["xy_valid"]} if "xy_valid" in view.here.columns else {})


def _power(view: View) -> Columns:
    voltage, current = view["voltage_v"], _not_below(view["current_a"], 0.0)
    return {
        "voltage": voltage,
        "current": current,
        "power": voltage * current,
        "charge": view.get("discharged_mah"),
        "battery_remaining": _not_below(view.get("remaining"), 0.0),
    }


def _not_below(values: Array, low: float) -> Array:
    """Replace values below ``low`` with NaN: PX4 marks unknown values this way."""
    return np.where(values < low, np.nan, values)


def _gps(view: View) -> Columns:
    old = "lat" in view.here.columns
    place = (view["lat"] * 1e-7, view["lon"] * 1e-7) if old else (view["latitude_deg"], view["longitude_deg"])
    degree = np.pi / 180.0 if old else 1.0  # the new names tell their unit, so that they are radians here
    return {
        "latitude": place[0] * degree,
        "longitude": place[1] * degree,
        "altitude": view["alt"] * 1e-3 if old else view["altitude_msl_m"],
        "v_north": view["vel_n_m_s"],
        "v_east": view["vel_e_m_s"],
        "v_down": view["vel_d_m_s"],
        "horizontal_accuracy": view.get("eph"),
        "vertical_accuracy": view.get("epv"),
        "fix_type": view["fix_type"],
        "satellites": view["satellites_used"],
    }


def _receiver(view: View) -> Columns:
    pulses = np.zeros((len(view.here.time_us), CHANNELS), np.int64)
    values = view["values"][:, :CHANNELS]
    pulses[:, : values.shape[1]] = values
    return {"pulses": pulses, "lost": view.get("rc_lost"), "rssi": np.full(len(pulses), 255)}


def _pitch_loop(view: View) -> Columns:
    if "pitch_body" in view.here.columns:
        return {"pitch_setpoint": view["pitch_body"]}
    return {"pitch_setpoint": euler_from_quaternions(*view["q_d"].T)[1]}


COUNTERPARTS = (
    Counterpart(t.IMU, "sensor_combined", _imu),
    Counterpart(t.ATTITUDE, "vehicle_attitude", _attitude),
    Counterpart(t.AIR_DATA, "airspeed", _air_data),
    Counterpart(t.AIR_DATA, "airspeed_validated", _air_data),
    Counterpart(t.ALTITUDE, "vehicle_local_position", _altitude),
    Counterpart(t.POSITION, "vehicle_local_position", _position),
    Counterpart(t.POWER, "battery_status", _power),
    Counterpart(t.GPS, "vehicle_gps_position", _gps),
    Counterpart(t.GPS, "sensor_gps", _gps),
    Counterpart(t.RECEIVER, "input_rc", _receiver),
    Counterpart(t.PITCH_LOOP, "vehicle_attitude_setpoint", _pitch_loop),
)
"""In the order of preference."""
