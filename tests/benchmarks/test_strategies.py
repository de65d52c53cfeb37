"""The benchmark of search strategies: its worlds are what they claim, and its runs resume."""

from __future__ import annotations

import json
from collections.abc import Collection
from pathlib import Path
from typing import Any

import ablation
import bayesian
import ceiling
import confirm
import contestants
import duels
import emulators
import expected
import former
import grid
import numpy as np
import pandas as pd
import pytest
import recorded
import runs
import variants
import worlds
from analytic import AnalyticWorld
from campaigns import Row, Run, execute
from picture import failures_against_kinds
from predictions import BEGINNINGS, predictions
from standings import Block, blocks, markdown, standings
from truth import truth

from pipeline.config.composing import CONF, functional_scenario
from pipeline.core.car import Car
from pipeline.core.samplers.features import features
from pipeline.core.space import Floats, Space, Variable
from pipeline.errors import InputError
from pipeline.progress import Progress
from tests.spaces import SMALL

THRESHOLD_S = 0.1


@pytest.fixture(scope="module")
def analytic() -> AnalyticWorld:
    world = worlds.make(worlds.WorldName("F1", worlds.ANALYTIC), 0)
    assert isinstance(world, AnalyticWorld)
    return world


def outcomes(points: Floats) -> Floats:
    """KPIs of points of SMALL: kind a fails up to x = 6, the others up to 1."""
    margin = points[:, 0] - np.where(points[:, 3] == 0, 6, 1)
    return np.where(margin <= 0, 0.0, 0.2 + margin / 10)


@pytest.fixture(scope="module")
def small() -> recorded.Recorded:
    points = SMALL.sample(600, np.random.default_rng(0))
    kpi = outcomes(points)
    return recorded.Recorded(SMALL, points, kpi, kpi <= THRESHOLD_S, np.arange(600) < 300, 0)


@pytest.fixture(scope="module", params=list(emulators.FAMILIES))
def emulator(request: pytest.FixtureRequest, small: recorded.Recorded) -> emulators.Emulator:
    return emulators.Emulator(request.param, small)


def test_the_analytic_world_equals_the_executed_tests(analytic: AnalyticWorld) -> None:
    points = analytic.space.sample(250, np.random.default_rng(4))
    # Half of them near the first region, where the outcome changes.
    points[:125, analytic.space.names.index("sun_altitude")] = -10
    points[:125, analytic.space.names.index("fog")] = np.linspace(45, 60, 125)
    kpi = analytic.kpi(points)
    assert np.array_equal(kpi, [analytic.executed(point) for point in points])
    assert len(set(kpi)) > 5 and 20 < np.sum(kpi <= THRESHOLD_S) < 150


def test_an_emulated_test_depends_on_its_point_and_the_seed_alone(
    emulator: emulators.Emulator,
) -> None:
    points = SMALL.sample(300, np.random.default_rng(1))
    world = emulators.EmulatedWorld(emulator, 3, None, THRESHOLD_S)
    kpi, again = world.kpi(points), emulators.EmulatedWorld(emulator, 3, None, THRESHOLD_S)
    one_by_one = np.concatenate([again.kpi(point[None]) for point in points[::-1]])[::-1]
    assert kpi == pytest.approx(one_by_one, abs=1e-9)
    assert not np.array_equal(
        kpi, emulators.EmulatedWorld(emulator, 4, None, THRESHOLD_S).kpi(points)
    )
    assert ((kpi == 0) | (kpi > THRESHOLD_S)).all()


def test_an_emulated_world_fails_where_the_recorded_tests_do(emulator: emulators.Emulator) -> None:
    points = SMALL.sample(2000, np.random.default_rng(2))
    failed = emulators.EmulatedWorld(emulator, 0, None, THRESHOLD_S).kpi(points) <= THRESHOLD_S
    assert np.mean(failed == (outcomes(points) <= THRESHOLD_S)) > 0.85


