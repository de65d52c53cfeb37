"""The comparison of model versions: from held-out tests to comparison.json and changes.csv."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
import pandas as pd

from pipeline.analysis.failure_regions import find_regions
from pipeline.analysis.gate import gate_reason, parts_of
from pipeline.analysis.held_out import HeldOut
from pipeline.analysis.measures import (
    count_causes,
    count_false_activations,
    count_modes,
    series_name,
)
from pipeline.artefacts.comparison_results import (
    Comparison,
    GroupPair,
    GroupResult,
    LimitResult,
    RegionResult,
    ScenarioResult,
    SecondIou,
    VersionPair,
    VersionResult,
)
from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.results import Estimate
from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.artefacts.search_results import Measures
from pipeline.artefacts.tables import is_valid
from pipeline.config.sections import Regions
from pipeline.core import comparison as core
from pipeline.core.comparison import Bools, Interval, SequenceOutcomes
from pipeline.core.gate import Gate, Policy, champion, gate
from pipeline.core.lineage import Version
from pipeline.core.space import Space

CHANGED = ("adj_ttc_s", "failure_mode", "false_positives", "first_detection_m")
"""KPIs listed for a changed test, before and after."""
DETECTION = ("ap50", "recall")
"""Detection metrics that `dvc metrics show` has room for; model.json has all."""


def compare(
    held_out: HeldOut,
    named: Mapping[str, Bools],
    digest: str,
    regions: Sequence[RegionResult],
    policy: Policy,
    version_of: Callable[[str], Version] = Version.named,
) -> Comparison:
    """Count failures, compare versions pair by pair and judge them.

    Args:
        held_out: The held-out tests of all versions, n each.
        named: Named groups of tests, name -> (n,) bool.
        digest: Digest of the held-out sequence.
        regions: Failure regions of the base.
        policy: Conditions of the gate.
        version_of: Lineage of a version by its name.
    """
    results = _Results(held_out, policy, version_of)
    versions, groups = held_out.versions, results.groups()
    group_pairs = results.group_pairs(groups)
    over_seeds = {pair.group: pair for pair in group_pairs if pair.against == groups[0].group}
    parts = parts_of(held_out, named)
    reference, gates = results.outcomes[versions[0]], {}
    for version in versions[1:]:
        fewer_over_seeds = over_seeds[version_of(version).group].shows_fewer(policy.alpha)
        outcomes = results.outcomes[version]
        gates[version] = gate(reference, outcomes, fewer_over_seeds, parts, policy)
    passing = tuple(version for version, judged in gates.items() if judged.passes)
    base, *others = (results.version(version, gates.get(version)) for version in versions)
    reasons = {base.version: "the reference"}
    for other in others:
        judged, pair = gates[other.version], over_seeds[other.group]
        reasons[other.version] = gate_reason(judged, base, other, pair, policy)
    pairs = [results.pair(against, version) for against, version in combinations(versions, 2)]
    return Comparison(
        strategy=str(held_out.joined["strategy"].iloc[0]),
        scenarios=dict(held_out.labels),
        sequence_digest=digest,
        confidence=policy.confidence,
        alpha=policy.alpha,
        margin=policy.margin,
        versions=(base, *others),
        groups=groups,
        group_pairs=group_pairs,
        pairs=tuple(pairs),
        regions=tuple(regions),
        champion=champion(results.outcomes, passing),
        gate=reasons,
        passing=passing,
        no_braking=held_out.no_braking,
    )


def compared_again(
    held_out: HeldOut,
    iou: float,
    first: float,
    policy: Policy,
    version_of: Callable[[str], Version] = Version.named,
) -> SecondIou:
    """The groups of versions on the same tests, judged at a second IoU instead of the first.

    Args:
        held_out: The held-out tests, judged at the second IoU.
        iou: The second IoU.
        first: The first IoU.
        policy: Confidence of the intervals.
        version_of: Lineage of a version by its name.
    """
    results = _Results(held_out, policy, version_of)
    groups = results.groups()
    return SecondIou(iou=iou, first=first, groups=groups, group_pairs=results.group_pairs(groups))


@dataclass(frozen=True)
class _Results:
    """The parts of a comparison, as comparison.json stores them."""

    held_out: HeldOut
    policy: Policy
    version_of: Callable[[str], Version]

    @cached_property
    def outcomes(self) -> dict[str, SequenceOutcomes]:
        return {version: self.held_out.outcomes(version) for version in self.held_out.versions}

    @cached_property
    def valid(self) -> Bools:
        """Whether each test is valid for every version, (n,)."""
        return np.asarray(np.all([outcomes.valid for outcomes in self.outcomes.values()], axis=0))

    @property
    def base(self) -> str:
        return self.held_out.versions[0]

    def pair(self, against: str, version: str, scenario: str | None = None) -> VersionPair:
        """scenario: None for all scenarios."""
        tests = np.array(self.held_out.tests, dtype=object)
        rows = np.ones(len(tests), bool) if scenario is None else self.held_out.scenarios[scenario]
        paired = core.pair(self.outcomes[against].at(rows), self.outcomes[version].at(rows))
        return VersionPair(
            version=version,
            against=against,
            tests=paired.tests,
            fixes=tuple(tests[rows][paired.fixed]),
            regressions=tuple(tests[rows][paired.regressed]),
            p_value=paired.p_value,
        )

    def version(self, version: str, judged: Gate | None) -> VersionResult:
        """judged: by the gate; None for the base."""
        outcomes, described = self.outcomes[version], self.version_of(version)
        rows = self.held_out.rows(version)
        valid = rows[is_valid(rows)]
        paired = None if version == self.base else self.pair(self.base, version)
        limits = () if judged is None else judged.limits
        return VersionResult(
            version=version,
            group=described.group,
            round=described.round,
            tests=outcomes.tests,
            errors=outcomes.errors,
            failures=outcomes.failures,
            modes=count_modes(valid),
            causes=count_causes(valid),
            scenarios={name: self.scenario(version, name) for name in self.held_out.labels},
            rate=outcomes.rate,
            change=0 if paired is None else len(paired.regressions) - len(paired.fixes),
            paired=paired,
            verdict="baseline" if paired is None else paired.verdict(self.policy.alpha),
            limits=tuple(LimitResult(**asdict(limit)) for limit in limits),
        )

    def scenario(self, version: str, scenario: str) -> ScenarioResult:
        outcomes = self.outcomes[version].at(self.held_out.scenarios[scenario])
        return ScenarioResult(
            tests=outcomes.tests,
            failures=outcomes.failures,
            rate=outcomes.rate,
            false_activations=count_false_activations(self.held_out.tables[scenario, version]),
            paired=None if version == self.base else self.pair(self.base, version, scenario),
        )

    def groups(self) -> tuple[GroupResult, ...]:
        """Groups of versions that differ only by the seed of retraining (cf. thesis Table 7.2)."""
        members: dict[str, list[str]] = {}
        for version in self.held_out.versions:
            members.setdefault(self.version_of(version).group, []).append(version)
        return tuple(self.group(name, versions) for name, versions in members.items())

    def group(self, name: str, versions: Sequence[str]) -> GroupResult:
        def failures_at(rows: Bools) -> Estimate:
            members = [self.outcomes[version].at(rows & self.valid) for version in versions]
            return _estimate(core.group_failures(members, self.policy.confidence))

        base = self.outcomes[self.base].at(self.valid).failures
        failures = failures_at(self.valid)
        scenarios = {name: failures_at(rows) for name, rows in self.held_out.scenarios.items()}
        return GroupResult(
            group=name,
            round=self.version_of(versions[0]).round,
            versions=tuple(versions),
            tests=int(self.valid.sum()),
            failures=failures,
            scenarios=scenarios,
            against_base=failures.value / base if base else None,
        )

    def group_pairs(self, groups: Sequence[GroupResult]) -> tuple[GroupPair, ...]:
        """Each group against every earlier one."""
        pairs = []
        for against, group in combinations(groups, 2):
            before = [self.outcomes[version] for version in against.versions]
            after = [self.outcomes[version] for version in group.versions]
            paired = core.pair_groups(before, after, self.policy.confidence)
            pairs.append(
                GroupPair(
                    group=group.group,
                    against=against.group,
                    tests=paired.tests,
                    difference=_estimate(paired.difference),
                    p_value=paired.p_value,
                )
            )
        return tuple(pairs)


def _estimate(interval: Interval) -> Estimate:
    return Estimate(**asdict(interval))


def base_regions(
    held_out: HeldOut, spaces: Mapping[str, tuple[ScenarioInfo, Space]], section: Regions
) -> list[RegionResult]:
    """The base's failure regions on the sequence, with every version's failures inside their rules.

    Args:
        held_out: The held-out tests of all versions.
        spaces: Scenario -> the scenario and its space.
        section: Settings of the search for regions.
    """
    results = []
    for info, space in spaces.values():
        tests = {version: held_out.tables[info.name, version] for version in held_out.versions}
        base = tests[held_out.versions[0]]
        valid = base[is_valid(base)].reset_index(drop=True)
        points = encode_tests(base, space)
        counted = np.all([is_valid(rows) for rows in tests.values()], axis=0)
        for grouped in find_regions(info, space, valid, section):
            inside = counted & grouped.group.rule.holds(points)
            failures = {}
            for version, rows in tests.items():
                failures[version] = int((rows["failure"].to_numpy(bool) & inside).sum())
            results.append(
                RegionResult(
                    scenario=info.name,
                    name=grouped.region.name,
                    rule=grouped.region.rule,
                    tests=int(inside.sum()),
                    failures=failures,
                )
            )
    return results


def changed_tests(
    comparison: Comparison, tests: pd.DataFrame, variables: Sequence[str]
) -> pd.DataFrame:
    """Every fix and every regression, with the KPIs of both versions.

    Args:
        comparison: The compared versions.
        tests: Rows of all versions and scenarios.
        variables: Variables of the space, added as columns.

    Returns:
        One row a changed test, columns of changes.csv.
    """
    keyed = tests.set_index(["version", "scenario", "index"])
    base = comparison.versions[0].version
    rows = []
    for result in comparison.versions:
        if result.paired is None:
            continue
        changes = [("regression", test) for test in result.paired.regressions]
        changes += [("fix", test) for test in result.paired.fixes]
        for change, test in changes:
            before = keyed.loc[(base, test.scenario, test.index)]
            after = keyed.loc[(result.version, test.scenario, test.index)]
            row = {
                "version": result.version,
                "against": base,
                "change": change,
                "scenario": test.scenario,
                "index": test.index,
            }
            row |= {f"{name}_before": before[name] for name in CHANGED}
            row |= {f"{name}_after": after[name] for name in CHANGED}
            rows.append(row | {name: before[name] for name in variables})
    columns = ["version", "against", "change", "scenario", "index"]
    columns += [f"{name}_{when}" for when in ("before", "after") for name in CHANGED]
    return pd.DataFrame(rows, columns=[*columns, *variables])


def shown_metrics(
    comparison: Comparison, measures: Measures, detection: Mapping[str, Mapping[str, float]]
) -> dict[str, dict[str, float]]:
    """The table of `dvc metrics show`.

    Args:
        comparison: The compared versions.
        measures: Measures of the searches.
        detection: Version -> its metrics on validation images.

    Returns:
        File of a row -> its columns.
    """
    rows: dict[str, dict[str, float]] = {}
    for result in comparison.versions:
        row = _counted(result.failures, result.tests, result.rate)
        for name, value in detection.get(result.version, {}).items():
            if name in DETECTION:
                row[name] = round(value, 4)
        rows[f"held_out/{result.version}.json"] = row
    for searched in measures.strategies:
        valid = searched.tests - searched.errors
        row = _counted(searched.failures, valid, searched.rate.value)
        if searched.failures:
            row["tests_to_first_failure"] = round(searched.f_measure.value, 1)
        rows[f"search/{series_name(searched)}.json"] = row
    return rows


def _counted(failures: int, tests: int, rate: float) -> dict[str, float]:
    return {"failures": failures, "tests": tests, "failure_rate": round(rate, 4)}
