"""Step `compare`: every model version on the same frozen held-out sequence (thesis section 7.3), paired test by test."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pipeline.artefacts.comparison_results import write_changes
from pipeline.artefacts.files import write_json
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.model_card import Frequencies, read_card
from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.results import read, write
from pipeline.artefacts.scenario_space import read_spaces
from pipeline.artefacts.search_results import Measures
from pipeline.artefacts.stamps import remove
from pipeline.artefacts.tables import is_valid, read_all_tests, write_tests
from pipeline.config.schema import Config
from pipeline.contract import Files, Job, Step, Wildcards

if TYPE_CHECKING:
    from pipeline.analysis.planted import Searched


def _sections(config: Config, wildcards: Wildcards) -> tuple[str, ...]:
    """A study that only tests detectors has no base set."""
    judged = ("campaign.failure_threshold_s", "campaign.match_iou", "comparison.second_iou")
    own = (
        "comparison.alpha",
        "comparison.confidence",
        "comparison.margin",
        "regions",
        "tested",
        *judged,
    )
    return own if config.tested else (*own, "base_set.rare")


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    config = folders.config
    files: dict[str, Files] = {
        "spaces": folders.spaces(config.held_out),
        "tests": folders.held_out("tests.parquet"),
        "second_iou": folders.second_iou,
        "models": folders.cards,
        "measures": f"{folders.root}/measures.json",
    }
    if config.tested:
        return files
    searched = {
        "searched": folders.search("tests.parquet"),
        "searched_spaces": folders.spaces(config.search),
    }
    return (
        files
        | searched
        | {"regions": [folders.regions("base", scenario) for scenario in config.search]}
    )


STEP = Step(
    "Compare all model versions on the held-out sequence.",
    reads=_reads,
    writes=lambda folders: {**folders.compared, "metrics": f"{folders.root}/metrics/"},
    sections=_sections,
)


def run(job: Job) -> None:
    """Compare the versions and write the comparison, all their tests, the changed tests, and the metrics for DVC.

    The order of the cards, or of detectors that a study only tests, is the order of the versions.

    Raises InputError if the versions did not execute the same points in the same order, or if one has no campaign, was judged at another
    threshold than the config's, or was trained on a held-out town or on held-out people.
    """
    from pipeline.analysis.comparison import (
        base_regions,
        changed_tests,
        compare,
        compared_again,
        shown_metrics,
    )
    from pipeline.analysis.held_out import read_held_out
    from pipeline.analysis.named_groups import named_groups
    from pipeline.analysis.planted import planted_groups
    from pipeline.artefacts.points import encode_tests
    from pipeline.core.gate import Policy
    from pipeline.learning.leakage import refuse_learnt

    config, settings = job.config, job.config.comparison
    known = read_spaces(job.inputs("spaces"))
    infos = {name: info for name, (info, _) in known.items()}
    cards = [read_card(path) for path in job.inputs("models")]
    refuse_learnt(cards, [info for info, _ in known.values()])
    versions, threshold_s = (
        [card.version for card in cards] or list(config.tested),
        config.campaign.failure_threshold_s,
    )
    held_out = read_held_out(job.inputs("tests"), versions, infos, threshold_s, job.progress)
    digest = held_out.digest({name: space.names for name, (_, space) in known.items()})
    regions = base_regions(held_out, known, config.regions)
    measures = read(job.input("measures"), Measures)
    first, policy = (
        next(space for _, space in known.values()),
        Policy(settings.alpha, settings.confidence, settings.margin),
    )
    named = named_groups(first, encode_tests(held_out.rows(versions[0]), first))
    result = compare(held_out, named, digest, regions, policy, config.version).model_copy(
        update={"base_rates": measures.base_rates}
    )
    if settings.second_iou:
        again = read_held_out(job.inputs("second_iou"), versions, infos, threshold_s, job.progress)
        ious = settings.second_iou, config.campaign.match_iou
        result = result.model_copy(
            update={"second": compared_again(again, *ious, policy, config.version)}
        )
    if cards:
        shown, learnt = Frequencies(**config.base_set.rare.model_dump()), cards[0].frequencies
        planted = (
            () if learnt is None else tuple(planted_groups(learnt, _searched(job), held_out, named))
        )
        result = result.model_copy(
            update={"trained_on": learnt, "base_set": shown, "planted": planted}
        )
    write(job.output("comparison"), result)
    write_tests(job.output("table"), held_out.joined, first)
    write_changes(job.output("changes"), changed_tests(result, held_out.joined, first.names))
    detection = {card.version: card.metrics for card in cards}
    remove(job.output("metrics"))
    for name, row in shown_metrics(result, measures, detection).items():
        write_json(job.output("metrics") / name, row)


def _searched(job: Job) -> Searched:
    """The searches of the base."""
    from pipeline.analysis.planted import Searched

    rows = read_all_tests(job.inputs("searched"))
    spaces = {
        name: space for name, (_, space) in read_spaces(job.inputs("searched_spaces")).items()
    }
    return Searched(
        rows[is_valid(rows)], spaces, [read(path, FailureRegions) for path in job.inputs("regions")]
    )
