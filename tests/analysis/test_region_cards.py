"""Cards of failure regions: every number, picture and bar is the artefact's."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from pipeline.artefacts.dataset import decode_jpeg
from pipeline.artefacts.failure_counts import Count
from pipeline.artefacts.region_results import Confirmation, FailureRegions, Fresh, Repair, Seen, Why
from pipeline.artefacts.results import Estimate, read
from pipeline.artefacts.tables import read_frames, read_tests
from pipeline.report.kept_frames import KeptFrames
from pipeline.report.page import Box, Card, Page, Passage, Section, render
from pipeline.report.region_cards import PICTURES, Shown, cards, ends, pictured
from tests.analysis.fabricated import TRUTH, FabricatedStudy

RATE = Estimate(value=0.75, low=0.194, high=0.994)
SEEN = Seen(
    failures=9,
    in_sight=8,
    detected=4,
    first_sight_m=None,
    first_sight_pixels=None,
    first_sight_contrast=None,
    last_chance_pixels=None,
    last_chance_contrast=None,
    first_detection_m=None,
    delay_s=None,
)


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> FabricatedStudy:
    return FabricatedStudy(tmp_path_factory.mktemp("study")).make_analysed()


@pytest.fixture(scope="module")
def tables(study: FabricatedStudy) -> list[Path]:
    return [
        path.with_name("frames.parquet") for path in study.search_tests if path.parts[-5] == "F1"
    ]


@pytest.fixture(scope="module")
def frames(tables: list[Path]) -> KeptFrames:
    return KeptFrames(tables)


@pytest.fixture(scope="module")
def rows(tables: list[Path]) -> pd.DataFrame:
    return pd.concat(
        [read_tests(path.with_name("tests.parquet")) for path in tables], ignore_index=True
    )


@pytest.fixture(scope="module")
def regions(study: FabricatedStudy) -> FailureRegions:
    """The first region confirmed and explained, the last one dissolved into isolated failures."""
    drawn = read(study.regions[0], FailureRegions)
    first, *others, last = drawn.regions
    repair = Repair(
        change="no fog", values={"fog": 0.0}, without=(), tests=4, repaired=3, errors=1, rate=RATE
    )
    control = repair.model_copy(
        update={"change": "other noise", "repaired": 0, "rate": None, "errors": 0}
    )
    explained = first.model_copy(
        update={
            "status": "confirmed",
            "confirmation": Confirmation(
                confidence=0.95,
                inside=Fresh(tests=4, failures=3, errors=2, rate=RATE),
                outside=Fresh(tests=6, failures=0, errors=0, rate=None),
                p_value=0.033,
            ),
            "why": Why(
                sentence="People in <fog> fail.",
                seen=SEEN,
                confidence=0.95,
                repairs=(repair,),
                control=control,
            ),
            "held_back": Count(tests=8, failures=6),
        }
    )
    return drawn.model_copy(update={"regions": (explained, *others), "isolated": last.members})


@pytest.fixture(scope="module")
def drawn(regions: FailureRegions, frames: KeptFrames, rows: pd.DataFrame) -> tuple[Card, ...]:
    tests = pictured(regions, frames)
    return cards(
        regions,
        tests,
        Shown(frames.moments({t for some in tests.values() for t in some}), ends(rows), {}, 0.5),
    )


def test_every_number_on_a_card_is_the_artefacts(
    regions: FailureRegions, drawn: tuple[Card, ...]
) -> None:
    for card, region in zip(drawn, regions.regions, strict=False):
        facts = dict(card.facts)
        assert (card.name, card.tag, card.rule, card.members) == (
            region.name,
            region.status,
            region.rule,
            len(region.members),
        )
        assert (
            facts["failures"]
            == str(len(region.members))
            == str(sum(region.strategies.values()))
            == str(region.modes.total)
        )
        inside = (
            f"{region.failures_inside} / {region.support} = "
            f"{100 * region.failures_inside / region.support:.1f} %"
        )
        assert facts["failures inside the rule"] == inside and facts["lift"] == f"{region.lift:.1f}"
        assert facts["covered by the rule"] == f"{100 * region.recall:.1f} %"
        assert facts["found by"] == ", ".join(
            f"{count} {name}" for name, count in region.strategies.items()
        )
        assert int(facts.get("not solvable with this camera", "0")) == len(
            set(region.members) & set(regions.not_solvable)
        )
    first = dict(drawn[0].facts)
    assert first["held back"] == "6 / 8 = 75.0 %"
    assert first["fresh tests inside"] == "3 / 4 = 75.0 % (19.4 to 99.4); errors: 2"
    assert (first["fresh tests just outside"], first["p, Fisher's exact test"]) == (
        "0 / 6",
        "0.033",
    )
    assert dict(drawn[1].facts)["fresh tests"] == "not executed"


def test_bars_are_the_repairs_with_the_control_last(drawn: tuple[Card, ...]) -> None:
    assert [(bar.label, bar.value, bar.most, bar.text) for bar in drawn[0].bars] == [
        ("no fog", 3, 4, "3 / 4 = 75.0 % (19.4 to 99.4); errors: 1"),
        ("other noise", 0, 4, "0 / 4"),
    ]


def test_isolated_failures_have_a_card_beside(
    regions: FailureRegions, drawn: tuple[Card, ...]
) -> None:
    last = drawn[-1]
    assert (last.name, last.members, last.rule) == ("F1 isolated", len(regions.isolated), "")
    assert last.test in regions.isolated
    assert last.text == (
        "Failures in no region. Some may lie inside the rule of a region whose failures have "
        "another cause."
    )
    none = regions.model_copy(update={"isolated": ()})
    assert "F1 isolated" not in [
        card.name for card in cards(none, pictured(none, KeptFrames([])), Shown({}, {}, {}, 0.5))
    ]


def test_pictures_are_kept_frames_of_its_failures(
    regions: FailureRegions, drawn: tuple[Card, ...], tables: list[Path], rows: pd.DataFrame
) -> None:
    kept = pd.concat(map(read_frames, tables))
    outcomes = rows.set_index("test_id")
    assert any(card.pictures for card in drawn)
    for card, region in zip(drawn, regions.regions, strict=False):
        tests = [picture.test_id for picture in card.pictures]
        assert set(tests) == set(
            list(dict.fromkeys(t for t in region.members if t in set(kept["test_id"])))[:PICTURES]
        )
        assert bool(card.fewer) == (len(tests) < min(PICTURES, card.members))
        for picture in card.pictures:
            image = decode_jpeg(kept[kept["test_id"] == picture.test_id].iloc[0]["image"])
            assert picture.size == image.shape[1::-1]
            assert picture.boxes[0] == Box(*TRUTH, kind="truth")
            assert [(box.kind, box.label) for box in picture.boxes[1:]] == [
                ("unreported", "0.30"),
                ("reported", "0.90"),
            ]
            assert (
                f"adj. TTC {outcomes.loc[picture.test_id, 'adj_ttc_s']:.2f} s" in picture.words
                and "reported detections: 1, best" in picture.words
            )


def test_a_card_without_frames_says_so(regions: FailureRegions) -> None:
    nothing = KeptFrames([])
    card = cards(regions, pictured(regions, nothing), Shown({}, {}, {}, 0.5))[0]
    assert card.pictures == () and card.fewer == "No frames of its failures were kept."
    assert card.test in regions.regions[0].members


def test_the_page_shows_a_card_and_the_command_of_a_failure(drawn: tuple[Card, ...]) -> None:
    text = render(
        Page("smoke", "headline", (Section("Failure regions", (), (Passage("F1", cards=drawn),)),))
    ).replace("\u00a0", " ")
    assert "People in &lt;fog&gt; fail." in text and text.count("<article") == len(drawn)
    for card in drawn:
        assert (
            f'data-region="{card.name}"' in text
            and f"<code>python -m pipeline replay {card.test}</code>" in text
        )
        for name, value in card.facts:
            assert (
                f"<dt>{name.replace(chr(39), '&#39;')}</dt><dd>{value.replace('<', '&lt;')}</dd>"
                in text
            )
    assert '<meter min="0" max="4" value="3" aria-label="no fog">' in text
    assert text.count("<rect class=") == sum(
        len(picture.boxes) for card in drawn for picture in card.pictures
    )
