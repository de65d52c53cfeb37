"""Effect of calibrating the confidence, in closed loop: `python benchmarks/calibration.py [--tests 100] [--scenario F1 F2]`.

The same random tests with the shipped detector's confidence as trained and as calibrated. The threshold of the former is the score that
calibration maps to the threshold in use. Both therefore report the same boxes; only the braking differs.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np
from scipy.optimize import brentq

from pipeline.artefacts.model_card import read_card
from pipeline.config.composing import compose, functional_scenario
from pipeline.core import kpi
from pipeline.core.identity import CampaignId
from pipeline.core.reliability import Calibration
from pipeline.core.statistics import mcnemar
from pipeline.detectors.onnx import OnnxDetector
from pipeline.detectors.yolo.export import export_onnx
from pipeline.detectors.yolo.weights import load_weights
from pipeline.execution.campaign import sampler_seed
from pipeline.simulators.mujoco.simulator import MujocoSimulator

SHIPPED = Path("models/uniform")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tests", type=int, default=100, help="tests per scenario")
    parser.add_argument("--scenario", nargs="+", default=["F1", "F2"])
    options = parser.parse_args()
    study, card = compose("default", []), read_card(SHIPPED / "model.json")
    calibration, used = Calibration(**card.calibration), float(study.detector["threshold"])
    raw = float(brentq(lambda score: float(calibration.apply(score)) - used, 1e-4, 1 - 1e-4))
    model = load_weights(SHIPPED / "weights.safetensors")
    results: dict[str, list[kpi.Kpi]] = {"as trained": [], "calibrated": []}
    with tempfile.TemporaryDirectory() as folder:
        detectors = {}
        for name, chosen, threshold in (
            ("as trained", Calibration(), raw),
            ("calibrated", calibration, used),
        ):
            export_onnx(Path(folder) / f"{name}.onnx", model, card.input_size, chosen)
            detectors[name] = OnnxDetector(Path(folder) / f"{name}.onnx", threshold=threshold)
        for scenario in options.scenario:
            described = functional_scenario(scenario)
            space = described.logical_space()
            simulator = MujocoSimulator(described, compose("default", []).car)
            for point in space.sample(
                options.tests,
                np.random.default_rng(sampler_seed(CampaignId(scenario, "random", "base", 0))),
            ):
                for name, detector in detectors.items():
                    episode = simulator.execute(space.decode(point), detector)
                    results[name].append(
                        kpi.evaluate(episode.signals, study.campaign.failure_threshold_s)
                    )
            simulator.close()
    for name, threshold in (("as trained", raw), ("calibrated", used)):
        found = results[name]
        contacts = [result.impact_speed_mps for result in found if result.contact]
        print(
            f"{name:11} threshold {threshold:.3f}: {sum(r.failure for r in found)} of {len(found)} fail, {len(contacts)} by contact at "
            f"{np.mean(contacts) if contacts else 0:.1f} m/s, mean TTC {np.mean([r.ttc_s for r in found]):.2f} s"
        )
    paired = mcnemar(*([r.failure for r in results[name]] for name in ("as trained", "calibrated")))
    print(
        f"calibration: {paired.fixes} fixes, {paired.regressions} regressions (exact McNemar p = {paired.p_value:.2g})"
    )


if __name__ == "__main__":
    main()
