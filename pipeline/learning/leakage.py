"""Guards against training on towns, people, scenarios and frames that judge a version."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pipeline.artefacts.dataset import ImageSet, read_worlds
from pipeline.artefacts.model_card import ModelCard, read_card
from pipeline.artefacts.scenario_space import ScenarioInfo, read_space
from pipeline.config.schema import Config
from pipeline.core.worlds import Worlds
from pipeline.errors import InputError


def refuse_worlds(
    config: Config, image_sets: Sequence[Path], spaces: Sequence[Path], parent: Path | None = None
) -> Worlds:
    """Check that a version's training data shows no town and no people of a held-out scenario.

    It compares the fingerprints in the files, which an older config may have written. The same
    values in another town are a different scenario.

    Args:
        config: of the study.
        image_sets: their truth.coco.json.
        spaces: files of the searched scenarios.
        parent: model.json of the version that training continues from.

    Returns:
        All towns and people in the training data.

    Raises:
        InputError: names the file and the held-out scenario.
    """
    sources = {f"{path} shows": read_worlds(path.parent) for path in image_sets}
    sources |= {f"{path} describes": read_space(path)[0].worlds for path in spaces}
    if parent is not None:
        sources[f"{parent} was trained on"] = read_card(parent).worlds
    unseen = config.unseen
    for where, worlds in sources.items():
        for kind, world in worlds:
            if world in unseen:
                raise InputError(
                    f"{where} the {kind} of held-out {unseen[world]}, so it must not be used for"
                    " training; hold out another scenario"
                )
    return Worlds.union(sources.values())


def refuse_learnt(cards: Sequence[ModelCard], held_out: Sequence[ScenarioInfo]) -> None:
    """Check that no compared version was trained on a town or on people of held-out scenarios.

    Args:
        cards: of the versions.
        held_out: scenarios of the comparison.

    Raises:
        InputError: names the version and the scenario.
    """
    for card in cards:
        for info in held_out:
            for kind, _ in card.worlds & info.worlds:
                raise InputError(
                    f"version '{card.version}' was trained on the {kind} of held-out {info.name},"
                    " so its failures there prove nothing"
                )


def refuse_frames(
    held_out: Sequence[str], chosen: pd.DataFrame, added: ImageSet, validation: ImageSet
) -> None:
    """Check that no added frame comes from a held-out scenario or is a validation image.

    Args:
        held_out: names of the scenarios.
        chosen: test_id and scenario of each added frame.
        added: images of the added frames.
        validation: images.

    Raises:
        InputError: names the tests.
    """
    if leaked := sorted(set(chosen.loc[chosen["scenario"].isin(held_out), "test_id"])):
        raise InputError(
            f"training must not use frames of held-out scenarios: {', '.join(leaked[:5])};"
            " make the filter tables again"
        )
    digests = {hashlib.sha256(image.tobytes()).digest() for image in validation.images}
    for test, image in zip(chosen["test_id"], added.images, strict=True):
        if hashlib.sha256(image.tobytes()).digest() in digests:
            raise InputError(
                f"a frame of {test} is a validation image, so it must not be used for training"
            )
