"""Study of failures: single faults and pairs on both vehicles, and a jammed tail in every phase; the page it writes.

From `tests/sitl`: ``python fault_study.py PAGE`` flies all of it (some minutes on two cores) and writes the page.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from itertools import combinations, pairwise
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np
from simulate import ARIZONA, RAVEN, Flight, Underway

from avionics import topics
from avionics.guidance.mission import ItemKind, MissionItem
from sim_bridge.bridge.world import SimulationSilent
from sim_bridge.flight.faults import FAULTS, Fault
from sim_bridge.flight.world import LAUNCH_TIME, Scenario

VEHICLES = (RAVEN, ARIZONA)
TITLES = {RAVEN: "Robo Raven II D", ARIZONA: "Arizona 100 cm"}
THERE_AND_BACK = (
    MissionItem(ItemKind.TAKEOFF, altitude=20.0),
    MissionItem(ItemKind.WAYPOINT, north=120.0, east=0.0, altitude=25.0),
    MissionItem(ItemKind.WAYPOINT, north=80.0, east=60.0, altitude=25.0),
    MissionItem(ItemKind.RETURN),
)
WORST = ("wing_left_jammed", "imu_frozen", "tail_jammed", "imu_saturated", "battery_critical", "baro_lost")
"""one fault for each of the first six rows of `avionics.guidance.failsafes.FAILURES`, the order of their answers"""
FAILS_AT = 24.0
"""s; of faults and pairs, in level flight"""
FLOWN = 180.0
"""s; after the fault at most"""
JAMS = tuple(float(time) for time in range(14, 22))
"""s; of a jammed tail if thrown at `LAUNCH_TIME`: climb-out, level-off and level flight"""
GUSTY = (1, 2)
"""seeds of the flights in gusts"""
SINK, BANK = 2.0, 30.0
"""m/s and deg; a touchdown beyond them is hard"""
LONGEST_WAIT = 320.0
"""s; for a throw in gusts"""


LIMITS = (
    "The Robo Raven rolls by its two wing drives: it stays upright with 22 deg of rudder. One motor drives both"
    " wings of the Arizona. Once its rudder is jammed nothing rolls it, and a rudder more than about 2 deg from that"
    " of straight flight holds it in a turn of 35 to 60 deg of bank. Its unequal wings need 4.2 deg of rudder in"
    " still air, which the roll loop moves by 1.4 deg RMS (equal wings: 0.0 and 0.3 deg), in gusts by up to 26 deg. A"
    " descent without thrust was tried: the Arizona then swings to 70 to 110 deg of bank."
)
"""what limits a landing with a jammed tail"""


class Case(NamedTuple):
    """One flight."""

    vehicle: str
    faults: tuple[str, ...]
    at: float = FAILS_AT
    """s; since boot if the throw is at `LAUNCH_TIME`"""
    gusts: bool = False
    """3 m/s of wind from 57 deg and small_uav_light gusts"""
    seed: int = 1
    vibration: float = 1.0
    """-; factor of the vehicle's, with its unequal wings; 0: equal wings"""


class Result(NamedTuple):
    """What became of it."""

    case: Case
    outcome: str
    """landed, hard landing, in the air, simulator stopped"""
    sink: float
    """m/s; at touchdown, NaN in the air"""
    bank: float
    """deg; at touchdown, NaN in the air"""
    worst_bank: float
    """deg; greatest from the fault on"""
    after: float
    """s; from the fault to the touchdown or the end"""
    reported: str
    """failsafe actions and their times after the fault"""


