"""The comparison of model versions as an artefact: from the held-out tests to comparison.json, changes.csv and metrics.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
import pandas as pd

from pipeline.analysis.failure_regions import cluster
from pipeline.analysis.held_out import HeldOut
from pipeline.analysis.measures import count_causes, count_false_activations, count_modes, series_name
from pipeline.artefacts.comparison_results import (
    Comparison,
    GroupPair,
    GroupResult,
    RegionResult,
    ScenarioResult,
    SecondIou,
    VersionPair,
    VersionResult,
)
from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.results import Estimate, Measures
from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.config.schema import Regions
from pipeline.core import comparison as core
from pipeline.core.comparison import Gate, Interval, SequenceOutcomes
from pipeline.core.lineage import Version
from pipeline.core.rules import find_rule
from pipeline.core.space import Space

CHANGED = ("adj_ttc_s", "failure_mode", "false_positives", "first_detection_m")
"""KPIs listed for a changed test, before and after."""


def compare(held_out: HeldOut, digest: str, regions: Sequence[RegionResult], alpha: float, confidence: float) -> Comparison:
    """Count failures, compare versions pair by pair and judge them. digest: of the sequence. regions: of the base. alpha: of each paired
    test. confidence: of all intervals."""
    results = _Results(held_out, alpha, confidence)
    versions, groups = held_out.versions, results.groups()
    gates = {version: results.gate(version) for version in versions[1:]}
    return Comparison(
        strategy=str(held_out.joined["strategy"].iloc[0]),
        scenarios=dict(held_out.labels),
        sequence_digest=digest,
        confidence=confidence,
        alpha=alpha,
        versions=tuple(map(results.version, versions)),
        groups=groups,
        group_pairs=tuple(results.group_pair(against, group) for against, group in combinations(groups, 2)),
        pairs=tuple(results.pair(against, version) for against, version in combinations(versions, 2)),
        regions=tuple(regions),
        champion=core.champion(results.outcomes, [version for version, found in gates.items() if found.passes]),
        gate={versions[0]: "the reference"} | {version: results.reason(version, found) for version, found in gates.items()},
        no_braking=held_out.no_braking,
    )


def compared_again(held_out: HeldOut, iou: float, first: float, alpha: float, confidence: float) -> SecondIou:
    """The groups of versions once more, on the same tests judged at a second IoU instead of the first."""
    results = _Results(held_out, alpha, confidence)
    groups = results.groups()
    pairs = tuple(results.group_pair(against, group) for against, group in combinations(groups, 2))
    return SecondIou(iou=iou, first=first, groups=groups, group_pairs=pairs)


@dataclass(frozen=True)
class _Results:
    """The parts of a comparison, as comparison.json stores them."""

    held_out: HeldOut
    alpha: float
    confidence: float

    @cached_property
    def outcomes(self) -> dict[str, SequenceOutcomes]:
        return {version: self.held_out.outcomes(version) for version in self.held_out.versions}

    @property
    def base(self) -> str:
        return self.held_out.versions[0]

    def pair(self, against: str, version: str, scenario: str | None = None) -> VersionPair:
        """scenario: None for all scenarios."""
        tests = np.array(self.held_out.tests, dtype=object)
        rows = np.ones(len(tests), bool) if scenario is None else self.held_out.scenarios[scenario]
        found = core.pair(self.outcomes[against].at(rows), self.outcomes[version].at(rows))
        return VersionPair(
            version=version,
            against=against,
            tests=found.tests,
            fixes=tuple(tests[rows][found.fixed]),
            regressions=tuple(tests[rows][found.regressed]),
            p_value=found.p_value,
        )

    def version(self, version: str) -> VersionResult:
        outcomes, described = self.outcomes[version], Version.named(version)
        rows = self.held_out.rows(version)
        valid = rows[rows["status"] == "ok"]
        paired = None if version == self.base else self.pair(self.base, version)
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
            verdict="baseline" if paired is None else core.pair(self.outcomes[self.base], outcomes).verdict(self.alpha),
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
        """Groups of versions that differ only by the seed of retraining (our form of thesis Table 7.2)."""
        members: dict[str, list[str]] = {}
        for version in self.held_out.versions:
            members.setdefault(Version.named(version).group, []).append(version)
        return tuple(self.group(name, versions) for name, versions in members.items())

    def group(self, name: str, versions: Sequence[str]) -> GroupResult:
        members, base = [self.outcomes[version] for version in versions], self.outcomes[self.base].failures
        failures = _estimate(core.group_failures(members, self.confidence))
        parts = {scenario: [member.at(rows) for member in members] for scenario, rows in self.held_out.scenarios.items()}
        return GroupResult(
            group=name,
            round=Version.named(versions[0]).round,
            versions=tuple(versions),
            failures=failures,
            scenarios={scenario: _estimate(core.group_failures(part, self.confidence)) for scenario, part in parts.items()},
            against_base=failures.value / base if base else None,
        )

    def group_pair(self, against: GroupResult, group: GroupResult) -> GroupPair:
        before, after = ([self.outcomes[version] for version in found.versions] for found in (against, group))
        found = core.pair_groups(before, after, self.confidence)
        return GroupPair(
            group=group.group,
            against=against.group,
            tests=found.tests,
            difference=_estimate(found.difference),
            p_value=found.p_value,
        )

    def gate(self, version: str) -> Gate:
        return core.gate(self.outcomes[self.base], self.outcomes[version], self.held_out.scenarios, self.alpha)

    def reason(self, version: str, found: Gate) -> str:
        """Why the gate passes a version or holds it back."""
        p_value = core.pair(self.outcomes[self.base], self.outcomes[version]).p_value
        more, worse = (", ".join(self.held_out.labels[name] for name in names) for names in (found.more, found.worse))
        if found.more_errors:
            return f"held back: {self.outcomes[version].errors} errors, {self.outcomes[self.base].errors} with {self.base}"
        if not found.better:
            return f"held back: not significantly fewer failures than {self.base} (p = {p_value:.2g})"
        if worse:
            return f"held back: significantly more failures than {self.base} on {worse}"
        scenarios = f"more on {more} but not significantly" if more else "more on no scenario"
        return f"passes: significantly fewer failures than {self.base} (p = {p_value:.2g}), {scenarios}"


def _estimate(interval: Interval) -> Estimate:
    return Estimate(**asdict(interval))


def base_regions(held_out: HeldOut, spaces: Mapping[str, tuple[ScenarioInfo, Space]], section: Regions) -> list[RegionResult]:
    """The base's failure regions on the sequence, scenario by scenario, with every version's failures inside their rules."""
    return [result for info, space in spaces.values() for result in _regions_of(held_out, info, space, section)]


def _regions_of(held_out: HeldOut, info: ScenarioInfo, space: Space, section: Regions) -> list[RegionResult]:
    tests = {version: held_out.tables[info.name, version] for version in held_out.versions}
    base = tests[held_out.versions[0]]
    valid = base[base["status"] == "ok"].reset_index(drop=True)
    points, results = encode_tests(base, space), []
    for region in cluster(info, space, valid, section).regions:
        members = valid["test_id"].isin(region.members).to_numpy()
        inside = find_rule(space, encode_tests(valid, space), valid["failure"].to_numpy(bool), members).holds(points)
        failures = {version: int((rows["failure"].to_numpy(bool) & inside).sum()) for version, rows in tests.items()}
        results.append(RegionResult(scenario=info.name, name=region.name, rule=region.rule, tests=int(inside.sum()), failures=failures))
    return results


def changed_tests(comparison: Comparison, tests: pd.DataFrame, variables: Sequence[str]) -> pd.DataFrame:
    """Every fix (the base fails, the version passes) and every regression (the reverse), with the KPIs of both versions.

    tests: rows of all versions and scenarios. variables: of the space, added as columns.
    """
    keyed = tests.set_index(["version", "scenario", "index"])
    base = comparison.versions[0].version
    rows = []
    for result in comparison.versions:
        changes = [] if result.paired is None else [("regression", result.paired.regressions), ("fix", result.paired.fixes)]
        for change, changed in changes:
            for test in changed:
                before, after = (keyed.loc[(version, test.scenario, test.index)] for version in (base, result.version))
                row = {"version": result.version, "against": base, "change": change, "scenario": test.scenario, "index": test.index}
                row |= {f"{name}_before": before[name] for name in CHANGED} | {f"{name}_after": after[name] for name in CHANGED}
                rows.append(row | {name: before[name] for name in variables})
    columns = ["version", "against", "change", "scenario", "index"]
    columns += [f"{name}_{when}" for when in ("before", "after") for name in CHANGED]
    return pd.DataFrame(rows, columns=[*columns, *variables])


def flat_metrics(comparison: Comparison, measures: Measures, detection: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """What `dvc metrics` shows: failures and detection metrics of each version, measures of each search strategy."""
    plain: dict[str, dict[str, float]] = {}
    for result in comparison.versions:
        row = plain[result.version] = {
            "failures": result.failures,
            "failures_by_ttc": result.modes.by_ttc,
            "failure_rate": round(result.rate, 6),
        }
        row |= {name: round(value, 6) for name, value in detection.get(result.version, {}).items()}
    for strategy in measures.strategies:
        row = plain[series_name(strategy)] = {"failures_per_campaign": strategy.failures_per_campaign.value}
        row["f_measure"] = round(strategy.f_measure.value, 6)
        if strategy.c_measure is not None:
            row["c_measure"] = round(strategy.c_measure.value, 6)
        row["pair_coverage_failures"] = round(strategy.pair_coverage_failures.value, 6)
    return plain
