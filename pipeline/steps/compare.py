"""Step `compare`: every model version on the same frozen held-out sequence (thesis section 7.3), paired test by test."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pandas as pd

from pipeline.artefacts.campaign import read_tests, write_tests
from pipeline.artefacts.files import write_json
from pipeline.artefacts.model import read_card
from pipeline.artefacts.results import Comparison, Estimate, Measures, Paired, Verdict, VersionResult, read, write
from pipeline.artefacts.space import read_space
from pipeline.config import Config
from pipeline.core.statistics import mcnemar, wilson_interval
from pipeline.protocols import InputError
from pipeline.steps.measure import campaign_key, count_modes

Progress = Callable[[int, int, str], None]
BASE, RANDOM, ADAPTIVE = "base", "random", "adaptive"


def run(
    config: Config,
    *,
    tests: Sequence[Path],
    spaces: Sequence[Path],
    models: Sequence[Path],
    measures: Path,
    out: Path,
    table: Path,
    metrics: Path,
    progress: Progress,
) -> None:
    """Compare the versions and write comparison.json, all their tests as comparison.parquet, and metrics.json.

    tests: tests.parquet of each held-out scenario and version. spaces: of the held-out scenarios. models: model.json of each
    version; their order is the order of the versions. measures: measures.json of the search.

    Raises InputError if the versions were not executed on the same points in the same order, or one has no campaign.
    """
    infos = {info.name: (info.label, space) for info, space in map(read_space, spaces)}
    cards = [read_card(path) for path in models]
    tables = {}
    for done, path in enumerate(tests, 1):
        rows = read_tests(path).sort_values("index", ignore_index=True)
        scenario, _, version, _ = campaign_key(rows, path)
        tables[scenario, version] = rows
        progress(done, len(tests), f"{scenario}/{version}")
    versions = [card.version for card in cards]
    digest = check_sequences(tables, {name: space.names for name, (_, space) in infos.items()}, versions)
    joined = pd.concat([tables[name, version] for name in infos for version in versions], ignore_index=True)
    labels = {name: label for name, (label, _) in infos.items()}
    result = compare(joined, labels, versions, digest, alpha=config.comparison.alpha, confidence=config.comparison.confidence)
    write(out, result)
    write_tests(table, joined, next(space for _, space in infos.values()))
    write_json(metrics, flat_metrics(result, read(measures, Measures), {card.version: card.metrics for card in cards}))


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
    tests: pd.DataFrame, labels: Mapping[str, str], versions: Sequence[str], digest: str, *, alpha: float, confidence: float
) -> Comparison:
    """Count, pair and judge. tests: rows of all versions and held-out scenarios; labels: scenario -> printed name."""
    keyed = tests.assign(key=[f"{s}-{i:05d}" for s, i in zip(tests["scenario"], tests["index"], strict=True)])
    by_version = {version: keyed[keyed["version"] == version].set_index("key") for version in versions}
    pairs = {v: pair(by_version[BASE], by_version[v], BASE, v) for v in versions if v != BASE}
    results = tuple(_version(v, by_version[v], pairs.get(v), list(labels), alpha, confidence) for v in versions)
    champion, reasons = gate(by_version, alpha)
    both = RANDOM in by_version and ADAPTIVE in by_version
    return Comparison(
        strategy=str(tests["strategy"].iloc[0]),
        scenarios=dict(labels),
        sequence_digest=digest,
        confidence=confidence,
        alpha=alpha,
        versions=results,
        adaptive_against_random=pair(by_version[RANDOM], by_version[ADAPTIVE], RANDOM, ADAPTIVE) if both else None,
        champion=champion,
        gate=reasons,
    )


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
    version: str, tests: pd.DataFrame, paired: Paired | None, scenarios: Sequence[str], alpha: float, confidence: float
) -> VersionResult:
    valid = tests[tests["status"] == "ok"]
    failures = int(valid["failure"].sum())
    low, high = wilson_interval(failures, len(valid), confidence)
    return VersionResult(
        version=version,
        tests=len(valid),
        errors=len(tests) - len(valid),
        failures=failures,
        modes=count_modes(valid),
        by_scenario={name: int(valid.loc[valid["scenario"] == name, "failure"].sum()) for name in scenarios},
        rate=Estimate(value=failures / max(1, len(valid)), low=low, high=high),
        change=0 if paired is None else len(paired.regressions) - len(paired.fixes),
        paired=paired,
        verdict=judge(paired, alpha),
    )


def judge(paired: Paired | None, alpha: float) -> Verdict:
    """The verdict on a version: a difference counts when its exact p-value is at most alpha; not corrected for several versions."""
    if paired is None:
        return "baseline"
    if paired.p_value > alpha or len(paired.regressions) == len(paired.fixes):
        return "no difference shown"
    return "better" if len(paired.fixes) > len(paired.regressions) else "worse"


def gate(by_version: Mapping[str, pd.DataFrame], alpha: float) -> tuple[str, dict[str, str]]:
    """The champion, and for each version why it is or is not.

    A version passes if it fails significantly less than the first, the base, and significantly more on no scenario. Of those that pass the
    champion has the fewest failures, then the fewest by TTC alone, on the tests that every version executed; the base if none passes.
    """
    (base, reference), *others = by_version.items()
    reasons = {base: "the reference"}
    for version, tests in others:
        whole = pair(reference, tests, base, version)
        scenarios = sorted(set(reference["scenario"]))
        parts = {
            name: pair(reference[reference["scenario"] == name], tests[tests["scenario"] == name], base, version) for name in scenarios
        }
        worse = [name for name, part in parts.items() if judge(part, alpha) == "worse"]
        if judge(whole, alpha) != "better":
            reasons[version] = f"held back: not significantly fewer failures than {base} (p = {whole.p_value:.2g})"
        elif worse:
            reasons[version] = f"held back: significantly more failures than {base} on {', '.join(worse)}"
        else:
            reasons[version] = f"passes: significantly fewer failures than {base} (p = {whole.p_value:.2g}), more on no scenario"
    valid = pd.concat([rows["status"] == "ok" for rows in by_version.values()], axis=1).all(axis=1)
    modes = {version: count_modes(by_version[version][valid]) for version in by_version if reasons[version].startswith("passes")}
    return min(modes, key=lambda version: (modes[version].total, modes[version].by_ttc), default=base), reasons


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
