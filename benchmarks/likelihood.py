"""Do the intervals of failure rates hold? Estimators on failures whose rate is known, many times.

    python -m benchmarks.likelihood run [--repeats 400] [--only subset] [--processes 2]
    python -m benchmarks.likelihood show          the table of docs/results/likelihood.md

Finished estimates stay in .cache/likelihood until the method's code or this file changes, so the
same command resumes a killed run.

The space has seven variables and two regimes. The failures are a half-space, a box, two modes at
opposite ends of a variable, one rare category, and two modes of which only one shows near misses.
"""

from __future__ import annotations

import argparse
import hashlib
import multiprocessing
from collections.abc import Callable, Mapping
from multiprocessing.pool import Pool
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from threadpoolctl import threadpool_limits

from benchmarks.shared import RESULTS, markdown
from pipeline.artefacts.files import sha256
from pipeline.core.exposure import Exposure
from pipeline.core.likelihood.estimator import Estimator
from pipeline.core.likelihood.importance import ImportanceSampling
from pipeline.core.likelihood.monte_carlo import MonteCarlo
from pipeline.core.likelihood.rate import Rate, combined
from pipeline.core.likelihood.reweighted import reweighted
from pipeline.core.likelihood.subset import SubsetSimulation
from pipeline.core.space import Floats, Space, Variable
from pipeline.sources import code_digest

OUT = RESULTS / "likelihood.csv"
DONE = Path(".cache/likelihood")
KINDS = tuple("abcdefgh")
SPACE = Space(
    (
        Variable("x", "continuous", low=0, high=1, step=0.1),
        Variable("y", "continuous", low=0, high=1, step=0.1),
        Variable("z", "continuous", low=0, high=1, step=0.1),
        Variable("angle", "continuous", "deg", 0, 360, 30, cyclic=True),
        Variable("idle", "continuous", low=0, high=1, step=0.1),
        Variable("other", "categorical", values=("p", "q", "r")),
        Variable("kind", "categorical", values=KINDS),
    )
)
USUAL, RAINY = (
    (0.3, 0.2, 0.15, 0.15, 0.1, 0.04, 0.04, 0.02),
    (0.2, 0.2, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1),
)
EXPOSURE: Mapping[str, Any] = {
    "variables": {"x": {"kind": "normal", "mean": 0.5, "deviation": 0.2}},
    "regimes": {
        "dry": {
            "share": 0.75,
            "variables": {
                "kind": {"kind": "shares", "shares": dict(zip(KINDS, USUAL, strict=True))}
            },
        },
        "rain": {
            "share": 0.25,
            "variables": {
                "kind": {"kind": "shares", "shares": dict(zip(KINDS, RAINY, strict=True))}
            },
        },
    },
}
F_SHARE = 0.75 * USUAL[5] + 0.25 * RAINY[5]
"""How often kind f occurs."""
Kpi = Callable[[Floats], Floats]


def half_space(rate: float) -> Kpi:
    """y + z at most c, which has the area c² / 2."""
    return lambda points: points[:, 1] + points[:, 2] - np.sqrt(2 * rate)


def box(rate: float) -> Kpi:
    """A cube in y, z and the angle."""
    half = rate ** (1 / 3) / 2

    def distance(points: Floats) -> Floats:
        around = np.abs((points[:, 3] - 90 + 180) % 360 - 180) / 360
        return np.asarray(
            np.max([np.abs(points[:, 1] - 0.4), np.abs(points[:, 2] - 0.6), around], axis=0) - half
        )

    return distance


def two_modes(rate: float) -> Kpi:
    """Both ends of x, half of the rate each."""
    end = _lowest(rate / 2)
    return lambda points: np.minimum(points[:, 0], 1 - points[:, 0]) - end


def category(rate: float) -> Kpi:
    """Low y of kind f; other kinds never fail, but low y brings them near to it."""
    end = rate / F_SHARE
    return lambda points: points[:, 1] + np.where(points[:, 6] == 5, -end, 0.05)


