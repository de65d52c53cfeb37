"""An ONNX detector as a model that MLflow can load."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from mlflow.types import Schema


def save_onnx(onnx_file: Path, folder: Path) -> None:
    """Write an ONNX file as MLflow's onnx model, with the signature of its inputs and outputs."""
    import mlflow.onnx
    import onnx
    from mlflow.models import ModelSignature
    from mlflow.types import Schema, TensorSpec

    model = onnx.load(str(onnx_file))

    def schema(values: Any) -> Schema:
        specs = []
        for value in values:
            tensor = value.type.tensor_type
            shape = tuple(side.dim_value if side.HasField("dim_value") else -1 for side in tensor.shape.dim)
            specs.append(TensorSpec(np.dtype(onnx.helper.tensor_dtype_to_np_dtype(tensor.elem_type)), shape, value.name))
        return Schema(specs)

    signature = ModelSignature(inputs=schema(model.graph.input), outputs=schema(model.graph.output))
    # Named here, because MLflow would otherwise run the model in another process to find them.
    mlflow.onnx.save_model(model, folder, signature=signature, pip_requirements=["onnx", "onnxruntime", "numpy"])
