"""The comparison of model versions as an artefact: from the held-out tests to comparison.json, changes.csv and metrics/."""

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
from pipeline.core.gate import Gate, Part, Policy, champion, gate
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
    """Count failures, compare versions pair by pair and judge them. named: the named groups of tests, name -> (n,) bool. digest: of the
    sequence. regions: of the base. version_of: the version of a name."""
    results = _Results(held_out, policy, version_of)
    versions, groups = held_out.versions, results.groups()
    group_pairs = results.group_pairs(groups)
    over_seeds = {pair.group: pair for pair in group_pairs if pair.against == groups[0].group}
    parts = parts_of(held_out, named)
    gates = {
        version: results.gate(version, over_seeds[version_of(version).group], parts)
        for version in versions[1:]
    }
    passing = tuple(version for version, found in gates.items() if found.passes)
    base, *others = (results.version(version, gates.get(version)) for version in versions)
    reasons = {
        other.version: gate_reason(
            gates[other.version], base, other, over_seeds[other.group], policy
        )
        for other in others
    }
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
        pairs=tuple(
            results.pair(against, version) for against, version in combinations(versions, 2)
        ),
        regions=tuple(regions),
        champion=champion(results.outcomes, passing),
        gate={base.version: "the reference"} | reasons,
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
    """The groups of versions once more, on the same tests judged at a second IoU instead of the first."""
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
        found = core.pair(self.outcomes[against].at(rows), self.outcomes[version].at(rows))
        return VersionPair(
            version=version,
            against=against,
            tests=found.tests,
            fixes=tuple(tests[rows][found.fixed]),
            regressions=tuple(tests[rows][found.regressed]),
            p_value=found.p_value,
        )

    def version(self, version: str, found: Gate | None) -> VersionResult:
        """found: by the gate; None for the base."""
        outcomes, described = self.outcomes[version], self.version_of(version)
        rows = self.held_out.rows(version)
        valid = rows[is_valid(rows)]
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
            verdict="baseline" if paired is None else paired.verdict(self.policy.alpha),
            limits=()
            if found is None
            else tuple(LimitResult(**asdict(limit)) for limit in found.limits),
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
            members.setdefault(self.version_of(version).group, []).append(version)
        return tuple(self.group(name, versions) for name, versions in members.items())

    def group(self, name: str, versions: Sequence[str]) -> GroupResult:
        members = [self.outcomes[version] for version in versions]
        base = self.outcomes[self.base].at(self.valid).failures
        failures = _estimate(
            core.group_failures(
                [member.at(self.valid) for member in members], self.policy.confidence
            )
        )
        parts = {
            name: [member.at(rows & self.valid) for member in members]
            for name, rows in self.held_out.scenarios.items()
        }
        return GroupResult(
            group=name,
            round=self.version_of(versions[0]).round,
            versions=tuple(versions),
            tests=int(self.valid.sum()),
            failures=failures,
            scenarios={
                scenario: _estimate(core.group_failures(part, self.policy.confidence))
                for scenario, part in parts.items()
            },
            against_base=failures.value / base if base else None,
        )

    def group_pairs(self, groups: Sequence[GroupResult]) -> tuple[GroupPair, ...]:
        """Each group against every earlier one."""
        return tuple(self.group_pair(against, group) for against, group in combinations(groups, 2))

    def group_pair(self, against: GroupResult, group: GroupResult) -> GroupPair:
        before, after = (
            [self.outcomes[version] for version in found.versions] for found in (against, group)
        )
        found = core.pair_groups(before, after, self.policy.confidence)
        return GroupPair(
            group=group.group,
            against=against.group,
            tests=found.tests,
            difference=_estimate(found.difference),
            p_value=found.p_value,
        )

    def gate(self, version: str, over_seeds: GroupPair, parts: Sequence[Part]) -> Gate:
        """over_seeds: the version's group against the base."""
        fewer_over_seeds = over_seeds.shows_fewer(self.policy.alpha)
        return gate(
            self.outcomes[self.base], self.outcomes[version], fewer_over_seeds, parts, self.policy
        )


