"""The map of a table: TOML with the columns, the maneuvers, and the sections that say what to fit."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from logs.identification.estimators.registry import methods
from logs.identification.models.user import is_user_model, user_inputs
from logs.identification.sources.table.bench import PowerSection, ServoSection, TorqueSpeedSection, TwistSection
from logs.identification.sources.table.columns import Layout
from logs.identification.sources.table.maneuvers import Maneuvers
from logs.identification.sources.table.path import PathSection
from logs.identification.sources.table.prepare import PrepareSection
from logs.identification.sources.table.quantities import ConstantsSection
from logs.identification.sources.table.signals import SignalEntry, TimeSection
from logs.identification.sources.table.stand import StandSection
from logs.identification.sources.table.stroke import StrokeSection
from wingbeat.errors import InputError
from wingbeat.schema import check_known, read_document, read_number, read_record, read_value

ALIASES = (
    ("", "manoeuvres", "maneuvers"),
    ("", "stand", "load_cell"),
    ("maneuvers", "validate_share", "validation_fraction"),
    ("prepare.delay.*", "like", "reference"),
    ("modes", "hold", "zoh_inputs"),
    ("modes", "band", "frequency_band"),
    ("aero.regressions", "always", "forced_terms"),
    ("aero.regressions", "band", "frequency_band"),
    ("aero.output_error", "hold", "zoh_inputs"),
)
"""section, former key, key"""
LEAST_SQUARES = "least squares"
DELAY = "delay"
"""key, and name of the parameter: the time by which all inputs act later than they were recorded"""
MODES_MODELS = ("short period", "longitudinal", "none")
"""none: the methods that need no model"""
AERO_MODELS = ("short period", "longitudinal", "lateral", "nonlinear longitudinal", "nonlinear lateral")


class ModelFile(str):
    """A user's model as the map names it, relative to the map's folder."""

    __slots__ = ("path",)
    path: Path

    def __new__(cls, name: str, folder: Path) -> ModelFile:
        """Of the file ``name`` in ``folder``."""
        file = super().__new__(cls, name)
        file.path = folder / name
        return file


class Parameter(NamedTuple):
    """A model's parameter: free or fixed."""

    fixed: float | None = None
    """as the parameter; None if it is free"""
    start: float | None = None
    """as the parameter; start value of the search; by equation error if not given"""
    low: float = -math.inf
    """as the parameter; lower bound"""
    high: float = math.inf
    """as the parameter; upper bound"""

    @classmethod
    def from_entry(cls, entry: Any, key: str) -> Parameter:
        """Of a map's entry: a number fixes it; ``{}``, ``"free"`` and ``{ start, low, high }`` leave it free.

        Raises:
            InputError: it is none of these.
        """
        if entry == "free":
            return cls()
        if not isinstance(entry, dict):
            return cls(fixed=read_number(entry, key))
        for name in entry:
            check_known(name, ("fixed", "start", "low", "high"), f"{key}.{name}")
        values = {name: read_number(value, f"{key}.{name}") for name, value in entry.items()}
        if "fixed" in values and len(values) > 1:
            raise InputError(f"{key} is either fixed, or has a start and bounds")
        one = cls(**values)
        if not one.low < one.high or not one.low <= (one.low if one.start is None else one.start) <= one.high:
            raise InputError(f"{key}: low must be below high, and start between them")
        return one


class ExperimentSection(NamedTuple):
    """Section [experiment]."""

    kind: Annotated[str, "dynamic", "steady"] | None = None
    """steady: rows are independent steady readings in any order, without time; if not given, rows without a time
    column whose signals are not correlated from row to row"""


