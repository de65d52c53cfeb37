"""Labelled images on disk: YOLO layout for every trainer, truth.coco.json for every evaluator.

images/{train,val}/NNNNNN.jpg, labels/{train,val}/NNNNNN.txt, dataset.yaml and truth.coco.json lie
under one root.
"""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from pipeline.artefacts import stamps
from pipeline.artefacts.files import read_bytes, read_json, write_bytes, write_json
from pipeline.core.boxes import Box
from pipeline.core.space import Value
from pipeline.core.truth import Truth
from pipeline.core.worlds import Worlds
from pipeline.errors import InputError

Split = Literal["train", "val"]
SPLITS: tuple[Split, Split] = ("train", "val")
TRUTH_FILE = "truth.coco.json"
CATEGORY_ID = 1
JPEG = (
    cv2.IMWRITE_JPEG_QUALITY,
    95,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
    cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
)

SEGMENT_COLOURS = np.array(
    [
        (118, 168, 214), (104, 96, 112), (245, 245, 245), (196, 170, 184),
        (150, 190, 120), (92, 88, 84), (84, 128, 60), (160, 160, 160),
        (220, 50, 60), (60, 80, 170), (250, 190, 30), (40, 200, 210),
    ],
    np.uint8,
)  # fmt: skip
"""Colours of a segmentation, (classes, 3) RGB."""


@dataclass(frozen=True)
class Record:
    """An image's entry in truth.coco.json; width and height in pixels.

    Attributes:
        tags: written at its annotation, too, where other tools look.
    """

    split: Split
    index: int
    width: int
    height: int
    truth: Truth
    attributes: Mapping[str, Value] = field(default_factory=dict)
    tags: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class ImageSet:
    """A split in memory.

    Attributes:
        images: (n, h, w, 3) uint8 RGB.
        boxes, whole_boxes: (n, 4) float32 left, top, right, bottom in pixels, zeros without a
            pedestrian.
        visible_pixels: (n,) int64.
        contrast: (n,) float32 grey levels.
        digest: SHA-256 of truth and image files.
    """

    images: NDArray[np.uint8]
    boxes: NDArray[np.float32]
    whole_boxes: NDArray[np.float32]
    visible_pixels: NDArray[np.int64]
    contrast: NDArray[np.float32]
    digest: str = ""

    def __post_init__(self) -> None:
        if self.images.ndim != 4 or self.images.shape[3] != 3 or self.images.dtype != np.uint8:
            raise ValueError(
                f"images must be (n, h, w, 3) uint8, got {self.images.shape} {self.images.dtype}"
            )
        n = len(self.images)
        shapes = {"boxes": (n, 4), "whole_boxes": (n, 4), "visible_pixels": (n,), "contrast": (n,)}
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} must have shape {shape}, got {getattr(self, name).shape}")

    def __len__(self) -> int:
        return len(self.images)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the images, pixels."""
        return int(self.images.shape[2]), int(self.images.shape[1])

    def take(self, indices: NDArray[np.int64], digest: str = "") -> ImageSet:
        """The images at the given indices."""
        return ImageSet(
            self.images[indices],
            self.boxes[indices],
            self.whole_boxes[indices],
            self.visible_pixels[indices],
            self.contrast[indices],
            digest,
        )


def image_set(labelled: Sequence[tuple[NDArray[np.uint8], Truth]], digest: str = "") -> ImageSet:
    """Gather (image, truth) pairs of one image size.

    Raises:
        ValueError: if there are none or the sizes differ.
    """
    shapes = {image.shape for image, _ in labelled}
    if len(shapes) != 1:
        raise ValueError(
            f"images must be at least one and of one size, got {len(labelled)} of sizes "
            f"{sorted(shapes)}"
        )
    return _labelled(
        np.stack([image for image, _ in labelled]), [truth for _, truth in labelled], digest
    )


def _labelled(images: NDArray[np.uint8], truths: Sequence[Truth], digest: str) -> ImageSet:
    return ImageSet(
        images=images,
        boxes=np.array([truth.visible_box or (0.0,) * 4 for truth in truths], np.float32),
        whole_boxes=np.array([truth.whole_box or (0.0,) * 4 for truth in truths], np.float32),
        visible_pixels=np.array([truth.visible_pixels for truth in truths], np.int64),
        contrast=np.array([truth.contrast for truth in truths], np.float32),
        digest=digest,
    )


def joined(first: ImageSet, second: ImageSet) -> ImageSet:
    """Both sets, concatenated; ValueError if their images' sizes differ."""
    if first.size != second.size:
        raise ValueError(f"images must be of one size, got {first.size} and {second.size}")
    return ImageSet(
        images=np.concatenate([first.images, second.images]),
        boxes=np.concatenate([first.boxes, second.boxes]),
        whole_boxes=np.concatenate([first.whole_boxes, second.whole_boxes]),
        visible_pixels=np.concatenate([first.visible_pixels, second.visible_pixels]),
        contrast=np.concatenate([first.contrast, second.contrast]),
        digest=hashlib.sha256(f"{first.digest} {second.digest}".encode()).hexdigest(),
    )


