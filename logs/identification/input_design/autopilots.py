"""Files that fly a designed elevator input: a Lua script for ArduPlane, and a MAVLink script for PX4.

ArduPlane's own system identification (SID parameters, ArduPlane/systemid.cpp) is for the hover modes of a quadplane.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path

from avionics.guidance.mission import Excitation
from logs.identification.input_design.prediction import waveform
from logs.importing.excitation import FULL_DEFLECTION

FORMATS = ("wingbeat", "ardupilot", "px4")
STEP = 0.02
"""s; of the scripts"""
SWITCH = 300
"""RCx_OPTION of the switch that starts the script: Scripting1"""
PER_LINE = 10

LUA = """\
-- Elevator input for identification, written by wingbeat design.
-- {summary}
-- Copy to APM/scripts with SCR_ENABLE 1 and RCx_OPTION {switch}. The switch starts the input, and stops it when low.
-- The elevator is that of the start plus the input: the pitch loop does not act. The script sends the channel and the
-- factor of the pulse width, FACTOR, as it starts. Identify the log with
--   wingbeat identify LOG.bin modes --elevator /dataflash/RCOU.CHANNEL FACTOR
local ELEVATOR, SWITCH, STEP_MS, REPEATS = 19, {switch}, {step}, {repeats}
local TRAVEL = {travel:.4g}
local VALUES = {{
{values}
}}

local channel = SRV_Channels:find_channel(ELEVATOR)
local index, repeats, base, done = 0, 0, 0, false

local function parameter(name)
  return param:get(string.format("SERVO%d_%s", channel + 1, name)) or 0
end

local function stop(text)
  gcs:send_text(6, "input: " .. text)
  index, repeats = 0, 0
end

local function update()
  local wanted = rc:find_channel_for_option(SWITCH)
  local high = wanted and wanted:get_aux_switch_pos() == 2
  if not channel or not high or not arming:is_armed() then
    if index > 0 or repeats > 0 then stop("stopped") end
    done = false
    return update, 100
  end
  if done then return update, 100 end
  local half = (parameter("MAX") - parameter("MIN")) / 2
  local sign = 1
  if parameter("REVERSED") == 1 then sign = -1 end
  if index == 0 then
    base = SRV_Channels:get_output_pwm(ELEVATOR) or 1500
    if repeats == 0 then
      gcs:send_text(6, string.format("input: started, RCOU.C%d %.4g rad/us", channel + 1, sign * TRAVEL / half))
    end
  end
  index = index + 1
  local pulse = math.floor(base + sign * half * VALUES[index] / TRAVEL + 0.5)
  SRV_Channels:set_output_pwm_chan_timeout(channel, pulse, 3 * STEP_MS)
  logger:write("EXCI", "pitch", "f", VALUES[index] / {full:.4g})
  if index >= #VALUES then
    index, repeats = 0, repeats + 1
    if repeats >= REPEATS then
      stop("done")
      done = true
    end
    return update, {pause}
  end
  return update, STEP_MS
end

return update, 1000
"""

MAVLINK = '''\
"""Elevator input for identification on PX4, written by wingbeat design.

{summary}

Fly level and trimmed in MANUAL with COM_RC_IN_MODE 1 (joystick), then run:  python3 {name} udpin:0.0.0.0:14550 0.6
The second argument is the throttle, from 0 to 1. The pitch stick moves the elevator directly; any other mode, chosen
on the ground station, stops the input. Afterwards the stick stays in the middle until then. Log with SDLOG_PROFILE 1,
and identify with:
    wingbeat identify LOG.ulg modes --elevator "/ulg/vehicle_torque_setpoint.xyz[1]" {travel:.4g}
"""

import itertools
import sys
import time

from pymavlink import mavutil

STEP, REPEATS, PAUSE = {step}, {repeats}, {pause}
TRAVEL = {travel:.4g}  # rad; elevator at full stick
VALUES = [  # rad; positive pitches the nose up
{values}
]


def send(link, pitch, throttle):
    """Send the sticks: a positive x pitches the nose down."""
    stick = max(-1000, min(1000, round(-1000.0 * pitch / TRAVEL)))
    link.mav.manual_control_send(link.target_system, stick, 0, round(1000.0 * throttle), 0, 0)


def main():
    """Fly the input."""
    link = mavutil.mavlink_connection(sys.argv[1])
    throttle = float(sys.argv[2])
    first = link.wait_heartbeat()
    sender = first.get_srcSystem(), first.get_srcComponent()
    due = time.monotonic()
    for value in itertools.chain([*VALUES, *[0.0] * round(PAUSE / STEP)] * REPEATS, itertools.repeat(0.0)):
        send(link, value, throttle)
        beat = link.recv_match(type="HEARTBEAT", blocking=False)
        if beat is not None and (beat.get_srcSystem(), beat.get_srcComponent()) == sender:
            if beat.custom_mode != first.custom_mode:
                sys.exit("the mode has changed: stopped")
        due += STEP
        time.sleep(max(due - time.monotonic(), 0.0))


if __name__ == "__main__":
    main()
'''


def autopilot_file(kind: str, excitation: Excitation, travel: float, fade: float, pause: float, path: Path) -> str:
    """Return the text of the file ``path`` for an autopilot, ``ardupilot`` or ``px4``.

    Args:
        kind: of `FORMATS`.
        excitation: with all repeats.
        travel: rad; elevator at full deflection of its servo or stick.
        fade: s; of the ends of a sweep.
        pause: s; between repeats.
        path: of the file; named in its instructions.
    """
    values = _values(excitation, fade)
    common = {
        "summary": summary(excitation), "values": values, "repeats": excitation.repeats, "travel": travel,
    }  # fmt: skip
    if kind == "ardupilot":
        return LUA.format(
            **common,
            switch=SWITCH,
            step=round(1000 * STEP),
            pause=round(1000 * pause),
            full=FULL_DEFLECTION,
        )
    return MAVLINK.format(**common, step=STEP, pause=pause, name=path.name)


def suffix(kind: str) -> str:
    """Return the usual suffix of a file."""
    return {"ardupilot": ".lua", "px4": ".py", "wingbeat": ".toml"}[kind]


def summary(excitation: Excitation) -> str:
    """Return shape, amplitude and repeats in one line."""
    degrees, name = math.degrees(excitation.amplitude), excitation.shape.name.lower().replace("_", " ")
    return f"{excitation.repeats} x {name}, {degrees:.3g} deg, width {excitation.width:.3g} s"


def _values(excitation: Excitation, fade: float) -> str:
    """Return the input with its settling times in rad every `STEP` s, in lines."""
    samples = waveform(excitation._replace(repeats=1), STEP, fade, 0.0).command.tolist()
    texts = [f"{value:.5g}" for value in samples]
    return "\n".join("  " + ", ".join(row) + "," for row in _rows(texts))


def _rows(texts: list[str]) -> Iterable[list[str]]:
    return (texts[first : first + PER_LINE] for first in range(0, len(texts), PER_LINE))