class ModesSection(NamedTuple):
    """Section [modes]."""

    outputs: tuple[str, ...]
    inputs: tuple[str, ...] = ()
    model: str | None = None
    """one of `MODES_MODELS`, or a user's file; "none": only methods without a model; if not given by `states` and the
    outputs"""
    states: Annotated[int, 2, 4] | None = None
    """-; 2: angle of attack and pitch rate; 4: speed and pitch too; if not given 4 if u or a_x is an output or if the
    likelihood ratio requires it, else 2"""
    method: str | None = None
    """row of the registry; all that apply if not given"""
    kinds: Annotated[tuple[str, ...], "short_period", "phugoid"] | None = None
    """modes in the records; by the outputs if not given"""
    parameters: dict[str, Parameter] = {}
    delay: Parameter = Parameter(fixed=0.0)
    """s; of the inputs"""
    zoh_inputs: tuple[str, ...] = ()
    """inputs that are constant between samples (zero-order hold); the others are linear between samples"""
    biases: tuple[str, ...] | None = None
    """outputs with a bias in every maneuver; all if not given"""
    frequency_band: tuple[float, float] | None = None
    """Hz; of equation error in the frequency domain, by the motion if not given"""


class Regression(NamedTuple):
    """One of [[aero.regressions]]."""

    response: str
    regressors: tuple[str, ...]
    selection: Annotated[str, "all", "stepwise"] = "all"
    """stepwise: the same as that method"""
    method: str = "least squares"
    """row of the registry; least squares is equation error in the ``domain``"""
    domain: Annotated[str, "time", "frequency"] = "time"
    forced_terms: tuple[str, ...] = ()
    """regressors that stepwise regression retains in any case"""
    frequency_band: tuple[float, float] | None = None
    """Hz; of the frequency domain"""


class OutputError(NamedTuple):
    """Section [aero.output_error]."""

    model: str
    """one of `AERO_MODELS`, or a user's file"""
    outputs: tuple[str, ...]
    inputs: tuple[str, ...] = ()
    parameters: dict[str, Parameter] = {}
    delay: Parameter = Parameter(fixed=0.0)
    zoh_inputs: tuple[str, ...] = ()
    """as of [modes]"""
    biases: tuple[str, ...] | None = None
    """as of [modes]; none of a nonlinear model if not given"""
    search: Annotated[str, "gauss-newton", "nelder-mead", "both"] = "gauss-newton"
    """both: Gauss-Newton from the end of the simplex"""
    method: str = "output_error"
    """row of the registry"""


class AeroSection(NamedTuple):
    """Section [aero]."""

    regressions: tuple[Regression, ...] = ()
    output_error: tuple[OutputError, ...] = ()


class Map(NamedTuple):
    """A complete map."""

    signals: dict[str, SignalEntry]
    time: TimeSection = TimeSection()
    experiment: ExperimentSection = ExperimentSection()
    table: Layout = Layout()
    maneuvers: Maneuvers = Maneuvers()
    prepare: PrepareSection | None = None
    constants: ConstantsSection = ConstantsSection()
    modes: ModesSection | None = None
    aero: AeroSection | None = None
    path: PathSection | None = None
    stroke: StrokeSection | None = None
    load_cell: StandSection | None = None
    torque_speed: TorqueSpeedSection | None = None
    twist: TwistSection | None = None
    servo: ServoSection | None = None
    power: PowerSection | None = None


SECTIONS = ("modes", "aero", "path", "stroke", "load_cell", "torque_speed", "twist", "servo", "power")
"""sections that say what to fit; each is a subject of the command"""
ALL = "all"
SUBJECTS = (*SECTIONS, ALL)
FORMER_SUBJECTS = {"stand": "load_cell"}
"""subject by its former name"""
EXAMPLES = Path(__file__).parent / "examples"


def example_map(subject: str) -> str:
    """An example map of a subject: text of a file beside this module."""
    name = "modes" if subject in ("aero", ALL) else subject
    return (EXAMPLES / f"{name}.toml").read_text(encoding="utf-8")


