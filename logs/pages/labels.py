"""Numbers, units and symbols as text and HTML, and the meaning of each symbol."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Sequence

GREEK = {"alpha": "α", "beta": "β", "delta": "δ", "theta": "θ", "tau": "τ", "omega": "ω", "zeta": "ζ", "rho": "ρ",
         "phi": "φ", "psi": "ψ", "sigma": "σ"}  # fmt: skip
AXES = {"X": "forward force per mass", "Z": "downward force per mass", "M": "nose-up pitch acceleration",
        "Y": "force to the right per mass", "L": "roll acceleration", "N": "yaw acceleration"}  # fmt: skip
VARIABLES = {"u": "forward airspeed", "w": "downward airspeed", "q": "pitch rate", "delta": "tail angle",
             "v": "sideways airspeed", "p": "roll rate", "r": "yaw rate", "alpha": "angle of attack",
             "beta": "sideslip", "theta": "pitch", "phi": "bank"}  # fmt: skip
REGRESSORS = {"v_x": ("m/s", "forward airspeed"), "v_z": ("m/s", "heave speed (down positive)"),
              "u": ("m/s", "forward airspeed less its mean"), "omega_y": ("rad/s", "pitch rate"),
              "theta_11": ("rad", "stroke angle (down positive)"),
              "theta_11_rate": ("rad/s", "stroke rate")}  # fmt: skip
"""regressors of the wing coefficients (Grauer et al. 2011, Eq. 17 to 19): SI unit and meaning"""
SUBSCRIPT = "[A-Za-z0-9δα]{1,2}|delta(?:_[A-Za-z0-9]{1,2})?|alpha|beta|theta|phi|tau0?|rudder"
LETTERS = "|".join(GREEK)
BELOW = r"(?:[A-Za-z]_)?[A-Za-z0-9δα]+|delta_[A-Za-z0-9]{1,2}"
DOT = "\u0307"
"""combining dot above: time derivative"""
NAMED = rf"(?:[A-Za-z]|{LETTERS})_(?:[DLTm]_)?(?:{SUBSCRIPT}|alpha2|dot)"
FACTOR = rf"\b(?:{NAMED}(?:_rate)?|{LETTERS})(?:\^\d)?\b(?!\.\w)"
"""symbols in a sentence, not file names: a letter with a short subscript, or a Greek letter, with rate or power"""
EQUATION = re.compile(r"\w+'? = ")
"""start of an equation, in which single letters are symbols too"""
MODES = {"short_period": ("sp", "short period"), "phugoid": ("ph", "phugoid"), "dutch_roll": ("dr", "Dutch roll"),
         "lateral_phugoid": ("lp", "lateral phugoid (coupled roll and spiral)")}  # fmt: skip
MODE_NUMBERS = {
    "frequency": ("ω", "", "undamped natural frequency"), "damping": ("ζ", "", "damping ratio"),
    "period": ("T", "", "damped period"), "time_to_half": ("T", "½ ", "time to half amplitude"),
    "time_to_double": ("T", "2 ", "time to double amplitude"),
    "cycles_to_half": ("N", "½ ", "cycles to half amplitude"),
    "cycles_to_double": ("N", "2 ", "cycles to double amplitude"),
}  # fmt: skip
MEANINGS = {
    "q": "pitch rate",
    "a_x": "specific force at the IMU, forward",
    "a_z": "specific force at the IMU, down",
    "theta": "pitch",
    "f_x": "specific force at the center of mass, forward",
    "f_z": "specific force at the center of mass, down",
    "dq/dt": "pitch acceleration", "q_dot": "pitch acceleration",
    "tail_time_constant": "first-order lag of the tail servo",
    "tail_delay": "dead time of the tail servo",
    "divergence_time_to_double": "time to double of the divergence",
    "decay_time_constant": "time constant of the real mode beside the divergence",
    "roll_time_constant": "time constant of the roll mode",
    "spiral_time_to_half": "time to half bank of the spiral mode",
    "spiral_time_to_double": "time to double bank of the spiral mode",
    "time_constant_1": "shorter time constant of an overdamped mode",
    "time_constant_2": "longer time constant of an overdamped mode",
    "K_tau": "torque per current (Gerdes Eq. 11)",
    "K_tau0": "torque at zero current (Gerdes Eq. 11)",
    "P_0": "output power at the center of the data",
    "C_A": "constant term of Gerdes Eq. 12",
    "C_B": "power per current", "C_C": "power per voltage", "C_F": "power per product of current and voltage",
    "C_G": "power per current squared", "C_H": "power per voltage squared",
    "wing_torque_constant": "drive torque per wing rate (Gerdes Table 5)",
    "wing_inertia": "inertia of one wing about its hinge",
    "flapping_frequency": "flapping frequency at the center of the throttle",
    "throttle_slope": "flapping frequency per throttle",
    "throttle_curvature": "flapping frequency per throttle squared",
    "voltage_slope": "flapping frequency per battery voltage",
    "dead_zone": "throttle below which the wings do not move",
    "C_L": "lift coefficient", "C_T": "thrust coefficient", "C_m": "pitching-moment coefficient",
    "C_D": "drag coefficient",
} | {f"{mode}_{key}": f"{text}, {title}" for mode, (_, title) in MODES.items()
     for key, (_, _, text) in MODE_NUMBERS.items()}  # fmt: skip
SYMBOLS = {
    f"{mode}_{key}": f"<i>{letter}</i><sub>{before}{below}</sub>"
    for mode, (below, _) in MODES.items()
    for key, (letter, before, _) in MODE_NUMBERS.items()
} | {"tail_time_constant": "<i>τ</i><sub>tail</sub>", "wing_torque_constant": "<i>k</i><sub>w</sub>",
     "wing_inertia": "<i>J</i><sub>w</sub>", "flapping_frequency": "<i>f</i>",
     "roll_time_constant": "<i>τ</i><sub>R</sub>"}  # fmt: skip
"""textbook symbols of names that are words"""
WORDS = re.compile(rf"\b(?:{'|'.join(name for name in MEANINGS if re.fullmatch('[a-z]{3,}_[a-z_]+', name))})\b")
"""names that are words in a sentence"""
PROCESS_NOISE = "process_noise_"
COEFFICIENT = re.compile(r"(C_[A-Za-z])_(.+)")
"""aerodynamic coefficient and the term of its slope"""


def number(value: float, step: float | None = None) -> str:
    """Format with four digits, or with the digits that are significant for a standard error ``step``."""
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


def capitalized(clause: str) -> str:
    """Start a clause with a capital, unless it starts with a symbol."""
    head = clause.split(" ", 1)[0]
    return clause if "_" in head or len(head) < 2 else f"{clause[:1].upper()}{clause[1:]}"


def sentence(clause: str) -> str:
    """Start a clause with a capital, unless it starts with a symbol, and end it with a period."""
    start = capitalized(clause)
    return start if start.endswith(".") else f"{start}."


def symbol(name: str) -> str:
    """Name as HTML: ``X_delta`` with its subscript, ``C_L_v_z*omega_y`` with its term, ``dead_zone`` as words."""
    head, _, rest = name.partition("_")
    if name in SYMBOLS:
        return SYMBOLS[name]
    if head in ("bias", "scale") and rest:
        return f"{head} of {symbol(rest)}"
    if name.startswith(PROCESS_NOISE):
        return f"<i>σ</i><sub>{html.escape(_below(name.removeprefix(PROCESS_NOISE)))}</sub>"
    if rest == "dot":
        return f"<i>{html.escape(GREEK.get(head, head))}{DOT}</i>"
    if rest and (len(head) <= 2 or head in GREEK) and re.fullmatch(BELOW, rest):
        return f"<i>{html.escape(GREEK.get(head, head))}</i><sub>{html.escape(_below(rest))}</sub>"
    if slope := COEFFICIENT.fullmatch(name):
        return symbol(slope[1]).replace("</sub>", f", {symbol(slope[2])}</sub>")
    if "*" not in name and (power := re.fullmatch(r"(.+)\^(\d)", name)):
        return f"{symbol(power[1])}<sup>{power[2]}</sup>"
    if "*" not in name and name.endswith("_rate") and (stem := symbol(name.removesuffix("_rate"))).startswith("<i>"):
        return stem.replace("</i>", f"{DOT}</i>", 1)
    if "*" in name:
        return " ".join(symbol(part) for part in name.split("*"))
    if re.fullmatch(r"[A-Za-z]\w?", name) or name in GREEK:
        return f"<i>{html.escape(GREEK.get(name, name))}</i>"
    return html.escape(name.replace("_", " "))


def text_symbol(name: str) -> str:
    """Name of a slope on a terminal: ``C_L_v_z*theta_11_rate`` is C_L v_z θ̇₁₁; any other unchanged."""
    slope = COEFFICIENT.fullmatch(name)
    if slope is None or not set(re.split(r"\*|\^\d", slope[2])) <= {*REGRESSORS, ""}:
        return name
    term = slope[2].replace("theta_11_rate", f"θ{DOT}₁₁").replace("theta_11", "θ₁₁").replace("omega", "ω")
    return f"{slope[1]} {term.replace('*', ' ').replace('^2', '²')}"


def _below(rest: str) -> str:
    """Subscript with its Greek letter, also of ``tau0``, ``D_alpha`` and ``delta_a``."""
    if rest.startswith("delta_"):
        return GREEK["delta"] + rest.removeprefix("delta_")
    axis, _, last = rest.rpartition("_")
    letters = last.rstrip("0123456789")
    return axis + GREEK.get(letters, letters) + last[len(letters) :]


def rich(text: str) -> str:
    """Sentence or equation as HTML with its symbols in italics and subscripts."""
    escaped = WORDS.sub(lambda match: match[0].replace("_", " "), html.escape(text))
    if not EQUATION.match(text):
        return re.sub(FACTOR, lambda match: symbol(match[0]), escaped)
    return re.sub(
        rf"{FACTOR}|(?<!&#x27;)\b[A-Za-z]\b", lambda match: symbol(match[0]), re.sub(r"(?<![\w.])-", "−", escaped)
    )


def spaced(name: str) -> str:
    """Name for a sentence: words are separated by spaces, symbols such as ``C_H`` unchanged."""
    head, _, rest = name.partition("_")
    if head in ("bias", "scale") and rest:
        return f"{head} of {rest}"
    if name.startswith(PROCESS_NOISE):
        return f"process noise of {name.removeprefix(PROCESS_NOISE)}"
    return name if len(head) <= 2 or head in GREEK else name.replace("_", " ")


def plain(text: str) -> str:
    """Text without markup, Greek letters as such, for the legend of a plot."""
    return re.sub(rf"\b(?:{LETTERS})\b", lambda match: GREEK[match[0]], text)


def meaning(name: str, controls: Sequence[str] = ()) -> str:
    """Meaning of a parameter; empty if unknown. ``controls`` are names of inputs that replace the tail angle."""
    if name in MEANINGS:
        return MEANINGS[name]
    if name.startswith(PROCESS_NOISE):
        return spaced(name)
    axis, _, variable = name.partition("_")
    control = controls[0] if variable == "delta" and len(controls) == 1 else variable
    if axis in AXES and control in controls and control not in VARIABLES:
        return f"{AXES[axis]} by {control}"
    if axis in AXES and variable in VARIABLES:
        return f"{AXES[axis]} by {VARIABLES[variable]}"
    if (slope := COEFFICIENT.fullmatch(name)) and slope[1] in MEANINGS:
        factors = [part.removesuffix("^2") for part in slope[2].split("*")]
        term = " times ".join(REGRESSORS[one][1] for one in factors if one in REGRESSORS)
        term += " squared" if slope[2].endswith("^2") else ""
        by = " at zero" if slope[2] == "0" else f" by {term}" if factors[0] in REGRESSORS else ""
        return MEANINGS[slope[1]] + by
    return ""


def unit(text: str) -> str:
    """Unit with superscript powers, escaped; empty for a dimensionless number."""
    if text in ("-", ""):
        return ""
    root = re.sub(r"\((.*)\)/s\^0\.5", r"\1/√s", text)
    return html.escape(root).replace("^2", "²").replace("^3", "³")
