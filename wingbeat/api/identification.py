"""Identification from logs and tables, and gains from a model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from groundstation.command.foreign_log import opened_log
from groundstation.command.identify import identified, identified_together
from groundstation.command.identify_out import sha256, write_outputs
from logs.identification.findings import Finding
from logs.identification.models.actuators import Actuated
from logs.identification.models.linear import LinearModel as AffineModel
from logs.identification.models.modes import Mode, ModesResult
from logs.identification.report import model_file
from logs.identification.report.tables import Source, write_tables_report
from logs.identification.results import Estimate, EstimationResult
from logs.identification.sources.table.config import Map, OutputError, load_map
from logs.identification.sources.table.models import MODELS, chosen_model
from logs.identification.sources.table.run import TableIdentification, identify_tables
from logs.reader import Log, open_log
from wingbeat.api.flights import Flight
from wingbeat.api.steady import LONGITUDINAL, state_space
from wingbeat.errors import InputError

if TYPE_CHECKING:
    import pandas as pd
    from control import StateSpace
    from matplotlib.figure import Figure

__all__ = ["Identification", "identify"]

DRIVES = {"torque": "servo torque", "power": "servo power", "load": "wing load", "frequency": "flapping frequency"}
"""title of a result by its field of a log's identification"""
COLUMNS = ("result", "name", "value", "standard_error", "low", "high", "unit", "true")


class _Flights(NamedTuple):
    """Where the results of logs come from."""

    logs: tuple[Path, ...]
    estimates: Any
    """`logs.identification.report.Identification`"""


class _Tables(NamedTuple):
    """Where the results of tables come from."""

    files: tuple[Path, ...]
    map: Path
    subject: str
    estimates: TableIdentification


class Identification(Mapping[str, EstimationResult]):
    """Results of an identification by name, such as ``servo torque`` or ``output error``."""

    def __init__(self, results: Mapping[str, EstimationResult], truths: Mapping[str, float], source: Any) -> None:
        self._results, self._source = dict(results), source
        self.truths = dict(truths)
        """true values of a simulated flight by name; ``power.`` stands before those of the servo power"""

    def __getitem__(self, name: str) -> EstimationResult:
        """Return one result.

        Raises:
            KeyError: there is none of this name.
        """
        return self._results[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._results)

    def __len__(self) -> int:
        return len(self._results)

    @property
    def modes(self) -> ModesResult | None:
        """Modes of motion by every method; None if they were not identified."""
        estimates: ModesResult | None = self._source.estimates.modes
        return estimates

    @property
    def findings(self) -> dict[str, tuple[Finding, ...]]:
        """Warnings and withheld numbers by result."""
        return {name: one.findings for name, one in self.items() if one.findings}

    def to_pandas(self) -> pd.DataFrame:
        """Return one row per number with its 95 % interval (low, high), and the truth of a simulated flight."""
        import pandas as pd

        rows = [
            (title, one.name, one.value, one.standard_error, one.low, one.high, one.unit, self._truth(title, one))
            for title, result in self.items()
            for one in (*result.estimates, *result.derived)
        ]
        return pd.DataFrame(rows, columns=list(COLUMNS))

    def _truth(self, title: str, one: Estimate) -> float | None:
        return self.truths.get(f"power.{one.name}" if title == DRIVES["power"] else one.name)

    def report(self, path: Path | str) -> Path:
        """Write the HTML page of ``wingbeat identify --report``.

        Raises:
            InputError: the file exists or cannot be written.
        """
        path, source = Path(path), self._source
        if isinstance(source, _Tables):
            named = tuple(Source(one.name, sha256(one)) for one in (*source.files, source.map))
            write_tables_report(path, named, source.estimates)
            return path
        with ExitStack() as stack:
            logs = [stack.enter_context(open_log(one)) for one in source.logs]
            write_outputs(logs, source.estimates, path)
        return path

    def to_control(self, name: str | None = None) -> StateSpace:
        """Return an identified linear model as a python-control `StateSpace` with named states, inputs and outputs.

        Of a flight it is the longitudinal model: (u, w, q, theta) by the elevator in rad, positive nose up. Of tables
        it is the linear model of a fit: short period, longitudinal, lateral or the user's matrices, with the names of
        the map.

        Args:
            name: result with the model (default: the first that has one).

        Raises:
            InputError: no result, or not this one, has a linear model with all its parameters.
        """
        if isinstance(self._source, _Tables):
            return self._table_model(self._source, name)
        if self.modes is None or (name is not None and name not in self):
            raise InputError(f"no linear model: {name or 'the modes'} was not identified")
        modes = self.modes
        if name is not None:
            modes = modes._replace(modes=tuple(one for one in modes.modes if one.method == name))
        model = model_file.linear_model(modes, model_file.Log("", "", None))
        return state_space(model.a, model.elevator, LONGITUDINAL, "elevator")

    def _table_model(self, source: _Tables, name: str | None) -> StateSpace:
        import control

        for title, result in self.items():
            if name not in (None, title):
                continue
            for section in _sections(load_map(source.map), result.model):
                records = tuple(one for one in source.estimates.records if one.name in source.estimates.experiments)
                chosen = chosen_model(section, source.estimates.constants, records)
                model = chosen.model.model if isinstance(chosen.model, Actuated) else chosen.model
                if not isinstance(model, AffineModel) or chosen.equations != result.equations:
                    continue
                known = {key: one.value for key, one in model.parameters.items()} | dict(result.fixed)
                known |= {one.name: one.value for one in result.estimates}
                matrices = model.matrices(np.array([known[key] for key in model.parameters]))
                inputs = [own for own in chosen.aliases if chosen.aliases[own] in model.inputs] or list(model.inputs)
                outputs = [f"{one}_measured" if one in model.states else one for one in model.outputs]
                system = matrices.a, matrices.b[:, :-1], matrices.c, matrices.d[:, :-1]
                return control.ss(*system, states=list(model.states), inputs=inputs, outputs=outputs)
        raise InputError(f"no linear model in {name or 'these results'}: {', '.join(self)}")

    def plot(self, name: str | None = None) -> Figure:
        """Plot the measured and the modeled outputs of a result (default: the first with a fit; needs matplotlib).

        Raises:
            InputError: there is no such result, or it has no modeled outputs.
        """
        from wingbeat.api.plots import plot_fit

        for title, result in self.items():
            if result.series and name in (None, title):
                return plot_fit(title, result)
        raise InputError(f"no modeled outputs in {name or 'these results'}: {', '.join(self)}")

    def __repr__(self) -> str:
        lines = []
        for title, result in self.items():
            first = (result.derived or result.estimates)[:4]
            lines.append(f"  {title}: {', '.join(f'{one.name} {one.value:.4g}' for one in first)}")
        return "\n".join(("Identification", *lines))


