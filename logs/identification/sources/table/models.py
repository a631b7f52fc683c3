"""The models that a map can ask for, made for its inputs, outputs and constants."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from logs.identification.data.experiment import Experiment
from logs.identification.estimators.engine.problem import Fit, Model
from logs.identification.findings import Finding
from logs.identification.models.actuators import Actuated, Actuator
from logs.identification.models.compiled import CompiledModel
from logs.identification.models.lateral import AXES, MEASURED, LateralAirframe, nonlinear_lateral
from logs.identification.models.linear import LinearModel
from logs.identification.models.nonlinear_longitudinal import Airframe, nonlinear_longitudinal
from logs.identification.models.stability import Steady, lateral, longitudinal, short_period
from logs.identification.models.user import is_user_model, load_user_model
from logs.identification.results import Array
from logs.identification.sources.table.config import DELAY, ModelFile, OutputError, Parameter
from logs.identification.sources.table.quantities import need
from wingbeat.errors import InputError
from wingbeat.schema import check_known

FIRST_SAMPLES = 3
LONGEST_DELAY = 1.0
"""s; either way"""
OF_SPEED = ("a_x", "a_y", "a_z", "n_y", "n_z", "u")
"""outputs that a linear model needs the airspeed for"""
FORCE_OUTPUTS = {"alpha", "a_z", "n_z"}
"""outputs of a short period without which gravity's change with theta is left out: it alone would separate Z_alpha,
Z_delta and M_q by the pitch motion, and is no larger than the change of the airspeed, which is left out too"""
TRIM = ("V", "alpha", "theta")
"""constants of the steady flight that signals give too"""
DROPPED = ("Z_q", "X_q", "Y_p", "Y_r")
"""derivatives that are rarely identifiable: zero unless a map names them"""
WITHOUT_SPEED = ("X_delta", "M_u")
"""derivatives of the longitudinal model that are zero unless the speed is measured or a map names them"""
AERODYNAMIC = ("C_D_0", "C_D_alpha", "C_L_0", "C_L_alpha", "C_m_0", "C_m_alpha", "C_m_q", "C_m_delta")
"""coefficients that are free if a map names none"""


class Built(NamedTuple):
    """A model with its equations and the parameters that are free if a map names none."""

    model: Model
    equations: tuple[str, ...]
    default: tuple[str, ...]
    aliases: Mapping[str, str]
    """-; the model's inputs by the name in the map"""
    constant_inputs: Mapping[str, float] = {}
    """SI; inputs without a signal, by the model's name"""
    starts: Mapping[str, float] = {}
    """as the parameters; of a user's model, if its file gives them"""
    findings: tuple[Finding, ...] = ()


