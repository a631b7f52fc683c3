"""Numbers and symbols for people: digits by the error, subscripts and Greek letters, what a symbol means."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Sequence

GREEK = {"alpha": "α", "beta": "β", "delta": "δ", "theta": "θ", "tau": "τ", "omega": "ω", "zeta": "ζ", "rho": "ρ",
         "phi": "φ", "psi": "ψ", "sigma": "σ"}  # fmt: skip
AXES = {"X": "forward force per mass", "Z": "downward force per mass", "M": "nose-up pitch acceleration",
        "Y": "force to the right per mass", "L": "roll acceleration", "N": "yaw acceleration"}  # fmt: skip
FOLLOWED = {"u": "forward airspeed", "w": "downward airspeed", "q": "pitch rate", "delta": "tail angle",
            "v": "sideways airspeed", "p": "roll rate", "r": "yaw rate", "alpha": "angle of attack",
            "beta": "sideslip", "theta": "pitch", "phi": "bank"}  # fmt: skip
SUBSCRIPT = "[A-Za-z0-9δα]{1,2}|delta(?:_[A-Za-z0-9]{1,2})?|alpha|beta|theta|phi|tau0?|rudder"
LETTERS = "|".join(GREEK)
BELOW = r"(?:[A-Za-z]_)?[A-Za-z0-9δα]+|delta_[A-Za-z0-9]{1,2}"
DOT = "\u0307"
"""above the letter before it: its change with time"""
NAMED = rf"(?:[A-Za-z]|{LETTERS})_(?:[DLTm]_)?(?:{SUBSCRIPT}|alpha2|dot)"
SYMBOL = rf"\b(?:{NAMED}|{LETTERS})\b(?!\.\w)"
"""symbols in a sentence: a letter, Greek or not, with a short subscript, or a Greek letter; not a file's name"""
FACTOR = rf"\b(?:{NAMED}(?:_rate)?|{LETTERS})(?:\^\d)?\b(?!\.\w)"
"""the same, of their change with time or to a power too"""
EQUATION = re.compile(r"\w+'? = ")
"""how one begins; letters that stand alone in it are symbols"""
MEANINGS = {
    "q": "pitch rate",
    "a_x": "specific force at the IMU, forward",
    "a_z": "specific force at the IMU, down (−9.81 m/s² at rest)",
    "theta": "pitch",
    "f_x": "specific force at the centre of mass, forward",
    "f_z": "specific force at the centre of mass, down",
    "dq/dt": "pitch acceleration",
    "tail_time_constant": "first-order lag from the elevator command to the tail angle",
    "tail_delay": "pure delay of the tail beyond its lag",
    "short_period_frequency": "undamped natural frequency of the short period",
    "short_period_damping": "damping ratio of the short period",
    "short_period_period": "of the damped oscillation of the short period",
    "short_period_time_to_half": "until the short period's amplitude has halved",
    "divergence_time_to_double": "in which a motion that does not come back doubles",
    "decay_time_constant": "of the motion that decays beside it",
    "short_period_time_to_double": "until the short period's amplitude has doubled",
    "short_period_cycles_to_half": "oscillations of the short period until then",
    "short_period_cycles_to_double": "oscillations of the short period until then",
    "phugoid_period": "of the damped oscillation of the phugoid",
    "phugoid_time_to_half": "until the phugoid's amplitude has halved",
    "phugoid_time_to_double": "until the phugoid's amplitude has doubled",
    "phugoid_cycles_to_half": "oscillations of the phugoid until then",
    "phugoid_cycles_to_double": "oscillations of the phugoid until then",
    "phugoid_frequency": "undamped natural frequency of the phugoid",
    "phugoid_damping": "damping ratio of the phugoid",
    "dutch_roll_frequency": "undamped natural frequency of the Dutch roll",
    "dutch_roll_damping": "damping ratio of the Dutch roll",
    "dutch_roll_period": "of the damped oscillation of the Dutch roll",
    "dutch_roll_time_to_half": "until the Dutch roll's amplitude has halved",
    "dutch_roll_cycles_to_half": "oscillations of the Dutch roll until then",
    "dutch_roll_time_to_double": "until the Dutch roll's amplitude has doubled",
    "dutch_roll_cycles_to_double": "oscillations of the Dutch roll until then",
    "lateral_phugoid_frequency": "undamped natural frequency of the lateral phugoid: roll and spiral as one",
    "lateral_phugoid_damping": "damping ratio of the lateral phugoid",
    "lateral_phugoid_period": "of the damped oscillation of the lateral phugoid",
    "lateral_phugoid_time_to_half": "until the lateral phugoid's amplitude has halved",
    "lateral_phugoid_cycles_to_half": "oscillations of the lateral phugoid until then",
    "lateral_phugoid_time_to_double": "until the lateral phugoid's amplitude has doubled",
    "lateral_phugoid_cycles_to_double": "oscillations of the lateral phugoid until then",
    "roll_time_constant": "until the roll rate has fallen to 1/e",
    "spiral_time_to_half": "until the bank of the spiral mode has halved",
    "spiral_time_to_double": "until the bank of the spiral mode has doubled",
    "time_constant_1": "the shorter time constant of a mode that does not oscillate",
    "time_constant_2": "the longer time constant of a mode that does not oscillate",
    "K_tau": "torque of one drive per ampere of both (Gerdes Eq. 11)",
    "K_tau0": "torque at no current, extended from the line (Gerdes Eq. 11)",
    "P_0": "output power at the centre of the data",
    "C_A": "constant term of Gerdes Eq. 12",
    "C_B": "power per current", "C_C": "power per voltage", "C_F": "power per product of current and voltage",
    "C_G": "power per current squared", "C_H": "power per voltage squared",
    "wing_torque_constant": "torque of one drive per rate of its wing (Gerdes Table 5)",
    "wing_inertia": "of one wing about its hinge, as the drive feels it",
    "flapping_frequency": "at the centre of the throttle",
    "throttle_slope": "change of the flapping frequency with the throttle",
    "throttle_curvature": "change with the throttle's square",
    "voltage_slope": "change of the flapping frequency with the battery's voltage",
    "dead_zone": "throttle below which the wings stand still",
}  # fmt: skip
WORDS = re.compile(rf"\b(?:{'|'.join(name for name in MEANINGS if re.fullmatch('[a-z]{3,}_[a-z_]+', name))})\b")
"""names that are words"""
COEFFICIENT = re.compile(r"(C_[A-Za-z])_(.+)")
"""one of the wings' coefficients, and the term that it has a slope by"""


