"""Flow angles that vanes measured off the centre of mass, as they are there: ``alpha = alpha_vane + q x / V``.

Klein & Morelli, Aircraft System Identification, 2006, sec. 10.2 (flow angles): a vane ``x`` m forward feels the air
that turning moves across it. The same of sideslip, ``beta = beta_vane - r x / V``.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.results import Array
from logs.identification.sources.table.maneuvers import Cut
from wingbeat.errors import InputError

PLACE = "vane_x"
RATES = (("alpha", "q", 1.0), ("beta", "r", -1.0))


def at_centre(found: Cut, constants: Mapping[str, float], used: Collection[str]) -> Cut:
    """The manoeuvres with the flow angles of the centre of mass, where ``constants`` tell the vanes' place.

    An angle that nothing of what is fitted uses (``used``) stays as it is where its rate was not told.

    Raises:
        InputError: the rate or the airspeed that this takes was not told.
    """
    place = constants.get(PLACE, 0.0)
    if not place:
        return found
    fitted, held = (
        tuple(_moved(one, place, constants, used) for one in part) for part in (found.fitted, found.held_out)
    )
    return found._replace(fitted=fitted, held_out=held)


def _moved(one: Experiment, place: float, constants: Mapping[str, float], used: Collection[str]) -> Experiment:
    signals = dict(one.signals)
    for angle, rate, sign in RATES:
        if angle not in signals or (rate not in signals and angle not in used):
            continue
        if rate not in signals:
            raise InputError(f"constants.{PLACE} needs signals.{rate}: {angle} of the centre of mass is made of both")
        turning: Array = np.asarray(signals[rate]) * place / _airspeed(one, constants)
        signals[angle] = np.asarray(signals[angle]) + sign * turning
    return one._replace(signals=signals)


def _airspeed(one: Experiment, constants: Mapping[str, float]) -> Array | float:
    if "V" in one.signals:
        speed: Array = np.asarray(one.signals["V"], dtype=np.float64)
        return np.asarray(np.where(speed > 0.0, speed, np.nan))
    if "V" not in constants:
        raise InputError(f"constants.{PLACE} needs constants.V or signals.V")
    return constants["V"]
