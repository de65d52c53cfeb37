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
    """All towns and people in a version's training data. InputError with the name of a held-out scenario if its town or its people are
    among them.

    Compares the fingerprints that the files were made from, possibly by an older config. A concrete scenario is a town and the values of
    its variables, so one in another town is another one. image_sets: their truth.coco.json. spaces: of the searched scenarios. parent:
    model.json of the version that training continues from.
    """
    found = {f"{path} shows": read_worlds(path.parent) for path in image_sets}
    found |= {f"{path} describes": read_space(path)[0].worlds for path in spaces}
    if parent is not None:
        found[f"{parent} was trained on"] = read_card(parent).worlds
    unseen = config.unseen
    for where, worlds in found.items():
        for kind, one in worlds:
            if one in unseen:
                raise InputError(
                    f"{where} the {kind} of held-out {unseen[one]}, so it must not be used for training; hold out another scenario"
                )
    return Worlds.union(found.values())


def refuse_learnt(cards: Sequence[ModelCard], held_out: Sequence[ScenarioInfo]) -> None:
    """InputError if a version was trained on a town or on people of the held-out scenarios of its comparison."""
    for card in cards:
        for info in held_out:
            for kind, _ in card.worlds & info.worlds:
                raise InputError(
                    f"version '{card.version}' was trained on the {kind} of held-out {info.name}, so its failures there prove nothing"
                )


def refuse_frames(
    held_out: Sequence[str], chosen: pd.DataFrame, added: ImageSet, validation: ImageSet
) -> None:
    """InputError that names the tests if a frame comes from a held-out scenario or is a validation image.

    chosen: test_id and scenario of each added frame.
    """
    if leaked := sorted(set(chosen.loc[chosen["scenario"].isin(held_out), "test_id"])):
        raise InputError(
            f"training must not use frames of held-out scenarios: {', '.join(leaked[:5])}; make the filter tables again"
        )
    known = {hashlib.sha256(image.tobytes()).digest() for image in validation.images}
    for test, image in zip(chosen["test_id"], added.images, strict=True):
        if hashlib.sha256(image.tobytes()).digest() in known:
            raise InputError(
                f"a frame of {test} is a validation image, so it must not be used for training"
            )