def uneven_modes(rate: float) -> Kpi:
    """Low x, and high y, half of the rate each: the KPI falls towards high y only close to it."""
    low, high = _lowest(rate / 2), (rate / 2) / (1 - rate / 2)
    return lambda points: np.where(
        points[:, 0] <= low, -1.0, np.minimum(points[:, 0] - low, 1 - points[:, 1] - high)
    )


def _lowest(share: float) -> float:
    """The x below which that share of the exposure lies."""
    return float(Exposure.from_dict(SPACE, EXPOSURE).marginals[0][0].quantile(np.array([share]))[0])


CASES: Mapping[str, Callable[[float], Kpi]] = {
    "half-space": half_space,
    "box": box,
    "two modes": two_modes,
    "category": category,
    "uneven modes": uneven_modes,
}


def estimated(estimator: Estimator, kpi: Kpi) -> Rate:
    """Ask and tell until the estimator knows enough or has spent its budget."""
    done = 0
    while len(points := estimator.ask()[: estimator.budget - done]):
        estimator.tell(points, kpi(points))
        done += len(points)
    return estimator.rate()


def made(method: type[Estimator], seed: int, budget: int, **more: Any) -> Estimator:
    return method(
        space=SPACE, seed=seed, exposure=EXPOSURE, budget=budget, failure_threshold_s=0.0, **more
    )


def monte_carlo(case: str, seed: int) -> tuple[float, Rate]:
    return 0.02, estimated(made(MonteCarlo, seed, 2000, batch_size=2000), CASES[case](0.02))


def monte_carlo_below(case: str, seed: int) -> tuple[float, Rate]:
    """Monte Carlo that stops once the rate is known to lie below or above 3 %."""
    return 0.02, estimated(made(MonteCarlo, seed, 4000, below=0.03), CASES[case](0.02))


def subset(case: str, seed: int) -> tuple[float, Rate]:
    """Its interval was chosen with the seeds from 0, so these are others."""
    return 1e-4, estimated(made(SubsetSimulation, 1000 + seed, 4600), CASES[case](1e-4))


def importance(case: str, seed: int) -> tuple[float, Rate]:
    return 0.03, estimated(
        made(ImportanceSampling, seed, 2000, batch_size=100, pool=4000, trees=20), CASES[case](0.03)
    )


def uniform_tests(case: str, seed: int) -> tuple[float, Rate]:
    """Uniform random tests, reweighted to the exposure."""
    points = SPACE.sample(2000, np.random.default_rng(seed))
    return 0.02, reweighted(
        Exposure.from_dict(SPACE, EXPOSURE), points, CASES[case](0.02)(points) <= 0
    )


def system(case: str, seed: int) -> tuple[float, Rate]:
    """Three scenarios whose rates differ tenfold, by Monte Carlo (Def. 4.12)."""
    rates, shares = (0.05, 0.02, 0.005), (0.2, 0.3, 0.5)
    parts = [
        estimated(made(MonteCarlo, 3 * seed + i, 700, batch_size=700), CASES[case](rate))
        for i, rate in enumerate(rates)
    ]
    return float(np.dot(rates, shares)), combined(parts, shares)


METHODS: Mapping[str, tuple[Callable[[str, int], tuple[float, Rate]], str]] = {
    "monte_carlo": (monte_carlo, "monte_carlo"),
    "monte_carlo, below": (monte_carlo_below, "monte_carlo"),
    "subset": (subset, "subset"),
    "importance": (importance, "importance"),
    "uniform, reweighted": (uniform_tests, "reweighted"),
    "system": (system, "monte_carlo"),
}
"""How each method estimates a rate, and its module."""