def encode_jpeg(image: NDArray[np.uint8]) -> bytes:
    """(h, w, 3) uint8 RGB to JPEG, quality 95, colours at full resolution.

    Equal images give equal bytes.
    """
    return bytes(cv2.imencode(".jpg", image[:, :, ::-1], JPEG)[1])


def decode_jpeg(data: bytes) -> NDArray[np.uint8]:
    """JPEG bytes to (h, w, 3) uint8 RGB; ValueError if they are not a JPEG image."""
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB) if data else None
    if image is None:
        raise ValueError("the bytes are not a JPEG image")
    return np.asarray(image, np.uint8)


def write_image(
    root: Path, split: Split, index: int, image: NDArray[np.uint8], truth: Truth
) -> None:
    """Write one image and its YOLO label, unflushed; the label is empty if no pedestrian shows."""
    height, width = image.shape[:2]
    write_bytes(image_path(root, split, index), encode_jpeg(image), flush=False)
    label = ""
    if truth.visible_box is not None:
        left, top, right, bottom = truth.visible_box
        centre_x, centre_y = (left + right) / 2 / width, (top + bottom) / 2 / height
        size_x, size_y = (right - left) / width, (bottom - top) / height
        label = f"0 {centre_x:.6f} {centre_y:.6f} {size_x:.6f} {size_y:.6f}\n"
    write_bytes(_label_path(root, split, index), label.encode(), flush=False)


def write_classes(root: Path, split: Split, index: int, classes: NDArray[np.uint8]) -> None:
    """Write one segmentation, (h, w) class numbers, as an unflushed PNG.

    Its palette makes it readable, its values are class numbers.
    """
    picture = Image.fromarray(classes, mode="P")
    picture.putpalette(SEGMENT_COLOURS.tobytes())
    buffer = io.BytesIO()
    picture.save(buffer, "png")
    write_bytes(segments_path(root, split, index), buffer.getvalue(), flush=False)


def remove_leftovers(root: Path, records: Iterable[Record]) -> None:
    """Delete the images, labels and segmentations that these records do not name, of an earlier
    data set or of a killed writer.
    """
    wanted = {f"{record.split}/{record.index:06d}" for record in records}
    for pattern in ("images/*/*", "labels/*/*", "segments/*/*", "segments/.*"):
        for path in list(root.glob(pattern)):
            if f"{path.parent.name}/{path.stem}" not in wanted:
                path.unlink()


def place_dataset(source: Path, root: Path) -> None:
    """Put a finished data set in its final place, instead of any older one there.

    `source` keeps its files, so that a kill loses none.
    """
    for name in ("images", "labels", "segments", "dataset.yaml", TRUTH_FILE):
        part = source / name
        if part.exists():
            stamps.remove(root / name)
        for file in (part, *part.rglob("*")):
            if not file.is_file():
                continue
            path = root / file.relative_to(source)
            path.parent.mkdir(parents=True, exist_ok=True)
            try:
                path.hardlink_to(file)
            except OSError:  # A disk without second names.
                write_bytes(path, file.read_bytes(), flush=False)
    os.sync()  # For hundreds of small files, a hundred times as fast as one by one.


def images_sha256(root: Path, records: Iterable[Record]) -> str:
    """Hexadecimal SHA-256 of the images and labels of some records; OSError if one is missing."""
    paths = (
        path_of(root, record.split, record.index)
        for record in records
        for path_of in (image_path, _label_path)
    )
    return hashlib.sha256("".join(map(stamps.digest, paths)).encode()).hexdigest()


