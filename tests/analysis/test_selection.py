"""Which kept frames are added to training."""

from __future__ import annotations

import numpy as np
import pandas as pd

from pipeline.artefacts.points import concrete
from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.config.sections import Regions
from pipeline.learning import selection
from tests.spaces import SMALL

ROWS = pd.DataFrame(
    {
        "test_id": [f"F-a-base-0-{i:05d}" for i in range(40) for _ in range(4)],
        "step": [0, 2, 4, 6] * 40,
        "kept": [True, True, True, False] * 40,
        "visible_pixels": [0, 50, 90, 90] * 40,
        "confidence": [0.0, 0.5, 0.99, 0.0] * 40,
    }
)
TESTS = pd.DataFrame(
    {
        "test_id": ROWS["test_id"].unique(),
        "status": "ok",
        "failure": np.arange(40) < 12,
        "scenario": "F",
    }
)
SCENARIOS = dict.fromkeys(TESTS["test_id"], "F")


def test_all_and_failures() -> None:
    section = Regions(chance_neighbours=0.5, min_failures=4, confirm=0, explain=0)
    assert len(selection.groups("all", TESTS, {}, section)) == 40
    assert list(selection.groups("failures", TESTS, {}, section)) == list(TESTS["test_id"][:12])


def test_a_share_is_empty_and_both_sources_have_enough_frames() -> None:
    rows = selection.pool(ROWS, dict.fromkeys(TESTS["test_id"][:12], ""), SCENARIOS)
    assert (len(rows), int(rows["empty"].sum())) == (36, 12)
    assert selection.capacity(rows, 0.25) == 32 and selection.capacity(rows, 0.5) == 24
    drawn = selection.draw(rows, 32, 0.25, seed=0)
    assert len(drawn) == 32 and (drawn["step"] == 0).sum() == 8 and (drawn["scenario"] == "F").all()
    assert drawn.equals(selection.draw(rows, 32, 0.25, seed=0)) and not drawn.equals(
        selection.draw(rows, 30, 0.25, seed=0)
    )
    assert not drawn.duplicated().any()


def test_unsure_and_missed_frames_are_drawn_more_often() -> None:
    everything = dict.fromkeys(TESTS["test_id"], "")
    unsure = selection.draw(selection.pool(ROWS, everything, SCENARIOS, "unsure"), 40, 0.25, seed=0)
    # Of the 30 frames with a pedestrian: step 2 has confidence 0.5 (weight 1.05), step 4 0.99
    # (weight 0.09).
    assert (unsure["step"] == 0).sum() == 10 and (unsure["step"] == 2).sum() > 22
    rows = ROWS.assign(confidence=ROWS["step"].map({0: 0.0, 2: 0.0, 4: 0.5, 6: 0.0}))
    missed = selection.pool(rows, everything, SCENARIOS, "missed").groupby("step")["weight"].first()
    assert np.isclose(missed[2], 0.05 + np.log(20)) and np.isclose(missed[4], 0.05 + np.log(2))


def test_causes_are_groups_and_so_are_passing_tests() -> None:
    tests = TESTS.assign(cause=["box"] * 4 + ["never_seen"] * 8 + ["none"] * 28)
    groups = selection.groups(
        "causes", tests, {}, Regions(chance_neighbours=0.5, min_failures=4, confirm=0, explain=0)
    )
    drawn = selection.draw(selection.pool(ROWS, groups, SCENARIOS, "causes"), 32, 0.25, seed=0)
    # 24 frames with a pedestrian, 8 a group; "box" has just 8.
    assert drawn[drawn["step"] > 0]["test_id"].map(groups).value_counts().to_dict() == {
        "box": 8,
        "never_seen": 8,
        "none": 8,
    }


def test_small_groups_give_all_frames_and_large_groups_the_rest() -> None:
    grouped = {test: "small" if i < 2 else "large" for i, test in enumerate(TESTS["test_id"][:20])}
    rows = selection.pool(ROWS, grouped, SCENARIOS)
    drawn = selection.draw(rows, 24, 0.25, seed=3)
    shown = drawn[drawn["step"] > 0]["test_id"].map(grouped).value_counts()
    assert (shown["small"], shown["large"]) == (4, 14)
    assert (
        selection.draw(rows, 8, 0.25, seed=3)["test_id"].map(grouped).value_counts()["small"] >= 3
    )


def test_regions_are_groups_and_failures_outside_are_another() -> None:
    rng = np.random.default_rng(0)
    points = SMALL.sample(300, rng)
    centre = points[0]
    points[:40] = centre
    rows = pd.DataFrame([SMALL.decode(point) for point in points])
    failed = (np.arange(300) < 40) | (np.arange(300) % 60 == 59)
    tests = rows.assign(
        test_id=[f"F-a-base-0-{i:05d}" for i in range(300)],
        status="ok",
        failure=failed,
        scenario="F",
        strategy="a",
        seed=0,
        failure_mode=np.where(failed, "contact", "none"),
        cause="box",
        adj_ttc_s=np.where(failed, 0.0, 1.0),
        impact_speed_mps=0.0,
    )
    assert concrete(tests.iloc[0], SMALL) == SMALL.decode(centre)
    info = ScenarioInfo("F", "F", "", 100)
    region_of = selection.groups(
        "regions",
        tests,
        {"F": (info, SMALL)},
        Regions(chance_neighbours=0.5, min_failures=4, confirm=0, explain=0),
    )
    assert len(region_of) == failed.sum()
    assert {region_of[f"F-a-base-0-{i:05d}"] for i in range(40)} == {"F region 1"}
    assert "F, isolated" in region_of.values()


def test_the_share_of_empty_frames_is_rounded_to_the_nearest_number() -> None:
    rows = selection.pool(ROWS, dict.fromkeys(TESTS["test_id"], ""), SCENARIOS)
    assert [
        int(selection.draw(rows, count, 0.25, seed=0)["empty"].sum()) for count in (30, 31, 33)
    ] == [8, 8, 8]


def test_a_frame_that_the_filter_rejects_is_in_no_pool() -> None:
    assert set(selection.pool(ROWS, dict.fromkeys(TESTS["test_id"], ""), SCENARIOS)["step"]) == {
        0,
        2,
        4,
    }
