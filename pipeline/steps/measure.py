"""Step `measure`: measures each search campaign: failures, F-, F_n- and C_n-measure, coverage (thesis section 4.3)."""

from __future__ import annotations

from pipeline.artefacts.files import write_bytes
from pipeline.artefacts.results import write
from pipeline.artefacts.scenario_space import read_space
from pipeline.artefacts.search_results import Measures
from pipeline.artefacts.tables import campaign_of, read_tests
from pipeline.contract import Job, Step

STEP = Step(
    "Measure the search campaigns.",
    reads=lambda folders, wildcards: {
        "spaces": folders.spaces(folders.config.search),
        "tests": folders.searches("tests.parquet"),
    },
    writes=lambda folders: {"measures": f"{folders.root}/measures.json", "theta": f"{folders.root}/theta.csv"},
    sections=lambda config, wildcards: ("strategies", "comparison.confidence", *(f"samplers.{name}" for name in config.strategies)),
)


def run(job: Job) -> None:
    """Measure the campaigns and write measures.json and, for plots, theta.csv; the first strategy of the config is the baseline of C_n.

    Raises InputError for a campaign without its space or its baseline of the same seed.
    """
    from pipeline.analysis.measures import PROJECTION_K, by_strategy, measure_campaign, summarise, theta_table
    from pipeline.config.components import independent_strategies

    baseline, confidence = job.config.strategies[0], job.config.comparison.confidence
    known = [read_space(path) for path in job.inputs("spaces")]
    spaces = {info.name: space for info, space in known}
    tables = {}
    for path in job.inputs("tests"):
        table = read_tests(path).sort_values("index")
        tables[campaign_of(table, path)] = table
    measured = []
    for done, campaign in enumerate(tables, 1):
        measured.append(measure_campaign(campaign, tables, spaces, baseline))
        job.progress(done, len(tables), str(campaign))
    independent = independent_strategies(job.config.samplers)
    groups = tuple(summarise(group, confidence, baseline, independent) for group in by_strategy(measured))
    measures = Measures(
        confidence=confidence,
        k=PROJECTION_K,
        baseline=baseline,
        campaigns=tuple(measured),
        strategies=groups,
        no_braking=tuple(info.name for info, _ in known if not info.asks_to_brake),
    )
    write(job.output("measures"), measures)
    write_bytes(job.output("theta"), theta_table(measured).to_csv(index=False, lineterminator="\n").encode())
