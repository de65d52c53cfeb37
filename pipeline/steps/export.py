"""Step `export`: makes the ONNX file of a published version that a study only tests."""

from __future__ import annotations

from pathlib import PurePosixPath

from pipeline.artefacts.folders import Folders
from pipeline.artefacts.model_card import read_card
from pipeline.artefacts.scenario_space import read_spaces
from pipeline.contract import Files, Job, Step, Wildcards
from pipeline.core.lineage import VERSION_FILES
from pipeline.errors import InputError


def _reads(folders: Folders, wildcards: Wildcards) -> dict[str, Files]:
    tested, version = folders.config.tested, wildcards["version"]
    if version not in tested:
        raise InputError(
            f"version: '{version}' is no tested detector; known are {', '.join(tested) or 'none'}"
        )
    weights = PurePosixPath(tested[version])
    return {
        "weights": str(weights),
        "card": str(weights.with_name(VERSION_FILES["card"])),
        "spaces": folders.spaces(folders.config.held_out),
    }


STEP = Step(
    "Export the weights of a version under test.",
    reads=_reads,
    writes=lambda folders: {"onnx": folders.exported("{version}")},
    sections=(),
)


def run(job: Job) -> None:
    """Write the ONNX file, with the calibration of the version's card.

    Raises:
        InputError: the version learnt from a held-out town or its people.
    """
    from pipeline.detectors.yolo.export import export_version
    from pipeline.learning.leakage import refuse_learnt

    held_out = [info for info, _ in read_spaces(job.inputs("spaces")).values()]
    refuse_learnt([read_card(job.input("card"))], held_out)
    export_version(job.input("weights"), job.input("card"), job.output("onnx"))