def load_map(path: Path) -> Map:
    """A map, every key of it checked; ``include`` names a TOML file with further sections, relative to the map.

    Raises:
        InputError: it cannot be read, is no TOML, or has an unknown key or value; the text names the key.
    """
    document = _with_include(read_document(path, "map"), path)
    if "markers" in document:
        raise InputError(f"map {path}: [markers] is read by wingbeat identify FILE --map MAP.toml markers")
    try:
        rename_keys(document)
        config: Map = read_record(Map, document, "")
        if config.time == TimeSection():
            if config.experiment.kind != "steady":
                raise InputError("time is missing")
            config = config._replace(time=TimeSection(rate=1.0))
        config.time.check()
        config = _with_methods(_with_models(config, path.parent))
    except InputError as error:
        raise InputError(f"map {path}: {error}") from None
    return config


def rename_keys(document: dict[str, Any]) -> None:
    """Replace former keys (`ALIASES`) in place.

    Raises:
        InputError: a section has both the former and the present key.
    """
    for section, old, new in ALIASES:
        tables: list[Any] = [document]
        for name in filter(None, section.split(".")):
            found = [one for table in tables for one in (table.values() if name == "*" else [table.get(name)])]
            tables = [x for one in found for x in (one if isinstance(one, list) else [one]) if isinstance(x, dict)]
        for table in tables:
            if old in table:
                if new in table:
                    raise InputError(f"{section or 'map'}: {old} is the former name of {new}: give one")
                table[new] = table.pop(old)


def _with_models(chosen: Map, folder: Path) -> Map:
    """Replace the names of user's models by their files, and fill in their inputs."""
    modes, aero = chosen.modes, chosen.aero
    if modes is not None and modes.model is not None:
        modes = modes._replace(**_model(modes.model, modes.inputs, MODES_MODELS, "modes", folder))
    if aero is not None:
        fits = tuple(
            one._replace(**_model(one.model, one.inputs, AERO_MODELS, "aero.output_error", folder))
            for one in aero.output_error
        )
        aero = aero._replace(output_error=fits)
    return chosen._replace(modes=modes, aero=aero)


def _with_methods(chosen: Map) -> Map:
    """Check the methods; equation error and stepwise regression by the words of the former keys too.

    Raises:
        InputError: a method that the registry does not have for the section.
    """
    aero = chosen.aero
    if chosen.modes is not None and chosen.modes.method is not None:
        _check_method("modes", chosen.modes.method)
    if aero is None:
        return chosen
    for one in aero.output_error:
        _check_method("aero.output_error", one.method)
    return chosen._replace(aero=aero._replace(regressions=tuple(map(_with_method, aero.regressions))))


def _with_method(one: Regression) -> Regression:
    for domain in ("time", "frequency"):
        if one.method == f"equation_error_{domain}":
            return one._replace(method=LEAST_SQUARES, domain=domain)
    if one.method == "stepwise":
        return one._replace(method=LEAST_SQUARES, selection="stepwise")
    if one.method != LEAST_SQUARES:
        _check_method("aero.regressions", one.method, LEAST_SQUARES)
    return one


def _check_method(section: str, name: str, *more: str) -> None:
    read_value(Annotated[str, *methods(section), *more], name, f"{section}.method")


def _model(name: str, inputs: tuple[str, ...], models: tuple[str, ...], key: str, folder: Path) -> dict[str, Any]:
    """Model and inputs of a section.

    Raises:
        InputError: an unknown model, or other inputs than those of a user's model.
    """
    if not is_user_model(name):
        return {"model": read_value(Annotated[str, *models], name, f"{key}.model"), "inputs": inputs}
    file = ModelFile(name, folder)
    names = user_inputs(file.path)
    if inputs and set(inputs) != set(names):
        raise InputError(f"{key}.inputs: the inputs of {name} are {', '.join(names) or 'none'}; leave the key out")
    return {"model": file, "inputs": names}


def _with_include(document: dict[str, Any], path: Path) -> dict[str, Any]:
    """The document with the keys of the included file, its own first."""
    name = document.pop("include", None)
    if name is None:
        return document
    if not isinstance(name, str):
        raise InputError(f"map {path}: include must be the name of a file in quotes")
    shared = read_document(path.parent / name, "include")
    for key, value in shared.items():
        own = document.get(key)
        document[key] = {**value, **own} if isinstance(own, dict) and isinstance(value, dict) else own or value
    return document
