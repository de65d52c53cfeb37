"""Model versions on the same tests, compared pair by pair and group by group (thesis section 7.3)."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from itertools import chain, combinations
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.analysis.failure_regions import cluster
from pipeline.analysis.measures import count_modes
from pipeline.artefacts.points import encode_tests
from pipeline.artefacts.results import (
    Comparison,
    Estimate,
    GroupPair,
    GroupResult,
    Measures,
    Paired,
    RegionResult,
    ScenarioResult,
    Verdict,
    VersionResult,
)
from pipeline.artefacts.scenario_space import ScenarioInfo
from pipeline.config.schema import Config
from pipeline.core.lineage import Version
from pipeline.core.rules import find_rule
from pipeline.core.space import Space
from pipeline.core.statistics import mcnemar, mean_interval, sign_flip, wilson_interval
from pipeline.errors import InputError

CHANGED = ("adj_ttc_s", "failure_mode", "false_positives", "first_detection_m")
"""KPIs beside a changed test, of before and after."""


def _check_threshold(rows: pd.DataFrame, threshold: float, path: Path) -> None:
    judged = rows[rows["status"] == "ok"]
    different = judged[judged["failure"] != (judged["adj_ttc_s"] <= threshold)]
    if len(different):
        row = different.iloc[0]
        raise InputError(
            f"{path}, test {row['index']}: expected a failure at an adjusted TTC of {threshold:g} s or below "
            f"(campaign.failure_threshold_s), got {row['adj_ttc_s']:.3g} s and failure {bool(row['failure'])}; execute it again"
        )


def check_sequences(tests: Mapping[tuple[str, str], pd.DataFrame], variables: Mapping[str, Sequence[str]], versions: Sequence[str]) -> str:
    """Check that all versions executed the same points in the same order, and return the SHA-256 of the sequence.

    tests: (scenario, version) -> its rows by index. Raises InputError that names the first difference.
    """
    digest = hashlib.sha256()
    for scenario, names in variables.items():
        for version in versions:
            if (scenario, version) not in tests:
                raise InputError(f"expected a campaign of version '{version}' on held-out scenario '{scenario}', got none")
            _check_same(tests[scenario, versions[0]], tests[scenario, version], names)
        sequence = tests[scenario, versions[0]][["index", *names]].to_csv(index=False, float_format="%.17g")
        digest.update(f"{scenario}\n{sequence}".encode())
    return digest.hexdigest()


def _check_same(first: pd.DataFrame, other: pd.DataFrame, names: Sequence[str]) -> None:
    who = f"version '{other['version'].iloc[0]}' on scenario '{other['scenario'].iloc[0]}'"
    if len(first) != len(other):
        raise InputError(f"{who}: expected {len(first)} tests as version '{first['version'].iloc[0]}' has, got {len(other)}")
    for name in ("strategy", "seed", "index", *names):
        different = (first[name] != other[name]).to_numpy()
        if different.any():
            row = int(different.argmax())
            expected, got = first[name].tolist()[row], other[name].tolist()[row]
            raise InputError(f"{who}, test {other['index'].iloc[row]}: {name} must be {expected!r} as for the base, got {got!r}")


def compare(
    tests: pd.DataFrame,
    labels: Mapping[str, str],
    versions: Sequence[str],
    digest: str,
    regions: Sequence[RegionResult] = (),
    *,
    alpha: float,
    confidence: float,
) -> Comparison:
    """Count, pair and judge. tests: rows of all versions and held-out scenarios; labels: scenario -> printed name; the first version
    is the base.
    """
    keyed = tests.assign(key=[f"{s}-{i:05d}" for s, i in zip(tests["scenario"], tests["index"], strict=True)])
    by_version = {version: keyed[keyed["version"] == version].set_index("key") for version in versions}
    pairs = tuple(pair(by_version[first], by_version[second], first, second) for first, second in combinations(versions, 2))
    against_base = {found.version: found for found in pairs if found.against == versions[0]}
    reference = by_version[versions[0]]
    results = tuple(_version(v, by_version[v], reference, against_base.get(v), list(labels), alpha, confidence) for v in versions)
    groups = group_results(results, confidence)
    champion, reasons = gate(results, by_version, labels, alpha)
    return Comparison(
        strategy=str(tests["strategy"].iloc[0]),
        scenarios=dict(labels),
        sequence_digest=digest,
        confidence=confidence,
        alpha=alpha,
        versions=results,
        groups=groups,
        group_pairs=tuple(group_pair(by_version, first, second, confidence) for first, second in combinations(groups, 2)),
        pairs=pairs,
        regions=tuple(regions),
        champion=champion,
        gate=reasons,
    )


def group_results(results: Sequence[VersionResult], confidence: float) -> tuple[GroupResult, ...]:
    """Mean failures over the seeds of retraining, group by group (our form of thesis Table 7.2); the first result is the base."""
    groups: dict[str, list[VersionResult]] = {}
    for result in results:
        groups.setdefault(result.group, []).append(result)
    base = results[0].failures
    return tuple(
        GroupResult(
            group=name,
            round=members[0].round,
            versions=tuple(member.version for member in members),
            failures=(failures := _counted(members, confidence)),
            scenarios={s: _counted([member.scenarios[s] for member in members], confidence) for s in members[0].scenarios},
            against_base=failures.value / base if base else None,
        )
        for name, members in groups.items()
    )


def group_pair(by_version: Mapping[str, pd.DataFrame], against: GroupResult, group: GroupResult, confidence: float) -> GroupPair:
    """Compare two groups. by_version: rows indexed alike, columns status and failure. The base, one version, stands beside each seed."""
    rows = [[by_version[version] for version in found.versions] for found in (against, group)]
    valid = np.all([table["status"] == "ok" for table in chain(*rows)], axis=0)
    before, after = (np.array([table["failure"][valid] for table in tables], dtype=np.int64) for tables in rows)
    return GroupPair(
        group=group.group,
        against=against.group,
        tests=int(valid.sum()),
        difference=_mean((after.sum(axis=1) - before.sum(axis=1)).tolist(), confidence, least=-np.inf),
        p_value=sign_flip((after - before).sum(axis=0)),
    )


def _counted(results: Sequence[VersionResult] | Sequence[ScenarioResult], confidence: float) -> Estimate:
    """Failures, the mean over the seeds; a single count with the interval of its rate."""
    if len(results) > 1:
        return _mean([result.failures for result in results], confidence)
    (single,) = results
    return Estimate(value=single.failures, low=single.rate.low * single.tests, high=single.rate.high * single.tests)


def _mean(counts: Sequence[int], confidence: float, least: float = 0) -> Estimate:
    low, high = mean_interval(counts, confidence, limits=(least, np.inf))
    return Estimate(value=float(np.mean(counts)), low=low, high=high)


def held_out_regions(info: ScenarioInfo, space: Space, tests: Mapping[str, pd.DataFrame], config: Config) -> list[RegionResult]:
    """The base's failure regions on one scenario of the sequence, and the failures of every version inside their rules.

    tests: version -> its rows by index; the first is the base.
    """
    base = next(iter(tests.values()))
    valid = base[base["status"] == "ok"].reset_index(drop=True)
    section = config.regions
    found = cluster(info, space, valid, section.chance_neighbours, section.min_failures, config.comparison.confidence)
    points, results = encode_tests(base, space), []
    for region in found.regions:
        members = valid["test_id"].isin(region.members).to_numpy()
        inside = find_rule(space, encode_tests(valid, space), valid["failure"].to_numpy(bool), members).holds(points)
        failures = {version: int((rows["failure"].to_numpy(bool) & inside).sum()) for version, rows in tests.items()}
        results.append(RegionResult(scenario=info.name, name=region.name, rule=region.rule, tests=int(inside.sum()), failures=failures))
    return results


def changed_tests(comparison: Comparison, tests: pd.DataFrame, variables: Sequence[str]) -> pd.DataFrame:
    """Every test that a version passes and the base fails (`repair`) or the other way round (`regression`), with the KPI of both."""
    keyed = tests.set_index(["version", "scenario", "index"])
    base = comparison.versions[0].version
    rows = []
    for result in comparison.versions:
        changes = [] if result.paired is None else [("regression", result.paired.regressions), ("repair", result.paired.fixes)]
        for change, names in changes:
            for name in names:
                scenario, index = name.rsplit("-", 1)
                before, after = (keyed.loc[(version, scenario, int(index))] for version in (base, result.version))
                row = {"version": result.version, "against": base, "change": change, "scenario": scenario, "index": int(index)}
                row |= {f"{name}_before": before[name] for name in CHANGED} | {f"{name}_after": after[name] for name in CHANGED}
                rows.append(row | {name: before[name] for name in variables})
    columns = ["version", "against", "change", "scenario", "index"]
    columns += [f"{name}_{when}" for when in ("before", "after") for name in CHANGED]
    return pd.DataFrame(rows, columns=[*columns, *variables])


def pair(before: pd.DataFrame, after: pd.DataFrame, against: str, version: str) -> Paired:
    """Exact McNemar test on the tests that both versions executed; rows indexed alike, columns status and failure."""
    valid = (before["status"] == "ok") & (after["status"] == "ok")
    first, second = before.loc[valid, "failure"].astype(bool), after.loc[valid, "failure"].astype(bool)
    outcome = mcnemar(first.to_numpy(), second.to_numpy())
    return Paired(
        version=version,
        against=against,
        tests=outcome.tests,
        fixes=tuple(first.index[first & ~second]),
        regressions=tuple(first.index[~first & second]),
        p_value=outcome.p_value,
    )


def _version(
    version: str,
    tests: pd.DataFrame,
    reference: pd.DataFrame,
    paired: Paired | None,
    scenarios: Sequence[str],
    alpha: float,
    confidence: float,
) -> VersionResult:
    valid = tests[tests["status"] == "ok"]
    described = Version.named(version)
    return VersionResult(
        version=version,
        group=described.group,
        round=described.round,
        tests=len(valid),
        errors=len(tests) - len(valid),
        failures=int(valid["failure"].sum()),
        modes=count_modes(valid),
        scenarios={name: _scenario(version, tests, reference, paired, name, confidence) for name in scenarios},
        rate=_rate(valid, confidence),
        change=0 if paired is None else len(paired.regressions) - len(paired.fixes),
        paired=paired,
        verdict=judge(paired, alpha),
    )


def _scenario(
    version: str, tests: pd.DataFrame, reference: pd.DataFrame, paired: Paired | None, name: str, confidence: float
) -> ScenarioResult:
    rows = tests[tests["scenario"] == name]
    valid = rows[rows["status"] == "ok"]
    part = None if paired is None else pair(reference[reference["scenario"] == name], rows, paired.against, version)
    return ScenarioResult(tests=len(valid), failures=int(valid["failure"].sum()), rate=_rate(valid, confidence), paired=part)


def _rate(valid: pd.DataFrame, confidence: float) -> Estimate:
    failures = int(valid["failure"].sum())
    low, high = wilson_interval(failures, len(valid), confidence)
    return Estimate(value=failures / max(1, len(valid)), low=low, high=high)


def judge(paired: Paired | None, alpha: float) -> Verdict:
    """The verdict on a version: a difference counts when its exact p-value is at most alpha; not corrected for several versions."""
    if paired is None:
        return "baseline"
    if paired.p_value > alpha:
        return "no difference shown"
    return "better" if len(paired.fixes) > len(paired.regressions) else "worse"


def gate(
    results: Sequence[VersionResult], by_version: Mapping[str, pd.DataFrame], labels: Mapping[str, str], alpha: float
) -> tuple[str, dict[str, str]]:
    """The champion, and for each version why it is or is not.

    A version passes if it breaks in no more tests than the first, the base, fails significantly less than it, and significantly more on no
    scenario. Of those that pass the champion has the fewest failures, then the fewest by TTC alone, on the tests that every version
    executed; the base if none passes.
    """
    base, *others = results
    reasons = {base.version: "the reference"}
    for result in others:
        parts = {labels[name]: part for name, part in result.scenarios.items() if part.failures > base.scenarios[name].failures}
        worse = [name for name, part in parts.items() if judge(part.paired, alpha) == "worse"]
        p_value = 1.0 if result.paired is None else result.paired.p_value
        if result.errors > base.errors:
            reasons[result.version] = f"held back: {result.errors} tests broke, {base.errors} with {base.version}"
        elif result.verdict != "better":
            reasons[result.version] = f"held back: not significantly fewer failures than {base.version} (p = {p_value:.2g})"
        elif worse:
            reasons[result.version] = f"held back: significantly more failures than {base.version} on {', '.join(worse)}"
        else:
            reasons[result.version] = f"passes: significantly fewer failures than {base.version} (p = {p_value:.2g}), " + (
                f"more on {', '.join(parts)} but not significantly" if parts else "more on no scenario"
            )
    valid = pd.concat([rows["status"] == "ok" for rows in by_version.values()], axis=1).all(axis=1)
    modes = {version: count_modes(by_version[version][valid]) for version in by_version if reasons[version].startswith("passes")}
    return min(modes, key=lambda version: (modes[version].total, modes[version].by_ttc), default=base.version), reasons


def flat_metrics(comparison: Comparison, measures: Measures, detection: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """What `dvc metrics` shows: failures and detection metrics of each version, measures of each search strategy."""
    plain: dict[str, dict[str, float]] = {}
    for result in comparison.versions:
        row = plain[result.version] = {
            "failures": result.failures,
            "failures_by_ttc": result.modes.by_ttc,
            "failure_rate": round(result.rate.value, 6),
        }
        row |= {name: round(value, 6) for name, value in detection.get(result.version, {}).items()}
    for strategy in measures.strategies:
        row = plain[f"{strategy.scenario}-{strategy.strategy}"] = {"failures_per_campaign": strategy.failures_per_campaign.value}
        if strategy.f_measure is not None:
            row["f_measure"] = strategy.f_measure.value
        if strategy.c_measure is not None:
            row["c_measure"] = round(strategy.c_measure.value, 6)
        row["pair_coverage_failures"] = round(strategy.pair_coverage_failures.value, 6)
    return plain
