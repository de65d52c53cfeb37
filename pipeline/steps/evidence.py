"""Step `evidence`: what a study shows about a detector, for a safety case.

It writes evidence/<version>.json and the same as a page to print.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.artefacts.files import sha256, write_bytes
from pipeline.artefacts.folders import Folders
from pipeline.artefacts.region_results import FailureRegions
from pipeline.artefacts.results import read, write
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.tables import read_all_tests
from pipeline.config.schema import AUDIT, Config
from pipeline.contract import Files, Job, Step, Wildcards

if TYPE_CHECKING:
    from pipeline.analysis.evidence import Judged
    from pipeline.artefacts.evidence import ModelIdentity


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    config, version = folders.config, wildcards["version"]
    return {
        "spaces": folders.spaces(config.search),
        "regions": [folders.regions(version, scenario) for scenario in config.search],
        "tests": [*folders.search("tests.parquet", version=version), *folders.audit(version)],
        "detector": folders.detector(version),
        "card": [folders.model(version, "model.json")] if folders.cards else [],
    }


def _sections(config: Config, wildcards: Wildcards) -> tuple[str, ...]:
    strategies = [*config.strategies, *([AUDIT] if config.audited else [])]
    samplers = [f"samplers.{name}" for name in strategies]
    threshold = "campaign.failure_threshold_s"
    return ("study", "goal", "search", "exposure", "regions", threshold, *samplers)


STEP = Step(
    "Write what the study shows about a detector, for a safety case.",
    reads=_reads,
    writes=lambda folders: {
        name: f"{folders.root}/evidence/{{version}}.{name}" for name in ("json", "html")
    },
    sections=_sections,
)


def run(job: Job) -> None:
    """Write the evidence as JSON and as a page."""
    from pipeline.analysis.evidence import scenario_evidence, whole
    from pipeline.analysis.evidence_texts import assumptions, claim, limits
    from pipeline.artefacts.evidence import Evidence
    from pipeline.core.likelihood.rate import CONFIDENCE
    from pipeline.report.evidence_page import evidence_page
    from pipeline.report.page import render

    config, version, exposure = job.config, job.wildcards["version"], job.config.exposure
    searches = _judged(job)
    scenarios, together = tuple(map(scenario_evidence, searches)), whole(searches, exposure)
    settings = json.dumps(config.model_dump(mode="json", exclude_unset=True), sort_keys=True)
    evidence = Evidence(
        study=config.study,
        claim=claim(version, scenarios, together, exposure),
        confidence=CONFIDENCE,
        exposure=exposure.model_dump(mode="json"),
        scenarios=scenarios,
        whole=together,
        model=_identity(job),
        settings_sha256=hashlib.sha256(settings.encode()).hexdigest(),
        files=job.digests(),
        assumptions=assumptions(config.campaign.failure_threshold_s),
        limits=limits(together, exposure, config.goal == "report"),
    )
    write(job.output("json"), evidence)
    write_bytes(job.output("html"), render(evidence_page(evidence)).encode())


def _judged(job: Job) -> list[Judged]:
    """The search of each scenario, judged under the exposure."""
    from pipeline.analysis.evidence import Searched, judged

    rows = read_all_tests(job.inputs("tests"))
    independent = frozenset(filter(job.config.independent, job.config.samplers))
    searches = []
    files = zip(job.inputs("spaces"), job.inputs("regions"), strict=True)
    for done, (space_file, regions_file) in enumerate(files, 1):
        info, space = read_space(space_file)
        tests = rows[rows["scenario"] == info.name]
        regions = read(regions_file, FailureRegions)
        searched = Searched(info, space, tests, regions, independent)
        searches.append(judged(searched, job.config.regions, job.config.exposure))
        job.progress(done, len(job.config.search), info.name)
    return searches


def _identity(job: Job) -> ModelIdentity:
    """The detector's version, file and digests."""
    from pipeline.artefacts.evidence import ModelIdentity
    from pipeline.artefacts.model_card import read_card

    file: Path = job.input("detector")
    cards = [read_card(path) for path in job.inputs("card")]
    return ModelIdentity(
        version=job.wildcards["version"],
        file=file.as_posix(),
        sha256=sha256(file),
        weights_sha256=cards[0].weights_sha256 if cards else None,
        data=cards[0].data if cards else {},
    )