def cases() -> tuple[tuple[Case, ...], tuple[Case, ...], tuple[Case, ...]]:
    """Every fault on the Arizona, pairs of the worst on both, a jammed tail in every phase."""
    single = tuple(Case(ARIZONA, (name,)) for name, kind in FAULTS.items() if not kind.needs)
    pairs = tuple(Case(vehicle, pair) for vehicle in VEHICLES for pair in combinations(WORST, 2))
    still = tuple(Case(vehicle, ("tail_jammed",), at) for vehicle in VEHICLES for at in JAMS)
    equal = tuple(Case(ARIZONA, ("tail_jammed",), at, vibration=0.0) for at in JAMS)
    windy = tuple(
        Case(vehicle, ("tail_jammed",), at, True, seed) for vehicle in VEHICLES for seed in GUSTY for at in JAMS
    )
    return single, pairs, still + equal + windy


def fly(case: Case) -> Result:
    """Fly one case to its touchdown, or `FLOWN` s after the fault."""
    gusts = (3.0, math.radians(57.0), "small_uav_light") if case.gusts else (0.0, 0.0, "none")
    scenario = Scenario(case.seed, *gusts, duration=LONGEST_WAIT + case.at + FLOWN, vibration=case.vibration)
    flight = Underway(case.vehicle, scenario, THERE_AND_BACK)
    while not flight.world.launched:
        flight.until(flight.world.time_us * 1e-6 + 0.1)
    at = max(case.at - LAUNCH_TIME, 0.1) + flight.world.time_us * 1e-6
    flight.until(at - 0.1)
    for name in case.faults:
        flight = flight.branch(Fault(name, at))
    try:
        flight.until(at + FLOWN)
    except SimulationSilent:
        return Result(case, "simulator stopped", math.nan, math.nan, math.nan, 0.0, "no sensor frame")
    return judge(case, at, flight.flight())


def judge(case: Case, at: float, flight: Flight) -> Result:
    """Outcome of a flight whose fault came at ``at`` s."""
    time, (_, end) = flight.truth["time_us"] * 1e-6, flight.air_time()
    bank = np.degrees(np.abs(flight.true_attitude()[0]))
    inside = (time >= at) & (time <= end)
    landed = end < time[-1]
    last = int(np.flatnonzero(time == end)[0])
    sink, touching = (float(flight.truth["v_down"][last]), float(bank[last])) if landed else (math.nan, math.nan)
    soft = sink < SINK and touching < BANK
    said = [(event.time_us * 1e-6 - at, event.text) for event in flight.of(topics.EVENTS)]
    acted = [
        f"{text.removeprefix('failsafe: ')} ({after:.1f} s)"
        for after, text in said
        if after > -0.1 and text.startswith("failsafe: ")
    ]
    outcome = ("landed" if soft else "hard landing") if landed else "in the air"
    return Result(case, outcome, sink, touching, float(bank[inside].max()), end - at, "; ".join(acted[:4]) or "none")


def results(chosen: Iterable[Case]) -> Iterator[Result]:
    """Of every case, flown on all cores; a row is printed as each ends."""
    with get_context("spawn").Pool(os.cpu_count(), maxtasksperchild=20) as pool:
        for result in pool.imap(fly, chosen):
            case = result.case
            air = f"gusts {case.seed}" if case.gusts else "still"
            sys.stdout.write(f"{case.vehicle} {air} {case.at:.0f} s {row(result)}\n")
            sys.stdout.flush()
            yield result


def row(result: Result) -> str:
    """Line of the tables of faults and pairs."""
    landed = not math.isnan(result.sink)
    touch = f"{result.sink:.1f} m/s, {result.bank:.0f} deg, {result.after:.0f} s" if landed else "-"
    worst = "-" if math.isnan(result.worst_bank) else f"{result.worst_bank:.0f} deg"
    names = " + ".join(f"`{name}`" for name in result.case.faults)
    return f"| {names} | {result.reported} | {worst} | {result.outcome} | {touch} |"


HEAD = (
    "| fault | reported (after the fault) | greatest bank | outcome | touchdown: sink, bank, after |\n"
    "| --- | --- | --- | --- | --- |"
)


def soft(flights: Iterable[Result]) -> int:
    """How many landed with a sink under 2 m/s and a bank under 30 deg."""
    return sum(result.outcome == "landed" for result in flights)