@pytest.mark.parametrize("share", [0.015, 0.001])
def test_a_rare_world_has_its_share_of_failures(emulator: emulators.Emulator, share: float) -> None:
    world = emulators.EmulatedWorld(emulator, 0, share, THRESHOLD_S)
    points = SMALL.sample(20_000, np.random.default_rng(9))
    failed = np.concatenate([world.kpi(part) <= THRESHOLD_S for part in np.array_split(points, 10)])
    assert failed.mean() == pytest.approx(share, rel=0.6)
    assert world.shift < 0
    usual = (
        emulators.EmulatedWorld(emulator, 0, None, THRESHOLD_S).kpi(points[:2000]) <= THRESHOLD_S
    )
    assert usual[failed[:2000]].all()  # Shifting only removes failures.


def test_chance_is_uniform_smooth_in_part_and_white_in_part(small: recorded.Recorded) -> None:
    world = emulators.EmulatedWorld(emulators.Emulator("trees", small), 0, None, THRESHOLD_S)
    points = SMALL.sample(4000, np.random.default_rng(3))
    near = points.copy()
    near[:, 0] = np.clip(near[:, 0] + 1e-6, 0, 10)

    def chance(at: Floats) -> Floats:
        return world._chance(at, features(SMALL, at))

    assert np.histogram(chance(points), bins=5, range=(0, 1))[0] == pytest.approx(
        np.full(5, 800), rel=0.35
    )
    assert (
        0.3 < np.corrcoef(chance(points), chance(near))[0, 1] < 0.7
    )  # The smooth half stays, the white half is new.


def test_too_few_failures_are_named(small: recorded.Recorded) -> None:
    with pytest.raises(InputError, match="needs 20 failures and 20 other tests, got 0 and"):
        emulators.fit("trees", small.rows(~small.failed))


def test_truth_is_high_where_the_model_can_know(small: recorded.Recorded) -> None:
    table = truth([("S", small)])
    assert list(table["half"]) == ["random", "adaptive"] * 2 and set(table["family"]) == set(
        emulators.FAMILIES
    )
    assert (
        (table["auc"] > 0.9).all()
        and (table["spearman"] > 0.7).all()
        and (table["brier_skill"] > 0.5).all()
    )


def test_a_recorded_table_loses_nothing(tmp_path: Path) -> None:
    points = recorded.on_grid(SMALL, SMALL.sample(30, np.random.default_rng(0)))
    rows = [
        {"status": "ok", "adj_ttc_s": 0.25, "failure": False, **SMALL.decode(point)}
        for point in points
    ]
    rows[4] |= {"status": "error"}
    recorded.write(pd.DataFrame(rows[:20]), tmp_path / "F1-random.csv.gz")
    recorded.write(pd.DataFrame(rows[20:]), tmp_path / "F1-evolutionary.csv.gz")
    found = recorded.read("F1", SMALL, tmp_path)
    assert (
        np.array_equal(
            found.points, np.concatenate([points[20:], np.delete(points[:20], 4, axis=0)])
        )
        and found.errors == 1
    )
    assert found.random.tolist() == [False] * 10 + [True] * 19


def test_rounding_keeps_categories() -> None:
    space = Space(
        (
            Variable("x", "continuous", "m", 0, 10, 1),
            Variable("kind", "categorical", values=("a", "b")),
        )
    )
    points = np.array([[4.49996, 1], [1.23456, 1]])
    assert recorded.on_grid(space, points).tolist() == [[4.49996, 1], [1.235, 1]]


def test_a_missing_recording_names_the_command(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"record.py --study .* --scenario F1"):
        recorded.read("F1", SMALL, tmp_path)


def write_campaign(path: Path, failures: Collection[int], tests: int) -> None:
    """A recorded campaign on F5 of which some tests fail."""
    space = functional_scenario("F5").logical_space()
    rows = [
        {
            "status": "ok",
            "adj_ttc_s": 0.0 if i in failures else 2.0,
            "failure": i in failures,
            "failure_mode": "contact",
            "cause": "-",
        }
        | space.decode(point)
        for i, point in enumerate(space.sample(tests, np.random.default_rng(min(failures))))
    ]
    recorded.write(pd.DataFrame(rows), path)