def _estimate(interval: Interval) -> Estimate:
    return Estimate(**asdict(interval))


def base_regions(
    held_out: HeldOut, spaces: Mapping[str, tuple[ScenarioInfo, Space]], section: Regions
) -> list[RegionResult]:
    """The base's failure regions on the sequence, scenario by scenario, with every version's failures inside their rules."""
    return [
        result
        for info, space in spaces.values()
        for result in _regions_of(held_out, info, space, section)
    ]


def _regions_of(
    held_out: HeldOut, info: ScenarioInfo, space: Space, section: Regions
) -> list[RegionResult]:
    tests = {version: held_out.tables[info.name, version] for version in held_out.versions}
    base = tests[held_out.versions[0]]
    valid = base[is_valid(base)].reset_index(drop=True)
    points, results = encode_tests(base, space), []
    counted = np.all([is_valid(rows) for rows in tests.values()], axis=0)
    for found in find_regions(info, space, valid, section):
        inside, region = counted & found.group.rule.holds(points), found.region
        failures = {
            version: int((rows["failure"].to_numpy(bool) & inside).sum())
            for version, rows in tests.items()
        }
        results.append(
            RegionResult(
                scenario=info.name,
                name=region.name,
                rule=region.rule,
                tests=int(inside.sum()),
                failures=failures,
            )
        )
    return results


def changed_tests(
    comparison: Comparison, tests: pd.DataFrame, variables: Sequence[str]
) -> pd.DataFrame:
    """Every fix (the base fails, the version passes) and every regression (the reverse), with the KPIs of both versions.

    tests: rows of all versions and scenarios. variables: of the space, added as columns.
    """
    keyed = tests.set_index(["version", "scenario", "index"])
    base = comparison.versions[0].version
    rows = []
    for result in comparison.versions:
        changes = (
            []
            if result.paired is None
            else [("regression", result.paired.regressions), ("fix", result.paired.fixes)]
        )
        for change, changed in changes:
            for test in changed:
                before, after = (
                    keyed.loc[(version, test.scenario, test.index)]
                    for version in (base, result.version)
                )
                row = {
                    "version": result.version,
                    "against": base,
                    "change": change,
                    "scenario": test.scenario,
                    "index": test.index,
                }
                row |= {f"{name}_before": before[name] for name in CHANGED} | {
                    f"{name}_after": after[name] for name in CHANGED
                }
                rows.append(row | {name: before[name] for name in variables})
    columns = ["version", "against", "change", "scenario", "index"]
    columns += [f"{name}_{when}" for when in ("before", "after") for name in CHANGED]
    return pd.DataFrame(rows, columns=[*columns, *variables])


def shown_metrics(
    comparison: Comparison, measures: Measures, detection: Mapping[str, Mapping[str, float]]
) -> dict[str, dict[str, float]]:
    """The table of `dvc metrics show`: the file of each row, with its columns. detection: metrics of each version on validation images."""
    rows: dict[str, dict[str, float]] = {}
    for result in comparison.versions:
        row = rows[f"held_out/{result.version}.json"] = _counted(
            result.failures, result.tests, result.rate
        )
        row |= {
            name: round(value, 4)
            for name, value in detection.get(result.version, {}).items()
            if name in DETECTION
        }
    for searched in measures.strategies:
        valid = searched.tests - searched.errors
        row = rows[f"search/{series_name(searched)}.json"] = _counted(
            searched.failures, valid, searched.rate.value
        )
        if searched.failures:
            row["tests_to_first_failure"] = round(searched.f_measure.value, 1)
    return rows


def _counted(failures: int, tests: int, rate: float) -> dict[str, float]:
    return {"failures": failures, "tests": tests, "failure_rate": round(rate, 4)}