class Chosen(NamedTuple):
    """A model as a map requests it."""

    model: Model
    equations: tuple[str, ...]
    parameters: Mapping[str, Parameter]
    """free and fixed parameters by name"""
    linear: bool
    """-; about a trim: inputs count from their first value, every output has a bias"""
    aliases: Mapping[str, str]
    """-; the model's inputs by the name in the map"""
    constant_inputs: Mapping[str, float]
    """SI; inputs without a signal, by the model's name"""
    operating_point: tuple[Array, Array] | None = None
    """(n,), (k,); mean states and inputs, about which a nonlinear model is linearized"""
    findings: tuple[Finding, ...] = ()

    @property
    def fixed(self) -> dict[str, float]:
        """SI; the parameters that the map fixes."""
        return {name: one.fixed for name, one in self.parameters.items() if one.fixed is not None}

    @property
    def unnamed(self) -> dict[str, float]:
        """SI; parameters in the equations that are neither free nor fixed by the map, by name."""
        rest = {name: one.value for name, one in self.model.parameters.items() if name not in self.parameters}
        # The constants of linear models belong to the biases and are in no equation.
        return {name: value for name, value in rest.items() if not (self.linear and name.endswith("_0"))}

    def about(self, experiment: Experiment) -> Experiment:
        """The maneuver with its inputs under the model's names.

        Raises:
            InputError: an input is not among the signals.
        """
        signals = dict(experiment.signals)
        for name, key in self.aliases.items():
            if name not in signals:
                raise InputError(f"input {name!r} is not in [signals]; there are: {', '.join(experiment.signals)}")
            signals[key] = signals[name]
        for name, value in self.constant_inputs.items():
            signals[name] = np.full(len(experiment.time), value)
        return experiment._replace(signals=signals)

    def from_trim(self, experiment: Experiment) -> Experiment:
        """The maneuver with the inputs of a linear model counted from their first value."""
        if not self.linear:
            return experiment
        signals = dict(experiment.signals)
        for name in self.model.inputs:
            signals[name] = signals[name] - float(np.mean(signals[name][:FIRST_SAMPLES]))
        return experiment._replace(signals=signals)

    def input_biases(self, outputs: tuple[str, ...]) -> tuple[str, ...]:
        """Inputs with a free bias: an attitude among the outputs integrates a steady rate."""
        free = self.linear and ("theta" in outputs or "phi" in outputs)
        return tuple(self.model.inputs) if free else ()

    def system_of(self, fit: Fit) -> Callable[[Array], Array]:
        """Matrix A (n, n) of a linear model as a function of the free parameters (p,), without integrated angles.

        Raises:
            InputError: the model has no modes.
        """
        inner = self.model.model if isinstance(self.model, Actuated) else self.model
        base = {name: one.value for name, one in inner.parameters.items()} | self.fixed

        def parameters(values: Array) -> Array:
            merged = base | dict(zip(fit.names, values.tolist(), strict=True))
            return np.array([merged[name] for name in inner.parameters])

        if isinstance(inner, CompiledModel) and self.operating_point is not None:
            model, point = inner, self.operating_point
            return lambda values: model.state_matrix(parameters(values), *point)
        if not isinstance(inner, LinearModel):
            raise InputError("a nonlinear model has no modes of its key")
        linear = inner

        def system(values: Array) -> Array:
            whole = linear.matrices(parameters(values)).a
            states = [n for n in range(len(whole)) if np.any(whole[:, n]) or len(whole) == 1]
            return np.asarray(whole[np.ix_(states, states)])

        return system


def chosen_model(section: OutputError, constants: Mapping[str, float], experiments: tuple[Experiment, ...]) -> Chosen:
    """The model with what is free in it.

    Raises:
        InputError: an output or parameter that it does not have, or a constant that it needs.
    """
    build, linear = (_user, False) if is_user_model(section.model) else MODELS[section.model]
    built = build(section, with_trim(constants, experiments), experiments)
    late = () if section.delay.fixed == 0.0 else (Actuator(tuple(built.model.inputs), DELAY),)
    zoh = _zoh_inputs(section, built)
    model = Actuated(built.model, late, zoh) if late or zoh else built.model
    for name in section.outputs:
        if name not in model.outputs:
            raise InputError(f"{section.model} has no output {name!r}; it has: {', '.join(model.outputs)}")
        unit = experiments[0].units.get(name, model.outputs[name])
        if unit != model.outputs[name]:
            raise InputError(f"signals.{name} is in {unit}, the model's {name} in {model.outputs[name]}")
    parameters = _parameters(section, built)
    if section.delay.fixed != 0.0:
        if section.delay.fixed is not None and not abs(section.delay.fixed) <= LONGEST_DELAY:
            raise InputError(
                f"delay = {section.delay.fixed:g} s: an input acts at most {LONGEST_DELAY:g} s late or early"
            )
        parameters[DELAY] = section.delay
    if all(one.fixed is not None for one in parameters.values()):
        raise InputError(f"{section.model}: every parameter is fixed, there is nothing to find")
    return Chosen(
        model, built.equations, parameters, linear, built.aliases, built.constant_inputs,
        None if linear else _operating_point(built, experiments), built.findings,
    )  # fmt: skip


