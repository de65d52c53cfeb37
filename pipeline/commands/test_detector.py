"""The command `test-detector`: the search campaigns of a study against any detector, without training anything."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from hydra.utils import instantiate

from pipeline.artefacts.files import program_sha256, sha256, write_bytes
from pipeline.artefacts.results import FailureRegions, Measures, read
from pipeline.config.composing import dump
from pipeline.config.schema import Config
from pipeline.errors import InputError, SimulationError
from pipeline.progress import Progress
from pipeline.steps import campaign, cluster, define_space, measure
from pipeline.testing import check_detector

VERSION = "base"
"""What the tables call the detector under test."""


@dataclass(frozen=True)
class Found:
    """What the campaigns found."""

    measures: Measures
    regions: tuple[FailureRegions, ...]


def run(config: Config, *, model: Path, out: Path, threads: int) -> Found:
    """Test a detector and write spaces, campaigns, measures.json and regions/ into `out`.

    model: the detector's file. What an earlier call of the same program with the same settings and the same file finished is not executed
    again; the campaign that was under way goes on from its journal. Delete `out` to begin anew.
    """
    settings = dump(config, f"python -m pipeline test-detector {model}")
    write_bytes(out / "params.yaml", settings.encode())
    stamp = hashlib.sha256((settings + sha256(model) + program_sha256()).encode()).hexdigest().encode()
    spaces, tests = {}, {}
    for name in config.search:
        spaces[name] = out / "space" / f"{name}.json"
        with Progress(f"space {name}") as progress:
            define_space.run(config, scenario=name, out=spaces[name], progress=progress)
    for name in config.search:
        for strategy in config.strategies:
            for seed in config.seeds:
                where = f"{name}/{strategy}/{VERSION}/{seed}"
                tests[name, strategy, seed] = path = out / "campaigns" / where / "tests.parquet"
                done = path.with_name("stamp")
                if path.is_file() and done.is_file() and done.read_bytes() == stamp:
                    continue
                done.unlink(missing_ok=True)  # A kill between the tables and their new stamp must not leave the old one beside them.
                with Progress(f"campaign {name} {strategy} {seed}") as progress:
                    campaign.run(
                        config,
                        scenario=name,
                        strategy=strategy,
                        version=VERSION,
                        seed=seed,
                        space=spaces[name],
                        model=model,
                        earlier=[tests[other, strategy, seed] for other in config.earlier(name, strategy)],
                        out=path,
                        journal=out / "journal" / where,
                        threads=threads,
                        progress=progress,
                    )
                write_bytes(done, stamp)
    measures, regions = out / "measures.json", [out / "regions" / f"{name}.json" for name in config.search]
    with Progress("measure") as progress:
        measure.run(
            config, tests=list(tests.values()), spaces=list(spaces.values()), out=measures, theta=out / "theta.csv", progress=progress
        )
    for name, path in zip(config.search, regions, strict=True):
        with Progress(f"regions {name}") as progress:
            mine = [tests[key] for key in tests if key[0] == name]
            cluster.run(config, tests=mine, space=spaces[name], out=path, progress=progress)
    return Found(read(measures, Measures), tuple(read(path, FailureRegions) for path in regions))


def default_folder(model: Path) -> Path:
    """Where a detector's results lie: named after it and, as many exports are called best.onnx, after its content."""
    return Path("data/detectors") / f"{model.name.removesuffix('.onnx')}-{sha256(model)[:8]}"


def check(config: Config, model: Path) -> None:
    """Show the detector three images; InputError if it breaks its contract, by the first rule that it breaks."""
    camera = config.simulator.get("camera", {})
    width, height = int(camera.get("width", 320)), int(camera.get("height", 192))
    detector = instantiate(config.detector, _partial_=True, _convert_="all")(model=str(model))
    try:
        check_detector(detector, width, height)
    except AssertionError as error:
        raise InputError(f"{model}: {error}") from error
    except SimulationError as error:
        raise InputError(str(error)) from error
    except InputError:
        raise
    except Exception as error:  # A stranger's class may raise anything.
        raise InputError(f"{model}: detect failed: {type(error).__name__}: {error}") from error


def table(found: Found) -> str:
    """Failures by scenario and strategy, and the regions, as text. A broken test is in no rate."""
    lines = [
        f"{'scenario':10}{'strategy':12}{'tests':>6}{'broken':>8}{'fail':>6}{'contact':>9}{'late':>6}{'false positives':>17}   failure rate"
    ]
    for row in found.measures.strategies:
        rate = f"{100 * row.rate.value:.1f} % ({100 * row.rate.low:.1f} to {100 * row.rate.high:.1f})"
        counts = f"{row.tests:>6}{row.errors:>8}{row.failures:>6}{row.modes.contact:>9}{row.modes.late:>6}{row.modes.false_positives:>17}"
        lines.append(f"{row.scenario:10}{row.strategy:12}{counts}   {rate}")
    for regions in found.regions:
        for region in regions.regions:
            inside = f"{region.failures_inside} of {region.support} tests inside fail"
            lines.append(f"{regions.scenario} {region.name}: {region.rule} ({inside})")
    return "\n".join(lines)