def write_truth(root: Path, records: Iterable[Record], category: str = "pedestrian") -> None:
    """Write truth.coco.json and dataset.yaml for the records, ordered by split and index.

    The file is plain COCO with additions: images carry `split`, the scenario variables and the box
    of a fully hidden pedestrian; annotations carry visible_pixels, whole_pixels, contrast and
    whole_bbox.
    """
    ordered = sorted(records, key=lambda record: (record.split, record.index))
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for number, record in enumerate(ordered, 1):
        truth = record.truth
        hidden = truth.visible_box is None
        images.append(
            {
                "id": number,
                "file_name": f"{record.split}/{record.index:06d}.jpg",
                "width": record.width,
                "height": record.height,
                "split": record.split,
                "hidden_bbox": _corner_size(truth.whole_box) if hidden else None,
                "hidden_pixels": truth.whole_pixels if hidden else 0,
                "attributes": {**record.attributes, **record.tags},
            }
        )
        if (bbox := _corner_size(truth.visible_box)) is None:
            continue
        annotation: dict[str, Any] = {
            "id": len(annotations) + 1,
            "image_id": number,
            "category_id": CATEGORY_ID,
            "bbox": bbox,
            "area": bbox[2] * bbox[3],
            "iscrowd": 0,
            "visible_pixels": truth.visible_pixels,
            "whole_pixels": truth.whole_pixels,
            "contrast": truth.contrast,
            "whole_bbox": _corner_size(truth.whole_box),
        }
        if record.tags:
            annotation["attributes"] = dict(record.tags)
        annotations.append(annotation)
    write_json(
        root / TRUTH_FILE,
        {
            "images": images,
            "annotations": annotations,
            "categories": [{"id": CATEGORY_ID, "name": category}],
        },
    )
    splits = {record.split for record in ordered}
    train = "train" if "train" in splits else "val"
    val = "val" if "val" in splits else "train"
    # Without `path`, Ultralytics uses the folder of this file.
    names = f"train: images/{train}\nval: images/{val}\nnames:\n  0: {category}\n"
    write_bytes(root / "dataset.yaml", names.encode())


def read_dataset(root: Path, split: Split) -> ImageSet:
    """Read a split into memory.

    Raises:
        InputError: naming the file if a file is missing, has another format or another image size.
    """
    path = root / TRUTH_FILE
    plain = read_json(path)
    try:
        images = sorted(
            (i for i in plain["images"] if i["split"] == split), key=lambda i: str(i["file_name"])
        )
        annotations = {a["image_id"]: a for a in plain["annotations"]}
        truths = [_truth(image, annotations.get(image["id"])) for image in images]
        shapes = [(int(image["height"]), int(image["width"]), 3) for image in images]
    except (KeyError, TypeError) as error:
        raise InputError(
            f"{path} is not the truth file of a data set ({error!r}); ./run makes it again"
        ) from error
    if not images:
        raise InputError(
            f"{path} has no images of the split '{split}'; it needs more images, or another "
            "validation share"
        )
    digest = hashlib.sha256(read_bytes(path))
    # Filled in place: a second copy might not fit into memory.
    pixels = np.empty((len(images), *shapes[0]), np.uint8)
    for place, image in zip(pixels, images, strict=True):
        file = root / "images" / image["file_name"]
        data = read_bytes(file)
        try:
            decoded = decode_jpeg(data)
        except ValueError as error:
            raise InputError(
                f"{file}: expected a JPEG image, got {error}; ./run makes it again"
            ) from error
        if decoded.shape != place.shape:
            height, width = decoded.shape[:2]
            raise InputError(
                f"{file} must be {place.shape[1]}x{place.shape[0]}, got {width}x{height}"
            )
        digest.update(data)
        place[:] = decoded
    return _labelled(pixels, truths, digest.hexdigest())


def read_worlds(root: Path) -> Worlds:
    """The towns and the people in the images.

    Raises:
        InputError: naming the file if an image does not list its own.
    """
    path = root / TRUTH_FILE
    try:
        shown = [image["attributes"] for image in read_json(path)["images"]]
        return Worlds(
            frozenset(str(attributes["town"]) for attributes in shown),
            frozenset(str(attributes["people"]) for attributes in shown),
        )
    except (KeyError, TypeError) as error:
        raise InputError(
            f"{path} does not list the towns and people that its images show; ./run makes it again"
        ) from error


def image_path(root: Path, split: Split, index: int) -> Path:
    return root / "images" / split / f"{index:06d}.jpg"


def segments_path(root: Path, split: Split, index: int) -> Path:
    return root / "segments" / split / f"{index:06d}.png"


def _label_path(root: Path, split: Split, index: int) -> Path:
    return root / "labels" / split / f"{index:06d}.txt"


def _corner_size(box: Box | None) -> list[float] | None:
    if box is None:
        return None
    left, top, right, bottom = box
    return [float(left), float(top), float(right - left), float(bottom - top)]


def _corners(bbox: Sequence[float] | None) -> Box | None:
    return None if bbox is None else (bbox[0], bbox[1], bbox[0] + bbox[2], bbox[1] + bbox[3])


def _truth(image: Mapping[str, Any], annotation: Mapping[str, Any] | None) -> Truth:
    if annotation is None:
        return Truth(whole_box=_corners(image["hidden_bbox"]), whole_pixels=image["hidden_pixels"])
    return Truth(
        visible_box=_corners(annotation["bbox"]),
        whole_box=_corners(annotation["whole_bbox"]),
        visible_pixels=annotation["visible_pixels"],
        whole_pixels=annotation["whole_pixels"],
        contrast=annotation["contrast"],
    )