def test_the_grid_counts_what_was_recorded(tmp_path: Path) -> None:
    for strategy, failures in (("random", (3,)), ("evolutionary", (1, 2, 5)), ("linear", (2,))):
        write_campaign(recorded.path_of("F5", strategy, tmp_path), failures, 40)
    campaigns = grid.read(tmp_path)
    text = grid.markdown(campaigns)
    assert (
        "| random (Random Testing) | 1 / 0 |" in text
        and "| evolutionary (Evolutionary) | 3 / 24 |" in text
    )
    assert (
        "| evolutionary (Evolutionary) | 0.50 / 0.93 |" in text
    )  # The first failure after 2 tests instead of 4.
    assert "F5 2.5% (0.4 to 12.9)" in text
    assert "ω keeps out 0 of 2,000 random candidates" in text
    assert [name for name, _ in grid.figures(campaigns, THRESHOLD_S)] == [
        "random",
        "random-failures",
    ]


def test_the_grids_expectations_are_judged_by_the_finished_scenarios(tmp_path: Path) -> None:
    found: dict[str, Collection[int]] = {name: range(10, 17) for name in expected.ADAPTIVE} | {
        "random": (3,),
        "linear": (0, 1, 2, 20, 21),
    }
    for strategy, failures in found.items():
        write_campaign(recorded.path_of("F5", strategy, tmp_path), failures, 40)
    write_campaign(recorded.path_of("F1", "random", tmp_path), (3, 4), 40)
    write_campaign(recorded.path_of("F1", "evolutionary", tmp_path), (9,), 40)
    text = expected.expectations(grid.read(tmp_path))
    assert text.startswith("**8 of 56 campaigns are finished.**")
    assert "| `evolutionary`: at least as many failures as `random` | 7 | 1 | 2 | open |" in text
    assert "| the strategy with most failures: 5 × as many as `random` | 6 | 1 | 1 | open |" in text
    # Linear: the first failure after 1 test instead of 4.
    assert "| the strategy that saves most tests: C of at least 0.75 | 8 | 1 | 1 | open |" in text


def test_confirmation_shows_means_over_seeds(tmp_path: Path) -> None:
    for seed, failures in ((1, range(10)), (2, range(20, 50))):
        write_campaign(recorded.path_of("F5", "forest", tmp_path / str(seed)), failures, 120)
    write_campaign(recorded.path_of("F5", "network", tmp_path / "1"), range(15), 120)
    write_campaign(recorded.path_of("F8", "forest", tmp_path / "1"), range(5), 120)
    rows = confirm.measured(tmp_path)
    of_forest = rows[(rows["scenario"] == "F5") & (rows["strategy"] == "forest")]
    assert of_forest["failures"].tolist() == [10, 30] and of_forest["seed"].tolist() == [1, 2]
    text = confirm.answer(rows)
    assert "| F5 | forest | 2 | 20 (10–30) |" in text
    # F8 has no campaign of the other, so it does not count.
    assert text.startswith(
        "Rendered, `forest` finds more failures than `network` in 1 of 1 scenarios"
    )


class Everywhere:
    """Every point fails."""

    space = SMALL

    def kpi(self, points: Floats) -> Floats:
        return np.zeros(len(points))


def test_the_ceiling_covers_pairs_at_the_greatest_rate() -> None:
    space = Space(tuple(Variable(name, "categorical", values=("x", "y")) for name in "abc"))
    failures = np.array([[0.0, 0, 0], [0, 0, 1], [1, 1, 1], [0, 1, 0]])
    # 000 covers three pairs, 111 three others, 001 then two (a0-c1 and b0-c1), 010 two (a0-b1 and b1-c0).
    assert ceiling.greedy(space, failures, 2).tolist() == [[0, 0, 0], [1, 1, 1]]
    assert len(ceiling.greedy(space, failures, 9)) == 4
    assert len(ceiling.known_failures(Everywhere(), THRESHOLD_S)) > 50_000


def test_every_strategy_of_conf_is_found() -> None:
    assert contestants.known() == sorted(path.stem for path in (CONF / "sampler").glob("*.yaml"))
    assert (
        contestants.digest("forest")
        != contestants.digest("forest explore=0.5")
        != contestants.digest("random")
    )
    with pytest.raises(InputError, match="did you mean 'forest'"):
        contestants.digest("foresst")