def phase_rows(flights: Iterable[Result]) -> list[str]:
    """A line for each vehicle, air, seed and vibration, with a cell for each time of the jam."""
    by: dict[tuple[str, bool, int, float], list[Result]] = {}
    for result in flights:
        case = result.case
        by.setdefault((case.vehicle, case.gusts, case.seed, case.vibration), []).append(result)
    rows = []
    for (vehicle, gusts, seed, vibration), group in by.items():
        cells = [
            "soft"
            if one.outcome == "landed"
            else f"{one.sink:.1f} m/s, {one.bank:.0f} deg"
            if one.sink == one.sink
            else "in the air"
            for one in sorted(group, key=lambda one: one.case.at)
        ]
        air = f"3 m/s, light gusts, seed {seed}" if gusts else "still" if vibration else "still, equal wings"
        rows.append(f"| {TITLES[vehicle]} | {air} | {' | '.join(cells)} |")
    return rows


def page(single: list[Result], pairs: list[Result], jams: list[Result], day: str) -> str:
    """The page of the documentation."""
    head = " | ".join(f"{time:.0f} s" for time in JAMS)
    still = [one for one in jams if not one.case.gusts and one.case.vibration]
    equal = [one for one in jams if not one.case.vibration]
    windy = [one for one in jams if one.case.gusts]
    both = [
        f"### {TITLES[vehicle]}\n\n{HEAD}\n" + "\n".join(row(one) for one in pairs if one.case.vehicle == vehicle)
        for vehicle in VEHICLES
    ]
    return "\n\n".join(
        [
            "# Validation: failures in flight",
            f"Flown on {day} by `tests/sitl/fault_study.py` (part of `make validate`), which writes this page."
            f" A landing is soft if the sink is under {SINK:.0f} m/s and the bank under {BANK:.0f} deg; each flight"
            f" ends {FLOWN:.0f} s after the fault at the latest.",
            "## Every fault on the Arizona 100 cm",
            "Still air; take-off to 20 m, two waypoints at 25 m, return and landing. The fault comes"
            f" {FAILS_AT - LAUNCH_TIME:.0f} s after the throw, level, before the first waypoint."
            f" {soft(single)} of {len(single)} landed softly; the others are in the table.",
            HEAD + "\n" + "\n".join(row(one) for one in single),
            "## Pairs of the six worst faults",
            f"Both at once, {FAILS_AT - LAUNCH_TIME:.0f} s after the throw. The six are those that the failsafes"
            " answer first. " + ", ".join(
                f"{TITLES[vehicle]}: {soft(one for one in pairs if one.case.vehicle == vehicle)} of 15 softly"
                for vehicle in VEHICLES
            ) + ".",
            *both,
            "## A jammed tail in climb-out, level-off and level flight",
            "The columns are the times of the jam since boot for a throw"
            f" at {LAUNCH_TIME:.0f} s; a cell is sink and bank of a landing that was not soft. Still air:"
            f" {soft(still)} of {len(still)} soft, and with equal wings, without vibration, {soft(equal)} of"
            f" {len(equal)} of the Arizona. 3 m/s of wind with `small_uav_light` gusts: " + ", ".join(
                f"{TITLES[one]} {soft(each for each in windy if each.case.vehicle == one)} of {len(windy) // 2}"
                for one in VEHICLES
            ) + ".",
            LIMITS,
            f"| vehicle | air | {head} |\n| --- | --- |{' --- |' * len(JAMS)}\n" + "\n".join(phase_rows(jams)),
        ]
    ) + "\n"  # fmt: skip


def study() -> tuple[list[Result], list[Result], list[Result]]:
    """Fly everything."""
    groups = cases()
    simulate = list(results(case for group in groups for case in group))
    ends = np.cumsum([0, *(len(group) for group in groups)])
    single, pairs, jams = (simulate[a:b] for a, b in pairwise(ends))
    return single, pairs, jams


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(page(*study(), f"{datetime.now(UTC):%Y-%m-%d}"), encoding="utf-8")