def _operating_point(built: Built, experiments: tuple[Experiment, ...]) -> tuple[Array, Array] | None:
    """Mean states and inputs; a state that is not measured has its value in the model."""
    if not isinstance(built.model, CompiledModel):
        return None
    signals = {key: name for name, key in built.aliases.items()}
    means = {name: _mean(signals.get(name, name), experiments) for name in (*built.model.states, *built.model.inputs)}
    states = [one.value if (mean := means[name]) is None else mean for name, one in built.model.states.items()]
    constant = built.constant_inputs
    inputs = [constant.get(name, 0.0) if (mean := means[name]) is None else mean for name in built.model.inputs]
    return np.array(states), np.array(inputs)


def _zoh_inputs(section: OutputError, built: Built) -> tuple[str, ...]:
    """The model's names of the inputs that are constant between samples.

    Raises:
        InputError: ``zoh_inputs`` names another signal.
    """
    for name in section.zoh_inputs:
        check_known(name, section.inputs, f"zoh_inputs {name}")
    return tuple(built.aliases.get(name, name) for name in section.zoh_inputs)


def _parameters(section: OutputError, built: Built) -> dict[str, Parameter]:
    """The map's, by the model's names: with one input ``Z_delta_e`` is ``Z_delta``."""
    if not section.parameters:
        return {name: Parameter(start=built.starts.get(name)) for name in built.default}
    found = {}
    for name, one in section.parameters.items():
        key = name
        for given in built.aliases:
            if name not in built.model.parameters and name.endswith(f"_{given}"):
                key = f"{name.removesuffix(given)}delta"
        check_known(key, built.model.parameters, f"parameters.{name}")
        found[key] = one
    return found


def with_trim(constants: Mapping[str, float], experiments: tuple[Experiment, ...]) -> dict[str, float]:
    """The constants; airspeed, angle of attack and pitch of the trim are means of the signals if not given."""
    return {name: mean for name in TRIM if (mean := _mean(name, experiments)) is not None} | dict(constants)


def _mean(name: str, experiments: tuple[Experiment, ...]) -> float | None:
    series = [np.asarray(one.signals[name]) for one in experiments if name in one.signals]
    measured = np.concatenate([one[np.isfinite(one)] for one in series]) if series else np.zeros(0)
    return float(measured.mean()) if len(measured) else None


def _steady(section: OutputError, constants: Mapping[str, float]) -> Steady:
    needs_speed = section.model != "short period" or any(name in OF_SPEED for name in section.outputs)
    if needs_speed and "V" not in constants:
        raise InputError(f"{section.model} with {', '.join(section.outputs)} needs constants.V or signals.V")
    return Steady(
        constants.get("V", 1.0),
        constants.get("theta", 0.0) if "V" in constants else 0.0,
        constants.get("alpha", 0.0),
        constants.get("imu_x", 0.0),
        constants.get("imu_z", 0.0),
    )


def _linear(model: LinearModel, section: OutputError) -> Built:
    names = [name for name in model.parameters if not name.endswith("_0") and name not in DROPPED]
    slopes = model.slopes.reshape(len(model.parameters), *model.constant.shape)
    columns, states = (*model.states, *model.inputs, "1"), tuple(model.states)
    rows = {f"{name}'": row for row, name in enumerate(states)}
    rows |= {name: len(states) + row for row, name in enumerate(model.outputs) if name in section.outputs}
    equations = []
    for left, row in rows.items():
        if left in states:  # measured directly
            continue
        terms = [(float(model.constant[row, c]), of) for c, of in enumerate(columns)]
        terms += [
            (float(slopes[p, row, c]), name if of == "1" else f"{name} {of}")
            for p, name in enumerate(model.parameters)
            for c, of in enumerate(columns)
            if not name.endswith("_0")
        ]
        equations.append(f"{left} = {_sum([one for one in terms if one[0]])}")
    return Built(model, tuple(equations), tuple(names), {name: name for name in section.inputs})