def number(value: float, step: float | None = None) -> str:
    """A number with four digits, or with those that ``step``, an error, leaves meaning."""
    if not math.isfinite(value):
        return "–"
    if step is None or not math.isfinite(step) or step <= 0.0:
        text = f"{value:.0f}" if 1e4 <= abs(value) < 1e7 else f"{value:.4g}"
    else:
        places = 1 - math.floor(math.log10(step))
        text = f"{value:.{min(places, 9)}f}" if places > 0 else f"{round(value, places):.0f}"
        if len(text.lstrip("-").replace(".", "").lstrip("0")) > 7:
            text = f"{value:.4g}"
    return "0" if not float(text) else text.replace("-", "−")


def sentence(clause: str) -> str:
    """A clause with a capital and a full stop; a symbol at its head stays as it is."""
    head = clause.split(" ", 1)[0]
    begun = clause if "_" in head or len(head) < 2 else f"{clause[:1].upper()}{clause[1:]}"
    return begun if begun.endswith(".") else f"{begun}."


def symbol(name: str) -> str:
    """A name as HTML: ``X_delta`` with its subscript, ``C_L_v_z*omega_y`` by its term, ``dead_zone`` as words."""
    head, _, rest = name.partition("_")
    if name == "short_period_period":
        return "period of the short period mode"
    if head in ("bias", "scale") and rest:
        return f"{head} of {symbol(rest)}"
    if rest == "dot":
        return f"<i>{html.escape(GREEK.get(head, head))}{DOT}</i>"
    if rest and (len(head) <= 2 or head in GREEK) and re.fullmatch(BELOW, rest):
        return f"<i>{html.escape(GREEK.get(head, head))}</i><sub>{html.escape(_below(rest))}</sub>"
    if slope := COEFFICIENT.fullmatch(name):
        return f"{symbol(slope[1])} by {symbol(slope[2])}"
    if "*" not in name and (power := re.fullmatch(r"(.+)\^(\d)", name)):
        return f"{symbol(power[1])}<sup>{power[2]}</sup>"
    if "*" not in name and name.endswith("_rate") and (stem := symbol(name.removesuffix("_rate"))).startswith("<i>"):
        return stem.replace("</i>", f"{DOT}</i>", 1)
    if "*" in name:
        return " ".join(symbol(part) for part in name.split("*"))
    if re.fullmatch(r"[A-Za-z]\w?", name) or name in GREEK:
        return f"<i>{html.escape(GREEK.get(name, name))}</i>"
    return html.escape(name.replace("_", " "))


def _below(rest: str) -> str:
    """A subscript with its Greek letter, ``tau0``, ``D_alpha`` and ``delta_a`` too."""
    if rest.startswith("delta_"):
        return GREEK["delta"] + rest.removeprefix("delta_")
    axis, _, last = rest.rpartition("_")
    letters = last.rstrip("0123456789")
    return axis + GREEK.get(letters, letters) + last[len(letters) :]


def rich(text: str) -> str:
    """A sentence or an equation as HTML, the symbols in it set as such."""
    told = WORDS.sub(lambda match: match[0].replace("_", " "), html.escape(text))
    if not EQUATION.match(text):
        return re.sub(FACTOR, lambda match: symbol(match[0]), told)
    return re.sub(
        rf"{FACTOR}|(?<!&#x27;)\b[A-Za-z]\b", lambda match: symbol(match[0]), re.sub(r"(?<![\w.])-", "−", told)
    )


def drawn_words(text: str) -> str:
    """A name as SVG text, its subscripts below the line."""
    return re.sub(SYMBOL, lambda match: _drawn_symbol(match[0]), html.escape(text))


def _drawn_symbol(name: str) -> str:
    head, _, rest = name.partition("_")
    if rest == "dot":
        return f"{GREEK.get(head, head)}{DOT}"
    low = f'<tspan dy="3" font-size="9">{_below(rest)}</tspan><tspan dy="-3">\u200b</tspan>' if rest else ""
    return GREEK.get(head, head) + low


def meaning(name: str, controls: Sequence[str] = ()) -> str:
    """What a symbol stands for; empty where nothing is known of it. ``controls`` go by their own names."""
    if name in MEANINGS:
        return MEANINGS[name]
    axis, _, follows = name.partition("_")
    own = controls[0] if follows == "delta" and len(controls) == 1 else follows
    if axis in AXES and own in controls and own not in FOLLOWED:
        return f"{AXES[axis]} by {own}"
    if axis in AXES and follows in FOLLOWED:
        return f"{AXES[axis]} by {FOLLOWED[follows]}"
    return ""


def unit(text: str) -> str:
    """A unit with its powers raised, escaped; nothing for a plain number."""
    return "" if text in ("-", "") else html.escape(text).replace("^2", "²").replace("^3", "³")
