"""The strategies that search: every file of conf/sampler, with changed settings where asked, variants, the former default, and peers."""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

import former
import peers
import variants
import yaml
from hydra.utils import instantiate
from worlds import default_study

from pipeline.core.names import nearest
from pipeline.core.space import Space
from pipeline.errors import InputError
from pipeline.protocols import Sampler
from pipeline.sources import code_digest

CEILING = "ceiling"
"""Not a strategy: it knows where tests fail."""


def known() -> list[str]:
    """The names of all strategies of conf/sampler."""
    return sorted(default_study().samplers)


def make(label: str, space: Space, seed: int) -> Sampler:
    """A strategy before its first test. label: a name, with changed settings after it, as in `forest explore=0.2`."""
    if label in peers.PEERS:
        return peers.make(label, space, seed, default_study().campaign.failure_threshold_s)
    if label in former.SAMPLERS:
        return former.SAMPLERS[label](
            space, seed, failure_threshold_s=default_study().campaign.failure_threshold_s
        )
    if _name(label) in variants.VARIANTS:
        settings = {key: value for key, value in _section(label).items() if key != "_target_"}
        return variants.VARIANTS[_name(label)](space=space, seed=seed, **settings)
    # Partial, because Hydra would turn the space, a dataclass, into a config.
    made: Sampler = instantiate(_section(label), _partial_=True, _convert_="all")(
        space=space, seed=seed
    )
    return made


def digest(label: str) -> str:
    """Text that changes with the settings and the code of a strategy; InputError for an unknown name or setting."""
    if label == CEILING:
        return ""
    if label in peers.PEERS:
        about = [version(peers.PEERS[label]), inspect.getsource(peers.kind_of(label))]
    elif label in former.SAMPLERS:
        about = [inspect.getsource(former)]
    else:
        section = _section(label)
        about = [
            json.dumps(section, sort_keys=True),
            code_digest(section["_target_"].rpartition(".")[0]),
        ]
        about += [inspect.getsource(variants)] if _name(label) in variants.VARIANTS else []
    return hashlib.sha256("".join(about).encode()).hexdigest()


def _name(label: str) -> str:
    return label.split()[0]


def _section(label: str) -> Mapping[str, Any]:
    name, samplers = _name(label), default_study().samplers
    if name not in samplers and name not in variants.VARIANTS:
        raise InputError(
            f"there is no strategy '{name}'{nearest(name, [*samplers, *variants.VARIANTS, *former.SAMPLERS, *peers.PEERS, CEILING])}"
        )
    section = dict(samplers["forest" if name in variants.VARIANTS else name])
    for change in label.split()[1:]:
        key, _, value = change.partition("=")
        section[key] = yaml.safe_load(value)
    return section
