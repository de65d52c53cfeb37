"""Render the same scenes by EGL and by OSMesa, and print how their images and labels differ.

Usage: python tools/compare_backends.py [IMAGES]   (default 200; needs both libraries)
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

BACKENDS = ("egl", "osmesa")
SCENES_PER_TOWN = 10


def render(count: int, path: Path) -> None:
    """Write `count` random scenes of the default study to an NPZ file: images and whole boxes."""
    from pipeline.config.composing import compose
    from pipeline.simulators.mujoco.lens import CameraSettings
    from pipeline.simulators.mujoco.random_scenes import scenes

    config = compose("default", [])
    camera = CameraSettings(**config.camera)
    images, boxes = [], []
    for town in range(count // SCENES_PER_TOWN):
        for scene in scenes(town, SCENES_PER_TOWN, config.base_set, camera, {}):
            images.append(scene.image)
            boxes.append(scene.truth.whole_box or (np.nan,) * 4)
    np.savez_compressed(path, images=np.array(images), boxes=np.array(boxes, np.float64))


def main(arguments: list[str]) -> int:
    """Print the comparison; exit code 1 if anything differs."""
    count = int(arguments[0]) if arguments else 200
    with tempfile.TemporaryDirectory() as folder:
        for backend in BACKENDS:
            path = f"{folder}/{backend}.npz"
            command = [sys.executable, __file__, "--render", str(count), path]
            subprocess.run(command, env={**os.environ, "MUJOCO_GL": backend}, check=True)
        first, second = (np.load(f"{folder}/{backend}.npz") for backend in BACKENDS)
        difference = np.abs(first["images"].astype(int) - second["images"].astype(int))
        same_boxes = np.array_equal(first["boxes"], second["boxes"], equal_nan=True)
    different_images = int((difference.max(axis=(1, 2, 3)) > 0).sum())
    print(f"images that differ: {different_images} of {len(difference)}")
    print(f"values that differ: {np.mean(difference > 0):.4%}, by {difference.max()} at most")
    print(f"boxes: {'the same' if same_boxes else 'different'}")
    return int(different_images > 0 or not same_boxes)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--render"]:
        render(int(sys.argv[2]), Path(sys.argv[3]))
    else:
        sys.exit(main(sys.argv[1:]))
