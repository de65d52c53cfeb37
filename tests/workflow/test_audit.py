"""The audit: random tests beside searches, for failure rates without bias.

No search sees them, and no adaptive test is one of them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.__main__ import main
from pipeline.analysis.measures import audited
from pipeline.artefacts.results import read
from pipeline.artefacts.search_results import BaseRate, Measures
from pipeline.artefacts.tables import read_tests
from pipeline.config.composing import compose
from pipeline.core.identity import CampaignId
from pipeline.core.rules import Condition, Rule
from pipeline.core.samplers.random import RandomSampler
from pipeline.errors import InputError
from pipeline.execution.campaign import sampler_seed
from pipeline.workflow.jobs import Jobs, step_names
from pipeline.workflow.stamping import Stamps
from tests.campaigns import MODEL, OVERRIDES, folder, key, same
from tests.planted import ALTITUDE, FOG, SPACE, World
from tests.studies import StudyFolder

KIND = "campaigns/audit"
ADAPTIVE = ["strategies=[mixed]", "arms.random=mixed"]
"""A study whose only search learns from its results."""
WORLD = World((Rule((Condition(FOG, 40, 100), Condition(ALTITUDE, -20, 35))),))
TRUE = 0.6 * 0.5
"""The share of the space in which the world fails."""


def studied(root: Path, *overrides: str) -> StudyFolder:
    """A study of F1 on the analytic simulator, before its first test."""
    study = StudyFolder.composed(
        root, "smoke", [*OVERRIDES, "search=[F1]", "seeds=[3]", *overrides]
    )
    assert study.run("define-space", scenario="F1") == 0
    (study / MODEL).parent.mkdir(parents=True)
    (study / MODEL).write_bytes(b"the oracle needs none")
    return study


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> StudyFolder:
    """An adaptive search with its audit, measured."""
    study = studied(tmp_path_factory.mktemp("audited"), *ADAPTIVE, "campaign.audit=15")
    assert study.run("campaign", **key()) == 0
    assert study.run("campaign", **key("random", kind=KIND)) == 0
    assert study.run("measure") == 0
    return study


def test_a_search_proposes_the_same_tests_with_and_without_an_audit(
    study: StudyFolder, tmp_path: Path
) -> None:
    alone = studied(tmp_path, *ADAPTIVE, "campaign.audit=0")
    assert alone.run("campaign", **key()) == 0
    assert same(folder(alone), folder(study))
    jobs = (
        Jobs(compose("smoke", [*OVERRIDES, *ADAPTIVE, f"campaign.audit={tests}"]), step_names())
        for tests in (0, 15)
    )
    wildcards = {name: str(value) for name, value in key().items()}
    first, second = (Stamps(planned).stamp("campaign", wildcards) for planned in jobs)
    assert first == second


def test_only_random_tests_enter_the_rate(study: StudyFolder) -> None:
    tests = read_tests(folder(study, "random", kind=KIND) / "tests.parquet")
    assert set(tests["strategy"]) == {"random"} and len(tests) == 15
    measures = read(study / "measures.json", Measures)
    (rate,) = measures.audit
    assert (rate.scenario, rate.strategy, rate.version, rate.tests) == ("F1", "random", "base", 15)
    assert rate.failures == int(tests["failure"].sum()) and measures.base_rates == measures.audit
    assert [row.strategy for row in measures.strategies] == ["mixed"] and measures.strategies[
        0
    ].tests == 24


def test_likelihood_weighs_the_audit_and_refuses_the_search(
    study: StudyFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["likelihood", "exposure=uniform", "--from", str(study / KIND)]) == 0
    assert "under this exposure, 15 uniform tests are worth 15" in capsys.readouterr().out
    assert main(["likelihood", "exposure=uniform", "--from", str(study / "campaigns")]) == 2
    assert "expected tests of strategy 'random', got 'mixed'" in capsys.readouterr().err


def counted(repeat: int) -> BaseRate:
    """The audit of 400 tests of the planted world, drawn as a campaign draws them."""
    campaign = CampaignId("F1", "random", "base", repeat)
    points = RandomSampler(SPACE, sampler_seed(campaign), batch_size=400).ask()
    table = pd.DataFrame({"failure": WORLD.fails(points), "status": "ok"})
    (rate,) = audited({campaign: table}, 0.95)
    return rate


def test_the_interval_holds_the_planted_rate_as_often_as_it_says() -> None:
    rates = [counted(repeat).rate for repeat in range(400)]
    inside = np.mean([rate.low <= TRUE <= rate.high for rate in rates])
    assert 0.93 <= inside <= 0.97
    assert np.mean([rate.value for rate in rates]) == pytest.approx(TRUE, abs=0.005)


def test_errors_are_in_no_rate_and_seeds_are_pooled() -> None:
    rows = [
        pd.DataFrame({"failure": [True, False, False], "status": ["ok", "ok", "error"]})
        for _ in range(2)
    ]
    (rate,) = audited(
        {CampaignId("F1", "random", "base", seed): table for seed, table in enumerate(rows)}, 0.95
    )
    assert (rate.tests, rate.failures, rate.rate.value) == (4, 2, 0.5)
    assert (rate.rate.low, rate.rate.high) == pytest.approx(
        (0.0676, 0.9324), abs=1e-4
    )  # Clopper-Pearson's of 2 of 4.


def test_an_audit_that_is_not_random_is_refused() -> None:
    words = [*ADAPTIVE, "samplers.random._target_=pipeline.core.samplers.pairwise.PairwiseSampler"]
    with pytest.raises(
        InputError,
        match=r"samplers\.random: the audit needs a class whose tests are independent; or set "
        r"campaign\.audit=0",
    ):
        compose("smoke", words)
