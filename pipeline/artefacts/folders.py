"""The layout of data/<study>.

It knows the paths of a study's files, and which of them search, rounds and comparison use.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from pipeline.config.schema import AUDIT, Config
from pipeline.core.lineage import VERSION_FILES, WEIGHTS_SUFFIX, Version

AUDITS = "campaigns/audit"
"""The folder of the audit's campaigns."""
SHARDS = "shards"
"""The folder of the parts of campaigns that separate jobs executed."""


@dataclass(frozen=True)
class Folders:
    """The paths of one study's files, relative to the working directory."""

    config: Config

    @property
    def root(self) -> str:
        """The folder of all outputs of the study."""
        return f"data/{self.config.study}"

    @property
    def goals(self) -> list[str]:
        """The files that a run of the whole study makes in the end."""
        reported = ["report.html", "evidence/base.json", "tracking.json"]
        outputs = {
            "report": reported,
            "base": ["models/base/model.json"],
            "front_car": ["front_car.html"],
        }
        compared = ["comparison.json"] if len(self.config.tested) > 1 else []
        pages = [
            path
            for name in self.config.tested
            for path in (f"reports/{name}.html", f"evidence/{name}.json")
        ]
        outputs["detectors"] = [*pages, "measures.json", *compared]
        return [f"{self.root}/{name}" for name in outputs[self.config.goal]]

    @property
    def compared(self) -> dict[str, str]:
        """The comparison, the tests that it compares, and the changed ones."""
        files = {
            "comparison": "comparison.json",
            "table": "comparison.parquet",
            "changes": "changes.csv",
        }
        return {kind: f"{self.root}/{name}" for kind, name in files.items()}

    @property
    def plots(self) -> list[str]:
        """The report's plots."""
        each = [
            f"{kind}_{scenario}"
            for scenario in self.config.search
            for kind in ("kpi", "pairs", "failures")
        ]
        rounds = ["rounds"] if self.config.retraining.rounds > 1 else []
        border = ["border"] if self.config.sources else []
        names = (
            "theta",
            "coverage",
            "comparison",
            "detection",
            "histogram",
            "reliability",
            *border,
            *rounds,
            *each,
        )
        return [f"{self.root}/plots/{name}.png" for name in names]

    @property
    def shipped(self) -> dict[str, str]:
        """The files of the shipped detector, if the base version is made from it."""
        folder = self.config.base.weights
        named = {
            f"shipped_{kind}": f"{folder}/{name}"
            for kind, name in VERSION_FILES.items()
            if kind != "onnx"
        }
        return named if self.config.base.source == "shipped" else {}

    @property
    def overrules(self) -> list[str]:
        """A person's table of overruled frames, if there is one."""
        return [self.config.filter.overrules] if self.config.filter.overrules else []

    def space(self, scenario: str) -> str:
        """The scenario space of a scenario."""
        return f"{self.root}/space/{scenario}.json"

    def spaces(self, scenarios: Iterable[str]) -> list[str]:
        """The scenario spaces of some scenarios."""
        return [self.space(name) for name in scenarios]

    def dataset(self, name: str) -> dict[str, str]:
        """The parts of a data set that steps read: its truth and its image folder."""
        return {
            "truth": f"{self.root}/{name}/truth.coco.json",
            "images": f"{self.root}/{name}/images/",
        }

    def written_dataset(self, name: str) -> dict[str, str]:
        """All files of a data set, including the labels and names in YOLO's form."""
        return {
            **self.dataset(name),
            "labels": f"{self.root}/{name}/labels/",
            "names": f"{self.root}/{name}/dataset.yaml",
        }

    def version(self, version: str, folder: str | None = None) -> dict[str, str]:
        """The files of a model version."""
        root = folder or ("models" if version == "base" else "retrained/models")
        return {
            kind: f"{self.root}/{root}/{version}/{name}" for kind, name in VERSION_FILES.items()
        }

    def regions(self, version: str, scenario: str) -> str:
        """The failure regions of a version on a scenario."""
        return f"{self.root}/regions/{version}/{scenario}.json"

    def why(self, version: str, scenario: str) -> str:
        """The failures of these regions, as executed and with single changes."""
        return f"{self.root}/regions/{version}/{scenario}.parquet"

    def search(
        self,
        name: str,
        scenario: str | None = None,
        strategy: str | None = None,
        version: str = "base",
        seeds: Sequence[int] | None = None,
    ) -> list[str]:
        """The file `name` of the search campaigns against a version.

        Campaigns of later rounds, which test retrained versions, are stored with these versions.

        Args:
            name: of the file in each campaign's folder.
            scenario: None for all of the search.
            strategy: None for all.
            version: the version under test.
            seeds: None for all.
        """
        config, described = self.config, self.config.version(version)
        if seeds is None:
            seeds = config.own_seeds(described) if described.round else config.seeds
        scenarios = [scenario] if scenario else config.search
        strategies = [strategy] if strategy else config.strategies
        root = f"{self._where(described)}/campaigns"
        return [
            f"{root}/{a}/{b}/{version}/{seed}/{name}"
            for a in scenarios
            for b in strategies
            for seed in seeds
        ]

    def _where(self, version: Version) -> str:
        """The folder of what belongs to a version."""
        return f"{self.root}/retrained" if version.round else self.root

    @property
    def searches(self) -> list[str]:
        """The tests of the search campaigns against every version that was not retrained."""
        return [
            path
            for v in self.config.versions
            if not v.round
            for path in self.search("tests.parquet", version=str(v))
        ]

    def audit(self, version: str) -> list[str]:
        """The tests of the random campaigns beside the searches against a version.

        There are none if a search is random itself.
        """
        scenarios, seeds = self.config.search if self.config.audited else (), self.config.seeds
        return [
            f"{self.root}/{AUDITS}/{scenario}/{AUDIT}/{version}/{seed}/tests.parquet"
            for scenario in scenarios
            for seed in seeds
        ]

    @property
    def audits(self) -> list[str]:
        """The tests of the audit of every version that was not retrained."""
        return [path for v in self.config.versions if not v.round for path in self.audit(str(v))]

    def earlier(
        self, kind: str, scenario: str, strategy: str, version: str, seed: str
    ) -> list[str]:
        """The tests of the earlier campaigns that a campaign learns from.

        These have the same version and seed, and scenarios before its own.
        """
        return [
            f"{self.root}/{kind}/{a}/{strategy}/{version}/{seed}/tests.parquet"
            for a in self.config.earlier(scenario, strategy)
        ]

    @property
    def later_searches(self) -> list[str]:
        """The tests of the campaigns that later rounds train on.

        They run each arm's strategy against its earlier versions.
        """
        later = self.config.later.items()
        return [
            path
            for version, strategy in later
            for path in self.search("tests.parquet", strategy=strategy, version=version)
        ]

    def held_out(self, name: str) -> list[str]:
        """The file `name` of the comparison's campaigns."""
        config, chosen = self.config, self.config.comparison
        root = f"{self.root}/held_out"
        return [
            f"{root}/{a}/{chosen.strategy}/{version}/{chosen.seed}/{name}"
            for a in config.held_out
            for version in config.versions
        ]

    @property
    def second_iou(self) -> list[str]:
        """The comparison's tests judged at a second IoU, if the study asks for it."""
        return self.held_out("second_iou.parquet") if self.config.comparison.second_iou else []

    def added(self, version: str, arm: str, name: str) -> list[str]:
        """The file `name` of the campaigns that feed an arm's version of the same round and seed as
        `version`.
        """
        config, described = self.config, self.config.version(version)
        strategy, seeds = config.sources[arm], config.own_seeds(described)
        return [
            path
            for v in _tested(described, arm)
            for path in self.search(name, strategy=strategy, version=str(v), seeds=seeds)
        ]

    def added_filters(self, version: str, arm: str) -> list[str]:
        """The filter tables of these campaigns."""
        return [
            self.filter(self.config.sources[arm], str(v))
            for v in _tested(self.config.version(version), arm)
        ]

    def scenes(self, version: str, arm: str) -> str:
        """The data set, below the study's folder, of the new scenes that feed an arm's version of
        the same seed as `version`.
        """
        described, seeds = self.config.version(version), self.config.retraining.seeds
        seed = seeds[0] if described.seed is None else described.seed
        return f"retrained/scenes/{self.config.arms[arm]}/{seed}"

    def filter(self, strategy: str, version: str = "base") -> str:
        """The filter table of a strategy's campaigns against a version."""
        return f"{self._where(self.config.version(version))}/filter/{strategy}/{version}.csv"

    def model(self, version: str, name: str) -> str:
        """The file `name` of a model version."""
        return f"{self._where(self.config.version(version))}/models/{version}/{name}"

    def detector(self, version: str) -> str:
        """The file that tests of a version load."""
        if self.config.goal != "detectors":
            return self.model(version, "model.onnx")
        file = self.config.tested[version]
        return self.exported(version) if file.endswith(WEIGHTS_SUFFIX) else file

    def exported(self, version: str) -> str:
        """The ONNX file of weights that the study only tests."""
        return f"{self.root}/exported/{version}.onnx"

    def calibration(self, version: str) -> str:
        """The calibration of a detector that the study only tests."""
        return f"{self.root}/calibration/{version}.json"

    def calibrations(self, versions: Iterable[str]) -> list[str]:
        """The calibrations of some detectors, if the study calibrates what it tests."""
        return [self.calibration(version) for version in versions] if self.config.calibrate else []

    def parent(self, version: str, name: str) -> str:
        """The file `name` of the version that a version is retrained from."""
        return self.model(str(self.config.version(version).parent), name)

    @property
    def cards(self) -> list[str]:
        """The cards of the model versions; detectors that a study only tests have none."""
        return [] if self.config.goal == "detectors" else self.models("model.json")

    def models(self, name: str) -> list[str]:
        """The file `name` of every model version."""
        return [self.model(str(version), name) for version in self.config.versions]


def _tested(version: Version, arm: str) -> list[Version]:
    """The versions whose campaigns feed an arm's version of its round and seed, oldest first."""
    return [replace(v, arm=arm) if v.round else v for v in version.tested]
