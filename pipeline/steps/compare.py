"""Step `compare`: compares all model versions on the same frozen held-out sequence.

They are paired test by test, as in section 7.3 of the thesis.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

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
    keys = (
        "comparison.alpha",
        "comparison.confidence",
        "comparison.margin",
        "regions",
        "tested",
        "campaign.failure_threshold_s",
        "campaign.match_iou",
        "comparison.second_iou",
    )
    return keys if config.tested else (*keys, "base_set.rare")


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    config = folders.config
    files: dict[str, Files] = {
        "spaces": folders.spaces(config.held_out),
        "tests": folders.held_out("tests.parquet"),
        "second_iou": folders.second_iou,
        "models": folders.cards,
        "measures": f"{folders.root}/measures.json",
    }
    if not config.tested:
        files["searched"] = folders.search("tests.parquet")
        files["searched_spaces"] = folders.spaces(config.search)
        files["regions"] = [folders.regions("base", scenario) for scenario in config.search]
    return files


STEP = Step(
    "Compare all model versions on the held-out sequence.",
    reads=_reads,
    writes=lambda folders: {**folders.compared, "metrics": f"{folders.root}/metrics/"},
    sections=_sections,
)


def run(job: Job) -> None:
    """Write the comparison, all tests of the versions, the changed tests, and DVC's metrics.

    The order of the cards, or of detectors that a study only tests, is the order of the versions.

    Raises:
        InputError: the versions did not execute the same points in the same order, or one has no
            campaign, was judged at another threshold than the config's, or was trained on a
            held-out town or on held-out people.
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
    spaces = read_spaces(job.inputs("spaces"))
    infos = {name: info for name, (info, _) in spaces.items()}
    cards = [read_card(path) for path in job.inputs("models")]
    refuse_learnt(cards, list(infos.values()))
    versions = [card.version for card in cards] or list(config.tested)
    threshold_s = config.campaign.failure_threshold_s
    held_out = read_held_out(job.inputs("tests"), versions, infos, threshold_s, job.progress)
    digest = held_out.digest({name: space.names for name, (_, space) in spaces.items()})
    regions = base_regions(held_out, spaces, config.regions)
    measures = read(job.input("measures"), Measures)
    first = next(space for _, space in spaces.values())
    policy = Policy(settings.alpha, settings.confidence, settings.margin)
    groups = named_groups(first, encode_tests(held_out.rows(versions[0]), first))
    result = compare(held_out, groups, digest, regions, policy, config.version)
    updates: dict[str, Any] = {"base_rates": measures.base_rates}
    if settings.second_iou:
        again = read_held_out(job.inputs("second_iou"), versions, infos, threshold_s, job.progress)
        ious = settings.second_iou, config.campaign.match_iou
        updates["second"] = compared_again(again, *ious, policy, config.version)
    if cards:
        learnt = cards[0].frequencies
        updates["trained_on"] = learnt
        updates["base_set"] = Frequencies(**config.base_set.rare.model_dump())
        updates["planted"] = ()
        if learnt is not None:
            updates["planted"] = tuple(planted_groups(learnt, _searched(job), held_out, groups))
    result = result.model_copy(update=updates)
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
    described = read_spaces(job.inputs("searched_spaces"))
    spaces = {name: space for name, (_, space) in described.items()}
    regions = [read(path, FailureRegions) for path in job.inputs("regions")]
    return Searched(rows[is_valid(rows)], spaces, regions)
