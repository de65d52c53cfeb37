"""Seconds per test that a strategy itself takes, and the failures and kinds of failures that it finds, on the analytic simulator.

A kind is a combination of categories: of blueprint and pose.

python benchmarks/samplers.py [--tests 400] [--strategies random neural]
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from hydra.utils import instantiate
from threadpoolctl import threadpool_limits

from pipeline.config.composing import compose
from pipeline.core import kpi
from pipeline.detectors.scripted import VisiblePixelOracle
from pipeline.simulators.analytic import AnalyticSimulator


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tests", type=int, default=400)
    parser.add_argument("--strategies", nargs="+", metavar="NAME", help="all by default")
    arguments = parser.parse_args()
    budget, config = arguments.tests, compose("default", [])
    space, simulator = config.space("F1"), AnalyticSimulator(config.scenarios["F1"], compose("default", []).car)
    categorical = [j for j, variable in enumerate(space.variables) if variable.kind == "categorical"]
    print(f"{'strategy':<18}{'s per test':>11}{'slowest ask':>13}{'failures':>10}{'in kinds':>10}   in {budget} tests")
    for name in arguments.strategies or config.samplers:
        section = config.samplers[name]
        sampler = instantiate(section, _partial_=True, _convert_="all")(space=space, seed=0)
        spent, kinds, failures, done = [], set(), 0, 0
        while done < budget:
            started = time.process_time()
            with threadpool_limits(1):
                points = sampler.ask()
            spent.append(time.process_time() - started)
            found = [kpi.evaluate(simulator.execute(space.decode(p), VisiblePixelOracle()).signals, 0.1) for p in points]
            sampler.tell(points, np.array([f.adj_ttc_s for f in found]))
            failures += sum(f.failure for f in found)
            kinds |= {tuple(p[categorical]) for p, f in zip(points, found, strict=True) if f.failure}
            done += len(points)
        print(f"{name:<18}{sum(spent) / done:>11.4f}{max(spent):>13.2f}{failures:>10}{len(kinds):>10}")


if __name__ == "__main__":
    main()
