"""Search strategies of other projects by ask and tell, for comparison. They need the packages of requirements.txt.

VerifAI: cross-entropy, multi-armed bandit, Halton and Bayesian. pymoo: NSGA-II. pyribs: MAP-Elites. Unlike the strategies of conf/sampler,
a peer cannot be restored by telling its history again, and it does not know the constraints of a space. VerifAI's Bayesian optimisation
fits a Gaussian process anew for every test, which takes seconds: 1,000 tests of it take hours.
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.core.distance import mixed_distance
from pipeline.core.space import Floats, Space
from pipeline.errors import InputError
from pipeline.protocols import Sampler

PEERS: Mapping[str, str] = {
    "verifai-ce": "verifai",
    "verifai-mab": "verifai",
    "verifai-halton": "verifai",
    "verifai-bayesian": "verifai",
    "pymoo-nsga2": "pymoo",
    "pyribs-map-elites": "ribs",
}
"""Package of each peer."""
VERIFAI = {
    "verifai-ce": "crossEntropySamplerFor",
    "verifai-mab": "multiArmedBanditSamplerFor",
    "verifai-halton": "haltonSamplerFor",
    "verifai-bayesian": "bayesianOptimizationSamplerFor",
}
BATCH = 20
ERROR_S = 10.0
"""KPI of a test that ended in an error, seconds: peers know no missing results."""


def make(name: str, space: Space, seed: int, failure_threshold_s: float) -> Sampler:
    """A peer before its first test; InputError if its package is missing."""
    try:
        return kind_of(name)(space, seed, name, failure_threshold_s)
    except ImportError as error:
        raise InputError(
            f"{name} needs the packages of benchmarks/strategies/requirements.txt: {error}"
        ) from error


def kind_of(name: str) -> type[VerifaiSampler] | type[Nsga2] | type[MapElites]:
    """The class of a peer."""
    if name in VERIFAI:
        return VerifaiSampler
    return Nsga2 if name == "pymoo-nsga2" else MapElites


class VerifaiSampler:
    """A sampler of VerifAI, told after every test, which is its most favourable case."""

    def __init__(self, space: Space, seed: int, name: str, failure_threshold_s: float) -> None:
        from verifai.features import Box, DiscreteBox, Feature, FeatureSpace
        from verifai.samplers.feature_sampler import FeatureSampler

        random.seed(seed)  # VerifAI draws from the global generators.
        np.random.seed(seed)  # noqa: NPY002
        domains = {
            f"v{j:03d}": Feature(
                DiscreteBox([0, v.size - 1]) if v.kind == "categorical" else Box([v.low, v.high])
            )
            for j, v in enumerate(space.variables)
        }
        self._space, self._threshold_s = space, failure_threshold_s
        more: dict[str, Any] = {}
        if name == "verifai-bayesian":
            import GPyOpt  # noqa: F401  # VerifAI hides why it cannot be imported.
            from dotmap import DotMap

            more = {"BO_params": DotMap(init_num=BATCH)}
        self._sampler: Any = getattr(FeatureSampler, VERIFAI[name])(FeatureSpace(domains), **more)

    def ask(self) -> Floats:
        self._sample, self._info = self._sampler.getSample()
        values = [float(getattr(self._sample, f"v{j:03d}")[0]) for j in range(len(self._space))]
        whole = [v.kind == "integer" for v in self._space.variables]
        return np.where(whole, np.round(values), values)[None]

    def tell(self, points: Floats, kpi: Floats) -> None:
        # VerifAI counts values below 0 as counterexamples.
        rho = np.nextafter(np.nan_to_num(kpi, nan=ERROR_S) - self._threshold_s, -np.inf)
        self._sampler.update(self._sample, self._info, float(rho[0]))


class Nsga2:
    """NSGA-II of pymoo on the unit cube: the KPI, and the distance to the nearest earlier test, which keeps it from one place."""

    def __init__(self, space: Space, seed: int, name: str, failure_threshold_s: float) -> None:
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.problem import Problem
        from pymoo.core.termination import NoTermination

        self._space, self._told = space, np.zeros((0, len(space)))
        self._algorithm: Any = NSGA2(pop_size=2 * BATCH, n_offsprings=BATCH)
        problem = Problem(n_var=len(space), n_obj=2, xl=0.0, xu=1.0)
        self._algorithm.setup(problem, termination=NoTermination(), seed=seed, verbose=False)

    def ask(self) -> Floats:
        self._asked = self._algorithm.ask()
        return self._space.scale(np.clip(self._asked.get("X").astype(float), 0, np.nextafter(1, 0)))

    def tell(self, points: Floats, kpi: Floats) -> None:
        known = self._told if len(self._told) else points
        nearest = mixed_distance(self._space, points, known).min(axis=1)
        self._asked.set("F", np.column_stack([np.nan_to_num(kpi, nan=ERROR_S), -nearest]))
        # Evaluated by us, not by pymoo's problem.
        for one in self._asked:
            one.evaluated.add("F")
        self._told = np.concatenate([self._told, points])
        self._algorithm.tell(infills=self._asked)


class MapElites:
    """MAP-Elites of pyribs: the lowest KPI of every kind, varied by Gaussian steps on the unit cube."""

    def __init__(self, space: Space, seed: int, name: str, failure_threshold_s: float) -> None:
        from ribs.archives import GridArchive
        from ribs.emitters import GaussianEmitter
        from ribs.schedulers import Scheduler

        self._space, count = space, len(space)
        self._kind = [j for j, v in enumerate(space.variables) if v.kind == "categorical"]
        sizes = [space.sizes[j] for j in self._kind]
        archive = GridArchive(
            solution_dim=count, dims=sizes, ranges=[(0, 1)] * len(sizes), seed=seed
        )
        first = np.random.default_rng(seed).random((3 * BATCH, count))
        emitter = GaussianEmitter(
            archive,
            sigma=0.1,
            initial_solutions=first,
            bounds=[(0, 1)] * count,
            batch_size=BATCH,
            seed=seed,
        )
        self._scheduler: Any = Scheduler(archive, [emitter])

    def ask(self) -> Floats:
        self._unit = np.asarray(self._scheduler.ask())
        return self._space.scale(np.clip(self._unit, 0, np.nextafter(1, 0)))

    def tell(self, points: Floats, kpi: Floats) -> None:
        self._scheduler.tell(
            -np.nan_to_num(kpi, nan=ERROR_S), np.clip(self._unit[:, self._kind], 0, 1)
        )