@pytest.mark.parametrize(
    "name", [*(f"{name} batch_size=30" for name in variants.VARIANTS), *former.SAMPLERS]
)
def test_a_variant_searches(name: str) -> None:
    space = functional_scenario("F3").logical_space()
    sampler = contestants.make(name, space, 0)
    for _ in range(3):
        points = sampler.ask()
        sampler.tell(points, np.where(points[:, -1] < 5, 0.0, 1.0 + points[:, 0]))
    last = sampler.ask()
    assert last.shape[1] == len(space) and len(last) >= 20
    assert np.mean(last[:, -1] < 5) > 0.3  # One in fifteen random tests.
    assert contestants.digest(name) != contestants.digest("forest")


def test_models_are_judged_on_other_campaigns() -> None:
    (row,) = predictions(["forest-linear-alone"], ["F3"]).to_dict("records")
    assert list(row) == ["model", *BEGINNINGS, "mean"] and 0.6 < row["mean"] < 0.95


def test_development_and_judging_share_nothing() -> None:
    first, second = worlds.SPLITS["development"], worlds.SPLITS["judging"]
    assert not set(first.scenarios) & set(second.scenarios)
    assert not set(first.seeds(20)) & set(second.seeds(20))


def test_a_killed_run_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, wanted = (
        tmp_path / "rows.jsonl",
        [Run("F1-analytic", "random", seed, 120) for seed in range(3)],
    )
    with Progress("runs") as progress:
        runs.run_all(wanted, path, 1, progress)
        whole = path.read_text().splitlines()
        path.write_text("\n".join(whole[:2]) + "\n" + whole[2][:40])
        executed: list[Run] = []

        def counted(run: Run) -> Row:
            executed.append(run)
            return execute(run)

        monkeypatch.setattr(runs, "execute", counted)
        runs.run_all(wanted, path, 1, progress)
    assert executed == wanted[2:]
    timeless = [
        {key: value for key, value in row.items() if key != "cpu_s"} for row in runs.read(path)
    ]
    assert timeless == [
        {key: value for key, value in json.loads(line).items() if key != "cpu_s"} for line in whole
    ]


def test_published_runs_are_read_as_they_were(tmp_path: Path) -> None:
    path, wanted = (
        tmp_path / "rows.jsonl",
        [Run(world, "random", 0, 120) for world in ("F5-analytic", "F1-analytic")],
    )
    with Progress("runs") as progress:
        runs.run_all(wanted, path, 1, progress)
        before = runs.read(path, tmp_path)
        (table,) = runs.keep(path, tmp_path)
        assert table == tmp_path / "rows-analytic.csv.gz"
        path.unlink()
        after = runs.read(path, tmp_path)
        bits = table.read_bytes()
        runs.keep(path, tmp_path)
    rounded = [
        {key: round(value, 6) if isinstance(value, float) else value for key, value in row.items()}
        for row in before
    ]
    assert after == rounded
    assert table.read_bytes() == bits


def rows(strategy: str, failures: list[int], world: str = "F1-trees") -> list[dict[str, Any]]:
    """Campaigns of 120 tests that fail from the start, one a seed."""
    measured = {
        "kinds_120": 2,
        "gamma_t_120": 0.5,
        "gamma_f_120": 0.1,
        "area_120": 0.2,
        "regions_120": 1,
    }
    return [
        {
            "world": world,
            "strategy": strategy,
            "seed": seed,
            "tests": 120,
            "errors": 0,
            "cpu_s": 1.2,
            "failures_120": count,
        }
        | {"failed_at": list(range(1, count + 1)), **measured}
        for seed, count in enumerate(failures)
    ]


def test_standings_by_hand() -> None:
    (block,) = blocks(
        [*rows("random", [2, 4]), *rows("forest", [4, 8]), *rows("ceiling", [120, 120])]
    )
    assert (block.group, block.budget) == ("trees", 120)
    table = standings(block, "random").set_index("strategy")
    forest = table.loc["forest"]
    assert (forest["failures"], forest["failures_low"], forest["failures_high"]) == (6, 4, 8)
    assert (
        forest["failures_ratio"]
        == forest["failures_ratio_low"]
        == forest["failures_ratio_high"]
        == 2
    )
    assert forest["a12"] == 0.875  # One tie of four pairs.
    assert forest["of_ceiling"] == 1 and forest["ms"] == pytest.approx(10)
    assert forest["f"] == 1 and forest["cost"] == 1  # Both need n tests for n failures.