def identify(
    source: Flight | Log | Path | str | Sequence[Path | str],
    what: str = "all",
    *,
    map: Path | str | None = None,
    vehicle: str | Path | None = None,
    elevator: tuple[str, float] | None = None,
    method: str | None = None,
) -> Identification:
    """Identify drives, modes and coefficients from a flight, or what a map asks for from tables.

    The results are those of ``wingbeat identify`` with the same inputs.

    Args:
        source: flight, log, file (.mcap, .ulg, .bin, .tlog) or several of one aircraft; with ``map`` tables.
        what: subject, see ``wingbeat identify --help``: all, servo, power, modes, aero, path, ...
        map: columns of the tables and what to fit.
        vehicle: name, file or folder of the vehicle, for a log of another program.
        method: row of the registry that alone identifies the modes; all that apply if not given.
        elevator: ``topic.field`` of the elevator command and its scale in rad per unit, for a log without the angle.

    Raises:
        InputError: not a log or a table, an unknown subject, or the data give nothing of it.
    """
    if map is not None:
        tables = tuple(Path(one) for one in ([source] if isinstance(source, str | Path) else source))  # type: ignore[union-attr]
        estimates = identify_tables(tables, Path(map), what, method)
        return Identification(_of_tables(estimates), {}, _Tables(tables, Path(map), what, estimates))
    named = None if vehicle is None else str(vehicle)
    words = None if elevator is None else (elevator[0], repr(elevator[1]))
    if isinstance(source, Flight | Log):
        log = source.log if isinstance(source, Flight) else source
        one = identified(log, what, named, words, method=method)
        return Identification(_of_log(one), one.truths, _Flights((log.path,), one))
    paths = tuple(Path(one) for one in ([source] if isinstance(source, str | Path) else source))
    if not paths:
        raise InputError("no log to identify from")
    with ExitStack() as stack:
        logs = [stack.enter_context(opened_log(path)) for path in paths]
        one = (
            identified(logs[0], what, named, words, method=method)
            if len(logs) == 1
            else identified_together(logs, named, words, method=method)
        )
    return Identification(_of_log(one), one.truths, _Flights(paths, one))


def _sections(chosen: Map, model: str) -> list[OutputError]:
    """Return the sections of a map that fit this model to outputs."""
    own = [] if chosen.aero is None else [one for one in chosen.aero.output_error if one.model == model]
    modes = chosen.modes
    if modes is None or model not in MODELS:
        return own
    return [
        *own,
        OutputError(model, modes.outputs, modes.inputs, parameters=modes.parameters, zoh_inputs=modes.zoh_inputs),
    ]


def _of_tables(estimates: TableIdentification) -> dict[str, EstimationResult]:
    results: dict[str, EstimationResult] = {}
    for fit in estimates.fits:
        title = fit.title or fit.method
        results[title if title not in results else f"{title}, {len(results) + 1}"] = fit
    for mode in estimates.modes.modes if estimates.modes is not None else ():
        if mode.method in results:
            results[mode.method] = results[mode.method]._replace(derived=_derived(mode))
        elif _derived(mode):
            results[mode.method] = _of_mode(mode)
    return results


def _of_log(estimates: Any) -> dict[str, EstimationResult]:
    results: dict[str, EstimationResult] = {}
    for field, title in DRIVES.items():
        model = getattr(estimates, field)
        if model is not None:
            results[title] = getattr(model, "result", model)
    results |= {model.title: model for model in (estimates.aero.models if estimates.aero is not None else ())}
    if estimates.path is not None:
        results[estimates.path.result.title] = estimates.path.result
    if estimates.modes is not None:
        fits = {one.title or one.method: one for one in estimates.modes.results}
        for mode in estimates.modes.modes:
            fit = fits.get(mode.method)
            results[mode.method] = _of_mode(mode) if fit is None else fit._replace(derived=_derived(mode))
    return results


def _of_mode(mode: Mode) -> EstimationResult:
    return EstimationResult(
        mode.method, "modes", estimates=mode.derivatives, derived=_derived(mode), findings=mode.withheld,
        title=mode.method,
    )  # fmt: skip


def _derived(mode: Mode) -> tuple[Estimate, ...]:
    pairs = (mode.short_period, mode.phugoid)
    return tuple(one for pair in pairs if pair is not None for one in pair.estimates)
