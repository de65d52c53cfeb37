"""weights.safetensors: the network's weights at half precision, and its architecture."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from pipeline.artefacts.files import read_bytes, write_bytes
from pipeline.artefacts.model_card import read_card
from pipeline.detectors.yolo.network import Architecture, Yolo
from pipeline.errors import InputError

COUNTERS = "num_batches_tracked"


def save_weights(path: Path, model: Yolo) -> None:
    """Write the weights as float16; the same weights give the same bytes."""
    tensors = {}
    for name, tensor in _tensors(model).items():
        tensors[name] = tensor.detach().half().cpu().contiguous()
    # A single key: the format does not keep the order of several.
    architecture = json.dumps(asdict(model.architecture), sort_keys=True)
    write_bytes(path, save(tensors, {"architecture": architecture}))


def load_weights(path: Path) -> Yolo:
    """Read a network in float32, in evaluation mode.

    Raises:
        InputError: names the file if it holds no such network, or not that of the card beside it.
    """
    if not path.is_file():
        raise InputError(
            f"{path}: expected the weights of a detector (weights.safetensors), found no file;"
            " train a detector first"
        )
    digest, card = hashlib.sha256(read_bytes(path)).hexdigest(), path.with_name("model.json")
    if card.exists() and (expected := read_card(card).weights_sha256) != digest:
        raise InputError(
            f"{path}: damaged or of another version, its SHA-256 must be {expected} ({card.name}),"
            f" got {digest}"
        )
    try:
        with safe_open(path, framework="pt") as file:
            plain = json.loads((file.metadata() or {})["architecture"])
            names = list(file.keys())
            tensors = {name: file.get_tensor(name).float() for name in names}
        architecture = Architecture(widths=tuple(plain["widths"]), head=plain["head"])
    except (SafetensorError, KeyError, TypeError, ValueError) as error:
        raise InputError(
            f"{path} holds no Blindspot detector ({error}); train one with `train`"
        ) from error
    model = Yolo(architecture)
    expected_tensors = _tensors(model)
    for name in sorted(tensors.keys() ^ expected_tensors.keys()):
        raise InputError(
            f"{path}: expected the {len(expected_tensors)} tensors of our network;"
            f" '{name}' is missing or unexpected"
        )
    for name, tensor in expected_tensors.items():
        if tensors[name].shape != tensor.shape:
            raise InputError(
                f"{path}: '{name}' must have shape {tuple(tensor.shape)},"
                f" got {tuple(tensors[name].shape)}"
            )
    model.load_state_dict(tensors, strict=False)
    return model.eval()


def _tensors(model: Yolo) -> dict[str, torch.Tensor]:
    return {
        name: tensor for name, tensor in model.state_dict().items() if not name.endswith(COUNTERS)
    }
