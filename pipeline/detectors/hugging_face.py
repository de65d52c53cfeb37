"""Object detectors of Hugging Face Transformers: DETR, YOLOS, RT-DETR and others.

They need the extra `hugging-face`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.core.detections import Detections
from pipeline.core.episode import Frame
from pipeline.detectors.layouts import person_class
from pipeline.detectors.suppression import IOU, THRESHOLD, Share, inside, reported
from pipeline.errors import InputError, SimulationError, one_line

PICKLES = ("*.bin", "*.pt", "*.pth", "*.ckpt")


class HuggingFaceDetector:
    """Finds pedestrians with a model and image processor that `save_pretrained` wrote.

    Only safetensors are read, and code in the model's folder is never run.

    Args:
        model: the folder.
        threshold, iou: as for `OnnxDetector`.
        person: name or number of the pedestrian class, if the model's class names do not say.

    Raises:
        InputError: if the folder is not such a model, or its only weights need pickle.
    """

    def __init__(
        self,
        model: str | Path,
        threshold: Share = THRESHOLD,
        iou: Share = IOU,
        person: str | int | None = None,
    ) -> None:
        try:
            from transformers import AutoImageProcessor, AutoModelForObjectDetection
        except ImportError as error:
            raise InputError(
                "detectors of Hugging Face need the extra: pip install 'blindspot[hugging-face]'"
            ) from error
        self._model, self._threshold, self._iou = Path(model), threshold, iou
        if not (self._model / "config.json").is_file():
            raise InputError(
                f"{model}: expected a folder written by save_pretrained; config.json is missing"
            )
        if not list(self._model.glob("*.safetensors")):
            pickled = [path.name for pattern in PICKLES for path in self._model.glob(pattern)]
            weights = "no weights"
            if pickled:
                weights = f"{', '.join(pickled)}, which can run code when read"
            raise InputError(
                f"{model}: expected model.safetensors, found {weights};"
                " save it again with safe_serialization=True"
            )
        safe = {"local_files_only": True, "trust_remote_code": False}
        try:
            self._processor = AutoImageProcessor.from_pretrained(self._model, **safe)
            self._network = AutoModelForObjectDetection.from_pretrained(
                self._model, use_safetensors=True, **safe
            )
        except Exception as error:  # A foreign folder can make the library raise any exception.
            raise InputError(
                f"Transformers cannot load {model} as an object detector: {one_line(error)}"
            ) from error
        self._network.float().eval().requires_grad_(False)
        names = {int(number): str(name) for number, name in self._network.config.id2label.items()}
        self._person = person_class(self._model, names, len(names), person)

    def detect(self, frame: Frame) -> Detections:
        """Return the pedestrians in the image."""
        height, width = frame.image.shape[:2]
        output = self._network(**self._processor(images=frame.image, return_tensors="pt"))
        # The model's postprocessing drops such values silently.
        if (
            not np.isfinite(output.logits.numpy()).all()
            or not np.isfinite(output.pred_boxes.numpy()).all()
        ):
            raise SimulationError(f"{self._model} returns values that are not finite")
        (objects,) = self._processor.post_process_object_detection(
            output, threshold=self._threshold, target_sizes=[(height, width)]
        )
        chosen = objects["labels"].numpy() == self._person
        boxes = objects["boxes"].numpy().astype(np.float32)[chosen]
        scores = objects["scores"].numpy().astype(np.float32)[chosen]
        boxes, scores = inside(boxes, scores, width, height)
        return reported(self._model, boxes, scores, self._threshold, self._iou)
