"""A version's ONNX file as a model that MLflow can load and serve."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path


def save_served(onnx_file: Path, folder: Path, limits: Mapping[str, float]) -> None:
    """Write MLflow's model of an ONNX file. limits: the detector's `threshold` and `iou`."""
    import mlflow.pyfunc
    import numpy as np
    from mlflow.models import ModelSignature
    from mlflow.types import ColSpec, Schema, TensorSpec

    from pipeline.tracking import served_detector

    images = TensorSpec(np.dtype(np.uint8), (-1, -1, -1, 3))
    boxes = []
    for name in served_detector.COLUMNS:
        boxes.append(ColSpec("long" if name == "image" else "double", name))
    # The warnings ask for a schema, which is here.
    with warnings.catch_warnings(category=UserWarning, action="ignore"):
        mlflow.pyfunc.save_model(
            folder,
            python_model=served_detector.__file__,
            artifacts={"onnx": str(onnx_file)},
            model_config=dict(limits),
            signature=ModelSignature(Schema([images]), Schema(boxes)),
            # Without this list, MLflow runs the model in another process to find its requirements.
            pip_requirements=["mlflow", "numpy", "onnxruntime", "opencv-python-headless", "pandas"],
        )
