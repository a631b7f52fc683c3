"""What a table says: spreads, rank correlations, the worst flights; and the page with them."""

from __future__ import annotations

import math
import re
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from scipy import stats
from short_campaigns import campaign_of

from groundstation.views.campaign_report import report
from logs.campaigns.comparison import comparisons
from logs.campaigns.metrics import METRICS
from logs.campaigns.page import write
from logs.campaigns.statistics import chosen_metric, format_column, inputs_of, ranks, sensitivities, spreads, worst
from logs.campaigns.table import OWN, About, Table, about, read_table, write_table
from wingbeat.errors import InputError

FLIGHTS = 60
GENERATOR = np.random.default_rng(5)
WIND = GENERATOR.uniform(0, 5, FLIGHTS)
SINK = 0.5 + 0.2 * WIND + GENERATOR.normal(0, 0.05, FLIGHTS)
POWER = GENERATOR.normal(20, 1, FLIGHTS)


def table() -> Table:
    """Sixty flights in which wind makes the sink and has nothing to do with the power; the hardest five crash."""
    failed = (np.sort(SINK)[-6] < SINK).tolist()
    columns: dict[str, list[object]] = {name: [None] * FLIGHTS for name in METRICS}
    columns |= {
        "flight": list(range(1, FLIGHTS + 1)),
        "wind.speed": WIND.tolist(),
        "mission": ["circuit", "triangle"] * (FLIGHTS // 2),
        "seed": list(range(FLIGHTS)),
        "failed": failed,
        "outcome": ["crashed" if one else "landed" for one in failed],
        "reason": ["too hard" if one else "" for one in failed],
        "log": [""] * FLIGHTS,
        "touchdown_sink": SINK.tolist(),
        "power": [*POWER.tolist()[:-1], None],
    }
    units = {name: metric.unit for name, metric in METRICS.items()} | dict.fromkeys(OWN, "-") | {"wind.speed": "m/s"}
    about = About("made", "up", "made.toml", "0", ("wind.speed", "mission", "seed"))
    return Table(about, columns, units)


def test_ranks_are_those_of_scipy() -> None:
    values = np.round(GENERATOR.normal(0, 2, 200))
    assert np.array_equal(ranks(values) + 1, stats.rankdata(values))


def test_what_matters_is_found_and_what_does_not_is_chance() -> None:
    found = {(one.input, one.metric): one for one in sensitivities(table())}
    assert inputs_of(table()) == ["wind.speed"]
    sink, power = found["wind.speed", "touchdown_sink"], found["wind.speed", "power"]
    assert sink.rank_correlation == pytest.approx(stats.spearmanr(WIND, SINK).statistic)
    assert power.rank_correlation == pytest.approx(stats.spearmanr(WIND[:-1], POWER[:-1]).statistic)
    assert (sink.beyond_chance, power.beyond_chance, power.flights) == (True, False, FLIGHTS - 1)
    assert found["wind.speed", "failed"].rank_correlation > 0.3


def test_spreads_are_over_the_flights_that_have_a_number() -> None:
    told = {one.name: one for one in spreads(table())}
    assert set(told) == {"touchdown_sink", "power"}
    power = told["power"]
    assert (power.flights, power.mean, power.sigma) == pytest.approx(
        (FLIGHTS - 1, POWER[:-1].mean(), POWER[:-1].std(ddof=1))
    )
    assert power.least <= power.low <= power.median <= power.high <= power.greatest


def test_the_worst_are_those_that_failed_and_then_the_worst_by_a_metric() -> None:
    found = worst(table(), "touchdown_sink", 3)
    assert [one.why for one in found] == ["crashed: too hard"] * 3 + ["touchdown_sink"] * 3
    hardest = np.sort(SINK)[-8:-5][::-1]
    assert [one.value for one in found[3:]] == hardest.tolist()
    assert found[3].flight == int(np.argwhere(hardest[0] == SINK)[0, 0]) + 1
    assert (
        found[3].command
        == f"wingbeat campaign made.toml --flight {found[3].flight} --log flight-{found[3].flight}.mcap"
    )


def test_a_metric_that_nobody_has_is_refused() -> None:
    assert chosen_metric(table(), None) == "touchdown_sink"
    with pytest.raises(InputError, match="metrics: power, touchdown_sink"):
        chosen_metric(table(), "hold_altitude_rms")


def grid_table() -> Table:
    """Gains of 1, 2 and 10 in the same twenty winds: 2 holds better than 1 in all but two, 10 worse in all."""
    made, third = table(), FLIGHTS // 3
    error = {1.0: 0.5 + 0.1 * WIND[:third], 2.0: 0.4 + 0.1 * WIND[:third], 10.0: 0.9 + 0.1 * WIND[:third]}
    error[2.0][:2] += 0.2
    columns = made.columns | {
        "scale.gains.pitch.damping": np.repeat([10.0, 1.0, 2.0], third).tolist(),
        "wind.speed": np.tile(WIND[:third], 3).tolist(),
        "seed": [*range(third)] * 3,
        "power": [None, *POWER.tolist()[1:]],
        "hold_altitude_rms": np.concatenate([error[10.0], error[1.0], error[2.0]]).tolist(),
    }
    swept = ("scale.gains.pitch.damping", "wind.speed", "seed")
    return made._replace(about=made.about._replace(swept=swept), columns=columns)


def test_the_values_of_a_grid_are_compared_in_pairs_of_the_same_gusts() -> None:
    (told,) = comparisons(grid_table())
    assert (told.input, told.values, told.flights) == ("scale.gains.pitch.damping", ("1", "2", "10"), (20, 20, 20))
    assert sum(told.failed) == 5
    hold = next(one for one in told.metrics if one.metric == "hold_altitude_rms")
    expected = np.percentile(0.5 + 0.1 * WIND[:20], (25, 50, 75))
    assert hold.groups[0][1:] == pytest.approx(tuple(expected))
    assert [(one.value, one.first, one.pairs, one.better, one.worse) for one in hold.pairs] == [
        ("2", "1", 20, 18, 2),
        ("10", "1", 20, 0, 20),
    ]
    assert [one.beyond_chance for one in hold.pairs] == [True, True]
    power = next(one for one in told.metrics if one.metric == "power")
    assert [one.pairs for one in power.pairs] == [20, 19]


def test_a_value_without_the_metric_leaves_the_pairs_of_the_others_in_their_place(tmp_path: Path) -> None:
    made, third = grid_table(), FLIGHTS // 3
    errors = made.columns["hold_altitude_rms"]
    made = made._replace(columns=made.columns | {"hold_altitude_rms": [*errors[: 2 * third], *[None] * third]})
    (told,) = comparisons(made)
    hold = next(one for one in told.metrics if one.metric == "hold_altitude_rms")
    assert [(one.value, one.pairs, one.worse) for one in hold.pairs] == [("2", 0, 0), ("10", 20, 20)]
    write(tmp_path / "page.html", made, ())
    rows = (tmp_path / "page.html").read_text().split("<tr>")
    row = next(row for row in rows if "altitude error, RMS of the longest hold (m)" in row and "of 20" in row)
    cells = [re.sub(r"<.*?>", "", cell) for cell in re.findall(r"<t[dh].*?</t[dh]>", row, re.S)]
    assert cells[-2:] == ["", "in 0 of 20 *"]
    console = Console(width=200, file=StringIO(), record=True)
    console.print(report(made, None, (), "", tmp_path / "page.html"))
    lines = console.export_text().splitlines()
    heads = next(line for line in lines if line.startswith("median"))
    values = next(line for line in lines if "in 0 of 20 *" in line)
    assert values.startswith("hold_altitude_rms") and heads.index(" 10 better") - 6 < values.index("in 0 of 20 *")


def test_in_an_unfinished_table_the_pairs_that_are_there_are_compared() -> None:
    made, third = grid_table(), FLIGHTS // 3
    # Of the three gains 10 and 1 are flown in all winds, 2 in five.
    part = made._replace(columns={name: values[: 2 * third + 5] for name, values in made.columns.items()}, planned=60)
    (told,) = comparisons(part)
    hold = next(one for one in told.metrics if one.metric == "hold_altitude_rms")
    assert [(one.value, one.pairs, one.better, one.worse) for one in hold.pairs] == [
        ("2", 5, 3, 2),
        ("10", 20, 0, 20),
    ]


def test_what_is_drawn_is_no_grid_though_all_flights_have_the_same_seed(tmp_path: Path) -> None:
    text = (
        "flights = 5\n[flight]\nseed = 3\n[grid]\n'scale.gains.pitch.damping' = [1.0, 2.0, 4.0]\n"
        "[draw]\n'wind.speed' = { uniform = [0.0, 3.0] }\n'scale.gains.pitch.integral' = { choice = [1.0, 1.5] }\n"
    )
    campaign = campaign_of(tmp_path, text)
    assert campaign.swept == ("scale.gains.pitch.damping", "wind.speed", "scale.gains.pitch.integral")
    rows = {number: row(number) for number in range(1, campaign.size + 1)}
    write_table(tmp_path / "made.parquet", campaign, rows)
    found = read_table(tmp_path / "made.parquet")
    assert found.about == about(campaign) and found.about.drawn == ("wind.speed",)
    assert [one.input for one in comparisons(found)] == list(campaign.swept[::2])


def row(number: int) -> dict[str, Any]:
    """A flight that landed, without metrics."""
    about_it = {"flight": number, "failed": False, "outcome": "landed", "reason": "", "log": ""}
    return dict.fromkeys(METRICS) | about_it


def test_words_are_compared_without_pairs_and_drawn_numbers_not_at_all() -> None:
    (told,) = comparisons(table())
    assert (told.input, told.values) == ("mission", ("circuit", "triangle"))
    assert all(not one.pairs for one in told.metrics)


def test_below_twenty_flights_the_tails_are_not_told() -> None:
    made = table()
    few = made._replace(columns={name: values[:19] for name, values in made.columns.items()})
    assert all(math.isnan(one.low) and math.isnan(one.high) for one in spreads(few))
    assert all(one.low < one.median < one.high for one in spreads(made))


def test_numbers_of_a_metric_have_decimals_in_common() -> None:
    assert format_column([0.41771, 0.5, 12.3456, math.nan]) == ["0.42", "0.50", "12.35", ""]
    assert format_column([1234.5, 3.0]) == ["1234", "3"]


def test_the_page_compares_a_grid_and_tells_what_the_worst_were_flown_with(tmp_path: Path) -> None:
    made = grid_table()
    write(tmp_path / "page.html", made, worst(made, "hold_altitude_rms", 1))
    text = (tmp_path / "page.html").read_text()
    assert "median by factor on gain pitch damping" in text and "in 18 of 20 *" in text and "2 better" in text
    assert "factor on gain pitch damping 10, wind speed" in text


def test_where_words_alone_were_swept_the_page_still_compares_them(tmp_path: Path) -> None:
    made = table()
    write(tmp_path / "page.html", made._replace(about=made.about._replace(swept=("mission", "seed"))), ())
    text = (tmp_path / "page.html").read_text()
    assert "no rank correlations" in text and "median by mission" in text


def test_the_page_holds_everything_and_needs_nothing(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    assert write(path, table(), worst(table(), "touchdown_sink", 3)) == path.stat().st_size
    text = path.read_text()
    for words in (
        "Campaign made",
        "5 flights of 60 failed",
        "too hard",
        "failed flights (%)",
        "wind speed (m/s)",
        "median by mission",
    ):
        assert words in text
    assert "--flight" in text and not re.search(r"(?:src|href)=[\"'](?!#|data:)", text)
    assert text.count("data-plot=") >= 4
    for key in ("touchdown_sink", "wind.speed"):
        assert key not in re.sub(r"wingbeat campaign [^<]*", "", text)
    with pytest.raises(InputError, match="exists"):
        write(path, table(), ())