def test_duels_by_hand() -> None:
    two = [
        rows("forest", [6, 12], world) + rows("network", [2, 4], world)
        for world in ("F1-trees", "F1-network-rare")
    ]
    longer = [
        {**row, **{key.replace("120", "300"): value for key, value in row.items()}, "tests": 300}
        for pair in two
        for row in pair
    ]
    lines = duels.markdown(duels.ratios(longer)).splitlines()
    assert lines[2].startswith(
        "| as recorded | 300 | 3.00 (3.00–3.00) | 1.00 (1.00–1.00) |"
    ) and lines[2].endswith("| – | – |")
    assert lines[3].startswith("| 1.5 % fail | 300 | 3.00 (3.00–3.00) |") and len(lines) == 4


def test_the_ablation_divides_by_the_default() -> None:
    many = [*rows("forest", [6, 12]), *rows("forest kinds=0", [3, 6])]
    longer = [
        {**row, **{key.replace("120", "300"): value for key, value in row.items()}, "tests": 300}
        for row in many
    ]
    head, _, *table = ablation.markdown(longer).split("\n")
    assert head == "| failures, × `forest` | as recorded, 300 |"
    assert "| no slots for kinds | 0.50 (0.50–0.50) |" in table and "| no trees | – |" in table


def test_the_slow_peer_is_compared_where_it_was_run() -> None:
    slow = rows("verifai-bayesian", [6, 12])
    head, _, _, _, *table = bayesian.markdown(
        slow, [*rows("random", [2, 4, 90]), *rows("forest", [8, 16, 90])]
    ).split("\n")
    assert head == "`verifai-bayesian` itself takes 10 CPU-ms a test. After 120 tests:"
    assert table[0].startswith("| as recorded | random | 2 | 3.0 | 1.00 (1.00–1.00) |")
    assert (
        table[3].startswith("| as recorded | verifai-bayesian | 2 | 9.0 | 3.00 (3.00–3.00) | 2.0 |")
        and "| 10.0 % |" in table[3]
    )
    assert table[4].startswith("| as recorded | forest | 2 | 12.0 | 4.00 (4.00–4.00) |")


def test_new_kinds_are_counted_for_each_failure() -> None:
    *_, row = bayesian.of_kinds(rows("forest kinds=1", [8, 12]), 120).split("\n")
    assert row == "| forest kinds=1 | 2 | 10.0 | 2.0 | 0.20 | 10.0 % |"


def test_a_campaign_without_failure_is_censored() -> None:
    (block,) = blocks([*rows("random", [3, 3]), *rows("forest", [0, 0])])
    forest = standings(block, "random").set_index("strategy").loc["forest"]
    assert (forest["f"], forest["f_censored"], forest["cost_censored"]) == (120, 2, 2)
    text = markdown(block, standings(block, "random"), "random")
    assert "≥ 120" in text and "Worlds: F1-trees. Seeds: 2." in text


def test_the_figure_has_a_panel_for_each_group() -> None:
    many = [*rows("random", [2, 4]), *rows("random", [1, 2], "F1-network")]
    drawn = {
        (block.group, 300): standings(Block(block.group, 300, block.rows), "random")
        for block in blocks(many)
    }
    assert [axis.get_title(loc="left") for axis in failures_against_kinds(drawn).axes] == [
        "trees",
        "network",
    ]


def test_the_default_car_is_used(analytic: AnalyticWorld) -> None:
    assert (
        isinstance(worlds.default_study().car, Car)
        and functional_scenario("F1").logical_space() == analytic.space
    )


def test_the_answer_names_what_fell_short() -> None:
    found = {
        (duels.FAILURES, duels.RECORDED, 300): duels.Ratio(1.6, 1.5, 1.7),
        (duels.KINDS, duels.RECORDED, 300): duels.Ratio(1.0, 0.9, 1.1),
    }
    head, _, *table = duels.answer(found).split("\n")
    short = "kinds, forest / network after 300 tests, as recorded: 1.00 instead of 1.3"
    assert head == f"**What fell short:** {short}. 1 of 2 expectations hold."
    assert (
        "| failures, forest / network | as recorded | 300 | 1.5 | 1.60 (1.50–1.70) | yes |" in table
    )
    assert sum(line.endswith("not run |") for line in table) == len(duels.EXPECTED) - 2