def repeated(job: tuple[str, str, int]) -> dict[str, Any]:
    """One estimate, of a method, a case and a seed, as a row."""
    method, case, seed = job
    with threadpool_limits(1):
        true, rate = METHODS[method][0](case, seed)
    limits = {"low": rate.limits.low, "high": rate.limits.high, "below": rate.limits.below}
    return {
        "method": method,
        "case": case,
        "seed": seed,
        "true": true,
        "value": rate.value,
        **limits,
        "tests": rate.tests,
    }


def run(repeats: int, only: str | None, processes: int) -> None:
    """Estimate every rate many times; write a row for each method and case."""
    methods = [name for name in METHODS if only in (None, name)]
    with multiprocessing.Pool(processes) as pool:
        rows = pd.concat([estimates(method, repeats, pool) for method in methods])
    table = pd.DataFrame(
        map(summary, (group for _, group in rows.groupby(["method", "case"], sort=False)))
    )
    if only and OUT.exists():
        kept = pd.read_csv(OUT)
        table = pd.concat([kept[~kept["method"].isin(methods)], table])
    table["method"] = pd.Categorical(table["method"], list(METHODS))
    table.sort_values("method", kind="stable").to_csv(OUT, index=False, float_format="%.6g")


def estimates(method: str, repeats: int, pool: Pool) -> pd.DataFrame:
    """The rows of a method: those of an earlier run of the same code, and the missing ones."""
    path = path_of(method)
    stored = pd.read_csv(path) if path.exists() else pd.DataFrame(columns=["case", "seed"])
    done = set(zip(stored["case"], stored["seed"], strict=True))
    path.parent.mkdir(parents=True, exist_ok=True)
    missing = [
        (method, case, seed)
        for seed in range(repeats)
        for case in CASES
        if (case, seed) not in done
    ]
    for row in pool.imap(repeated, missing):
        pd.DataFrame([row]).to_csv(path, mode="a", header=not path.exists(), index=False)
    rows = pd.read_csv(path)
    return rows[rows["seed"] < repeats]


def path_of(method: str) -> Path:
    """The file of a method's finished estimates."""
    code = code_digest(f"pipeline.core.likelihood.{METHODS[method][1]}") + sha256(Path(__file__))
    return DONE / f"{method} {hashlib.sha256(code.encode()).hexdigest()[:12]}.csv"


def summary(rows: pd.DataFrame) -> dict[str, Any]:
    """The coverage of a method on a case, and how many tests Monte Carlo needs for its error."""
    true, tests = float(rows["true"].iloc[0]), float(rows["tests"].mean())
    error = float(np.sqrt(((rows["value"] / true - 1) ** 2).mean()))
    return {
        **{key: rows[key].iloc[0] for key in ("method", "case", "true")},
        "repeats": len(rows),
        "inside": int(((rows["low"] <= true) & (true <= rows["high"])).sum()),
        "under_limit": int((true <= rows["below"]).sum()),
        "tests": tests,
        "mean": float(rows["value"].mean()),
        "relative_error": error,
        "high": float(rows["high"].median()),
        "saving": (1 - true) / true / error**2 / tests,
    }


def table() -> str:
    """The published table."""
    rows = []
    for row in pd.read_csv(OUT).itertuples():
        shares = [f"{100 * count / row.repeats:.1f}" for count in (row.inside, row.under_limit)]
        cells = [row.method, row.case, f"{row.true:g}", f"{row.tests:,.0f}", *shares]
        rows.append([*cells, f"{100 * row.relative_error:.0f}", f"{row.saving:.1f}"])
    names = ["method", "failures", "true rate", "tests", "in the interval, %"]
    names += ["under the one-sided limit, %", "error, %", "Monte Carlo needs, times"]
    return markdown(names, rows)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("action", choices=["run", "show"])
    parser.add_argument("--repeats", type=int, default=400)
    parser.add_argument("--only", choices=list(METHODS))
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    if options.action == "run":
        run(options.repeats, options.only, options.processes)
    else:
        print(table())


if __name__ == "__main__":
    main()