def _sum(terms: list[tuple[float, str]]) -> str:
    """Text of a sum of factors and terms: ``q - 0.5 Z_alpha alpha``."""
    text = ""
    for value, of in terms:
        size = f"{abs(value):.6g}"
        term = size if of == "1" else of if size == "1" else f"{size} {of}"
        sign = ("-" if value < 0 else "") if not text else " - " if value < 0 else " + "
        text += sign + term
    return text or "0"


def _short_period(section: OutputError, constants: Mapping[str, float], _: tuple[Experiment, ...]) -> Built:
    steady, pitch = _steady(section, constants), "theta" in section.outputs
    if not FORCE_OUTPUTS & set(section.outputs):
        steady = steady._replace(pitch=0.0)
    return _linear(short_period(steady, section.inputs, pitch=pitch), section)


def _longitudinal(section: OutputError, constants: Mapping[str, float], _: tuple[Experiment, ...]) -> Built:
    built = _linear(longitudinal(_steady(section, constants), section.inputs), section)
    unknown = () if {"u", "a_x"} & set(section.outputs) else WITHOUT_SPEED
    return built._replace(default=tuple(name for name in built.default if name not in unknown))


def _lateral(section: OutputError, constants: Mapping[str, float], _: tuple[Experiment, ...]) -> Built:
    inputs = section.inputs
    left_out = {*inputs, *(("phi",) if "beta" in inputs and "phi" not in section.outputs else ())}
    states = tuple(name for name in ("beta", "p", "r", "phi") if name not in left_out)
    return _linear(lateral(_steady(section, constants), inputs, states), section)


def _nonlinear(section: OutputError, constants: Mapping[str, float], experiments: tuple[Experiment, ...]) -> Built:
    controls = tuple(name for name in section.inputs if name != "thrust")
    if len(controls) != 1:
        raise InputError(f"nonlinear longitudinal takes one control in inputs (and thrust), not {len(controls)}")
    known = dict(constants)
    need(known, "mass", "I_y", "S", "c", "V", what="nonlinear longitudinal")
    density, of_density = _density(known, experiments, "nonlinear longitudinal")
    aliases, constant = {controls[0]: "delta_e"}, {}
    if "thrust" in experiments[0].signals:
        aliases["thrust"] = "thrust"
    elif "thrust" in known:
        constant["thrust"] = known["thrust"]
    else:
        raise InputError("nonlinear longitudinal needs signals.thrust or constants.thrust (0 for a glide)")
    aliases |= of_density
    angle = known.get("thrust_angle", 0.0)
    arm = known.get("thrust_z", 0.0) * np.cos(angle) + known.get("thrust_x", 0.0) * np.sin(angle)
    airframe = Airframe(
        known["mass"], known["I_y"], known["S"], known["c"], known["V"], density, angle, float(arm),
        known.get("imu_x", 0.0), known.get("imu_z", 0.0),
    )  # fmt: skip
    return Built(nonlinear_longitudinal(airframe), NONLINEAR, AERODYNAMIC, aliases, constant)


def _density(
    known: Mapping[str, float], experiments: tuple[Experiment, ...], model: str
) -> tuple[float | str, dict[str, str]]:
    """Air density or the name of its input, and the input by the name of its signal.

    Raises:
        InputError: neither density nor dynamic pressure is known.
    """
    for signal, name in (("qbar", "dynamic_pressure"), ("rho", "density")):
        if signal in experiments[0].signals:
            return name, {signal: name}
    if "rho" not in known:
        raise InputError(f"{model} needs constants.rho, constants.altitude, signals.rho or signals.qbar")
    return known["rho"], {}


