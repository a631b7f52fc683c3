"""Dutch roll, roll and spiral of lateral models: of a known one, and of a table by the command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from output_error_cases import LATERAL, LATERAL_TRUTH, simulated, steps, vector

from groundstation.command import identify
from logs.identification.models.lateral import lateral_modes
from logs.identification.results import Array
from logs.identification.statistics.covariance import ParameterUncertainty

STEP = 0.02
MAP = """
[time]
rate = 50.0
[signals]
beta = { column = "beta", unit = "rad" }
p = { column = "p", unit = "rad/s" }
r = { column = "r", unit = "rad/s" }
phi = { column = "phi", unit = "rad" }
delta_a = { column = "delta_a", unit = "rad" }
delta_r = { column = "delta_r", unit = "rad" }
[constants]
V = 20.0
theta = 0.06
alpha = 0.06
[[aero.output_error]]
model = "lateral"
inputs = [INPUTS]
outputs = [OUTPUTS]
[aero.output_error.parameters]
"""


def roots() -> tuple[complex, float, float]:
    """The Dutch roll's eigenvalue, what the roll decays and what the spiral grows by in the truth, 1/s."""
    found = np.linalg.eigvals(LATERAL.matrices(vector(LATERAL, LATERAL_TRUTH)).a)
    (turning,) = [root for root in found if root.imag > 1e-9]
    fast, slow = sorted(found[np.abs(found.imag) < 1e-9].real)
    return turning, -fast, slow


def identified(folder: Path, capsys: pytest.CaptureFixture[str], mapping: str) -> dict[str, dict[str, float]]:
    time = STEP * np.arange(1500)
    inputs = np.column_stack((steps(time, 9.0, 0.3, 0.05), steps(time, 1.0, 0.4, 0.08)))
    record = simulated(LATERAL, LATERAL_TRUTH, inputs, STEP, 0.03, 2)
    names = ("beta", "p", "r", "phi", "delta_a", "delta_r")
    rows = zip(*(record.signals[name] for name in names), strict=True)
    table = folder / "run.csv"
    table.write_text(",".join(names) + "\n" + "".join(",".join(f"{v:.9g}" for v in row) + "\n" for row in rows))
    (folder / "map.toml").write_text(mapping)
    assert identify.run([str(table), "aero", "--map", str(folder / "map.toml"), "--json"]) == 0
    (fit,) = json.loads(capsys.readouterr().out)["fits"]
    return {one["name"]: one for one in (*fit["modes"]["estimates"], *fit["modes"]["unidentified"])}


def test_a_lateral_table_names_its_modes_with_errors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mapping = MAP.replace("INPUTS", '"delta_a", "delta_r"').replace("OUTPUTS", '"beta", "p", "r", "phi"')
    found = identified(tmp_path, capsys, mapping + "".join(f'{name} = "free"\n' for name in LATERAL_TRUTH))
    dutch, roll, spiral = roots()
    truth = {
        "dutch_roll_frequency": abs(dutch), "dutch_roll_damping": -dutch.real / abs(dutch),
        "dutch_roll_period": 2 * np.pi / dutch.imag, "dutch_roll_time_to_half": np.log(2) / -dutch.real,
        "roll_time_constant": 1 / roll, "spiral_time_to_double": np.log(2) / spiral,
    }  # fmt: skip
    for name, true in truth.items():
        assert found[name]["low"] <= true <= found[name]["high"], (name, true, found[name])
        assert found[name]["high"] - found[name]["low"] < 0.6 * true, name


def test_without_the_bank_there_is_no_spiral(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """GIVEN a measured sideslip as an input THEN p and r alone have no Dutch roll, and it is said."""
    mapping = MAP.replace("INPUTS", '"delta_a", "delta_r", "beta"').replace("OUTPUTS", '"p", "r"')
    names = [name for name in LATERAL_TRUTH if not name.startswith("Y")]
    found = identified(tmp_path, capsys, mapping + "".join(f'{name} = "free"\n' for name in names))
    assert set(found) == {"dutch_roll", "roll", "spiral"}
    assert "takes sideslip" in str(found["dutch_roll"]["reason"])


@pytest.mark.parametrize(
    ("matrix", "expected", "refused"),
    [
        ([[-0.3, 2, 0, 0], [-2, -0.3, 0, 0], [0, 0, -5, 0], [0, 0, 0, 0.05]], "spiral_time_to_double", ()),
        ([[-0.3, 2, 0, 0], [-2, -0.3, 0, 0], [0, 0, -5, 0], [0, 0, 0, 1e-4]], "roll_time_constant", ("spiral",)),
        ([[-0.3, 2, 0, 0], [-2, -0.3, 0, 0], [0, 0, -0.1, 0.3], [0, 0, -0.3, -0.1]], "lateral_phugoid_damping", ()),
        (np.diag([-1.0, -2.0, -3.0, -4.0]), "", ("dutch_roll", "roll", "spiral")),
    ],
    ids=["spiral that grows", "neutral spiral", "roll and spiral coupled", "nothing oscillates"],
)
def test_other_shapes_of_the_lateral_motion(matrix: Array, expected: str, refused: tuple[str, ...]) -> None:
    """GIVEN eigenvalues as told THEN each mode has its name, and errors of a hundredth are carried."""
    base = np.array(matrix, dtype=np.float64)
    values = np.diag(base).copy()

    def system(at: Array) -> Array:
        return np.asarray(base + np.diag(at - values))

    found, lost = lateral_modes(system, values, ParameterUncertainty(np.diag(np.full(4, 1e-4)), 1000.0))
    assert tuple(one.subject for one in lost) == refused
    assert not expected or expected in {one.name for one in found}
    for one in found:
        if one.name == "roll_time_constant":
            assert one.standard_error == pytest.approx(0.01 / 25.0, rel=1e-3)
