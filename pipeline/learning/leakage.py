"""Guards against training on towns, scenarios and frames that judge a version."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from pipeline.artefacts.dataset import ImageSet, read_towns
from pipeline.artefacts.model_card import ModelCard, read_card
from pipeline.artefacts.scenario_space import ScenarioInfo, read_space
from pipeline.config.schema import Config
from pipeline.errors import InputError


def refuse_towns(config: Config, base_set: Path, spaces: Sequence[Path], parent: Path | None = None) -> tuple[str, ...]:
    """The fingerprints of all towns in a version's training data. InputError with the name of a held-out scenario if its town is among
    them.

    Compares the fingerprints of the towns that the files were made from, possibly by an older config. A concrete scenario is a town and the
    values of its variables, so one in another town is another one. base_set: its truth.coco.json. spaces: of the searched scenarios.
    parent: model.json of the version that training continues from.
    """
    unseen = {config.scenarios[name].town.fingerprint: name for name in config.held_out}
    found = [(town, f"{base_set} shows") for town in sorted(read_towns(base_set.parent))]
    found += [(read_space(path)[0].town, f"{path} describes") for path in spaces]
    if parent is not None:
        found += [(town, f"{parent} has learnt") for town in read_card(parent).towns]
    for town, where in found:
        if town in unseen:
            raise InputError(f"{where} the town of held-out {unseen[town]}, so it must not be used for training; hold out another scenario")
    return tuple(sorted({town for town, _ in found}))


def refuse_learnt(cards: Sequence[ModelCard], held_out: Sequence[ScenarioInfo]) -> None:
    """InputError if a version was trained on a town of the held-out scenarios of its comparison."""
    towns = {info.town: info.name for info in held_out}
    for card in cards:
        for town in card.towns:
            if town in towns:
                raise InputError(
                    f"version '{card.version}' has learnt the town of held-out {towns[town]}, so its failures there prove nothing"
                )


def refuse_frames(held_out: Sequence[str], chosen: pd.DataFrame, added: ImageSet, validation: ImageSet) -> None:
    """InputError that names the tests if a frame comes from a held-out scenario or is a validation image.

    chosen: test_id and scenario of each added frame.
    """
    if leaked := sorted(set(chosen.loc[chosen["scenario"].isin(held_out), "test_id"])):
        raise InputError(f"training must not use frames of held-out scenarios: {', '.join(leaked[:5])}; make the filter tables again")
    known = {hashlib.sha256(image.tobytes()).digest() for image in validation.images}
    for test, image in zip(chosen["test_id"], added.images, strict=True):
        if hashlib.sha256(image.tobytes()).digest() in known:
            raise InputError(f"a frame of {test} is a validation image, so it must not be used for training")