def _nonlinear_lateral(
    section: OutputError, constants: Mapping[str, float], experiments: tuple[Experiment, ...]
) -> Built:
    controls = tuple(name for name in section.inputs if name not in MEASURED)
    if not controls:
        raise InputError("nonlinear lateral takes at least one control in inputs")
    known, signals = dict(constants), experiments[0].signals
    need(known, "mass", "I_x", "I_z", "S", "b", "V", what="nonlinear lateral")
    if "q" in signals:
        need(known, "I_y", what="nonlinear lateral with signals.q")
    aliases, fixed = {name: name for name in controls}, {}
    for name in MEASURED:
        if name in signals:
            aliases[name] = name
        else:
            fixed[name] = known.get(name, 0.0)
    density, of_density = _density(known, experiments, "nonlinear lateral")
    aliases |= of_density
    airframe = LateralAirframe(
        known["mass"], known["I_x"], known["I_z"], known["S"], known["b"], known.get("I_xz", 0.0),
        known.get("I_y", 0.0), density, known.get("imu_x", 0.0), known.get("imu_z", 0.0),
    )  # fmt: skip
    free = ("0", "beta", "p", "r", *controls)
    default = tuple(f"C_{axis}_{name}" for axis in AXES for name in free if (axis, name) not in LATERAL_DROPPED)
    return Built(nonlinear_lateral(airframe, controls), NONLINEAR_LATERAL, default, aliases, fixed)


LATERAL_DROPPED = (("Y", "p"), ("Y", "r"))
"""coefficients that are seldom significant: zero unless a map names them"""
NONLINEAR_LATERAL = (
    "beta' = (qbar S C_Y/m + g cos(theta) sin(phi))/(V cos(beta)) + p sin(alpha) - r cos(alpha) - V'/V tan(beta)",
    "I_x p' - I_xz r' = qbar S b C_l + I_xz p q + (I_y - I_z) q r",
    "I_z r' - I_xz p' = qbar S b C_n + (I_x - I_y) p q - I_xz q r",
    "phi' = p + tan(theta) (q sin(phi) + r cos(phi))",
    "C = C_0 + C_beta beta + C_beta3 beta^3 + C_p p b/(2V) + C_r r b/(2V) + C_delta delta, for Y, l and n",
)


def _user(section: OutputError, constants: Mapping[str, float], experiments: tuple[Experiment, ...]) -> Built:
    path = section.model.path if isinstance(section.model, ModelFile) else Path(section.model)
    user = load_user_model(path, constants)
    for name, unit in user.model.inputs.items():
        known = experiments[0].units.get(name, unit)
        if known != unit:
            raise InputError(f"signals.{name} is in {known}, the input {name} of {section.model} in {unit}")
    aliases = {name: name for name in user.model.inputs}
    return Built(user.model, user.equations, tuple(user.model.parameters), aliases, {}, user.starts, user.findings)


NONLINEAR = (
    "V' = -qbar S C_D/m + T cos(alpha + sigma)/m + g sin(alpha - theta)",
    "alpha' = q - (qbar S C_L + T sin(alpha + sigma))/(m V) + g cos(alpha - theta)/V",
    "theta' = q",
    "q' = (qbar S c C_m + T l)/I_y",
    "C = C_0 + C_V V/V0 + C_alpha alpha + C_alpha2 alpha^2 + C_q q c/(2 V0) + C_delta delta, for D, L and m;"
    " C_D + C_D_k C_L^2",
)
Build = Callable[[OutputError, Mapping[str, float], tuple[Experiment, ...]], Built]
MODELS: dict[str, tuple[Build, bool]] = {
    "short period": (_short_period, True),
    "longitudinal": (_longitudinal, True),
    "lateral": (_lateral, True),
    "nonlinear longitudinal": (_nonlinear, False),
    "nonlinear lateral": (_nonlinear_lateral, False),
}
"""by name: its builder, and whether it is linear about a trim"""
