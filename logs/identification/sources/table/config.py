"""The map of a table: TOML that says what its columns are, which manoeuvres are in it, and what is to be fitted."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from logs.identification.models.user import is_user_model, user_inputs
from logs.identification.sources.table.columns import Layout
from logs.identification.sources.table.constants import ConstantsSection
from logs.identification.sources.table.maneuvers import Manoeuvres
from logs.identification.sources.table.prepare import PrepareSection
from logs.identification.sources.table.signals import SignalEntry, TimeSection
from logs.identification.tables.benches import TorqueSpeedSection, TwistSection
from logs.identification.tables.flight_paths import PathSection
from logs.identification.tables.load_cell_tests import StandSection
from logs.identification.tables.servos import PowerSection, ServoSection
from logs.identification.tables.strokes import StrokeSection
from wingbeat.errors import InputError
from wingbeat.schema import check_known, read_document, read_number, read_record, read_value

EXAMPLE = """\
# What the columns of a table are and what is to be fitted: wingbeat identify TABLE.csv --map THIS.toml
[time]
column = "t"                 # or rate = 25.0 (Hz) where the rows have no time
unit = "s"

[signals]                    # SI value: (column * scale + offset) in unit; body axes x forward, y right, z down
alpha = { column = "alpha", unit = "deg" }
q = { column = "q", unit = "deg/s" }                 # a column's name, or its number from 1
a_z = { column = "nz", unit = "g", scale = -1.0 }    # specific force: -9.81 m/s^2 at rest
V = { column = "tas", unit = "kn" }
delta_e = { column = "elevator", unit = "deg" }      # any name for controls

[manoeuvres]                 # all of the table is one when not given
windows = [[2.0, 12.0], [20.0, 32.0]]                # s
validate = [2]               # numbers of those that are only predicted

[prepare]                    # of whole records, before manoeuvres are cut; nothing when not given
smooth = { alpha = "spline" }                        # local_quadratic, fourier, spline, rts; alpha_dot comes with it
[prepare.delay]
a_z = 0.02                   # s that it is late; { like = "q", by = "slope" } measures it against another signal

[constants]                  # a number in SI, or with a unit
mass = { value = 10500, unit = "lb" }
I_y = { value = 23800, unit = "slug ft^2" }
S = { value = 300, unit = "ft^2" }
c = { value = 6.5, unit = "ft" }
V = { value = 200, unit = "kn" }
altitude = { value = 8000, unit = "ft" }

[modes]                      # the short period, by every method
inputs = ["delta_e"]         # [] for a free response
outputs = ["alpha", "q", "a_z"]
[modes.parameters]           # all of the model's are free when not given; start values are found
Z_alpha = { start = -1.0 }
Z_q = 0.0                    # fixed

[[aero.regressions]]         # coefficients by regression, as many as wanted
response = "C_m"             # a signal, or C_X C_Y C_Z C_L C_D C_l C_m C_n of the measured accelerations
regressors = ["alpha", "q*c/2V", "delta_e"]

[table]                      # all of it is found out when not given
missing = [-9999]            # numbers that stand for "not measured"
"""
"""What a map looks like: `wingbeat identify --map-example` prints it."""
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
        told = {name: read_number(value, f"{key}.{name}") for name, value in entry.items()}
        if "fixed" in told and len(told) > 1:
            raise InputError(f"{key} is either fixed, or has a start and bounds")
        made = cls(**told)
        if not made.low < made.high or not made.low <= (made.low if made.start is None else made.start) <= made.high:
            raise InputError(f"{key}: low must be below high, and start between them")
        return made


class ExperimentSection(NamedTuple):
    """Section [experiment]."""

    kind: Annotated[str, "dynamic", "steady"] = "dynamic"
    """steady: rows are independent steady readings in any order, without time"""


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
    method: Annotated[str, "output_error", "filter_error"] | None = None
    """all that apply if not given"""
    kinds: Annotated[tuple[str, ...], "short_period", "phugoid"] | None = None
    """which modes are in the records; by the outputs when not given"""
    parameters: dict[str, Parameter] = {}
    delay: Parameter = Parameter(fixed=0.0)
    """s; of the inputs"""
    hold: tuple[str, ...] = ()
    """inputs that are held from each sample to the next; the others are lines between samples"""
    biases: tuple[str, ...] | None = None
    """outputs with a bias in every manoeuvre; all when not given"""
    band: tuple[float, float] | None = None
    """Hz; of equation error in the frequency domain, by the motion when not given"""


class Regression(NamedTuple):
    """One of [[aero.regressions]]."""

    response: str
    regressors: tuple[str, ...]
    selection: Annotated[str, "all", "stepwise"] = "all"
    method: Annotated[str, "least squares", "orthogonal"] = "least squares"
    """orthogonal: of the regressors those whose orthogonal functions lower the predicted square error"""
    domain: Annotated[str, "time", "frequency"] = "time"
    always: tuple[str, ...] = ()
    """regressors that stepwise regression keeps in any case"""
    band: tuple[float, float] | None = None
    """Hz; of the frequency domain"""


class OutputError(NamedTuple):
    """Section [aero.output_error]."""

    model: str
    """one of `AERO_MODELS`, or a user's file"""
    outputs: tuple[str, ...]
    inputs: tuple[str, ...] = ()
    parameters: dict[str, Parameter] = {}
    delay: Parameter = Parameter(fixed=0.0)
    hold: tuple[str, ...] = ()
    """as of [modes]"""
    biases: tuple[str, ...] | None = None
    """as of [modes]; none of a model that is not linear when not given"""
    search: Annotated[str, "gauss-newton", "nelder-mead", "both"] = "gauss-newton"
    """both: Gauss-Newton from the end of the simplex"""
    method: Annotated[str, "output_error", "filter_error"] = "output_error"


class AeroSection(NamedTuple):
    """Section [aero]."""

    regressions: tuple[Regression, ...] = ()
    output_error: tuple[OutputError, ...] = ()


class Map(NamedTuple):
    """A whole map."""

    signals: dict[str, SignalEntry]
    time: TimeSection = TimeSection()
    experiment: ExperimentSection = ExperimentSection()
    table: Layout = Layout()
    manoeuvres: Manoeuvres = Manoeuvres()
    prepare: PrepareSection | None = None
    constants: ConstantsSection = ConstantsSection()
    modes: ModesSection | None = None
    aero: AeroSection | None = None
    path: PathSection | None = None
    stroke: StrokeSection | None = None
    stand: StandSection | None = None
    torque_speed: TorqueSpeedSection | None = None
    twist: TwistSection | None = None
    servo: ServoSection | None = None
    power: PowerSection | None = None


def load_map(path: Path) -> Map:
    """A map, every key of it checked; ``include`` names a TOML file with further sections, relative to the map.

    Raises:
        InputError: it cannot be read, is no TOML, or has a key or value that is not known; the text names the key.
    """
    document = _with_include(read_document(path, "map"), path)
    if "markers" in document:
        raise InputError(f"map {path}: [markers] is read by wingbeat identify FILE --map MAP.toml markers")
    try:
        found: Map = read_record(Map, document, "")
        if found.time == TimeSection():
            if found.experiment.kind != "steady":
                raise InputError("time is missing")
            found = found._replace(time=TimeSection(rate=1.0))
        found.time.check()
        found = _with_models(found, path.parent)
    except InputError as error:
        raise InputError(f"map {path}: {error}") from None
    return found


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
