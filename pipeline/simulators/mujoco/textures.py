"""Procedural textures: seeds paint every surface, so the repository holds no images."""

from __future__ import annotations

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]


def noise(
    shape: tuple[int, int], rng: np.random.Generator, octaves: int = 4
) -> NDArray[np.float64]:
    """Tileable cloud noise with mean 0 and standard deviation 1, (h, w)."""
    total = np.zeros(shape)
    for octave in range(octaves):
        cells = 4 * 2**octave
        grid = rng.normal(size=(cells, cells))
        padded = np.pad(grid, 2, mode="wrap")
        scale = shape[1] // cells
        big = cv2.resize(
            padded, None, fx=scale, fy=shape[0] // cells, interpolation=cv2.INTER_CUBIC
        )
        top, left = 2 * (shape[0] // cells), 2 * scale
        total += big[top : top + shape[0], left : left + shape[1]] / 1.7**octave
    return np.asarray((total - total.mean()) / total.std())


def tinted(base: Colour, pattern: NDArray[np.float64], strength: float) -> Image:
    """A colour modulated by a pattern, (h, w, 3)."""
    return np.clip(np.array(base) + strength * pattern[..., None], 0, 255).astype(np.uint8)


def asphalt(tone: int, rng: np.random.Generator, size: int = 256) -> Image:
    """Asphalt with patches, cracks and grain."""
    image = tinted(
        (tone, tone, tone + 3),
        0.6 * noise((size, size), rng) + 0.8 * rng.normal(size=(size, size)),
        6,
    )
    for _ in range(3):
        start = rng.integers(0, size, 2)
        path = np.cumsum(rng.integers(-9, 10, (14, 2)), axis=0) + start
        cv2.polylines(image, [path.astype(np.int32)], False, (tone - 22,) * 3, 1, cv2.LINE_AA)
    return image


def paving(base: Colour, slabs: int, rng: np.random.Generator, size: int = 128) -> Image:
    """Paving slabs with joints."""
    image = tinted(
        base, 0.5 * noise((size, size), rng) + 0.5 * rng.normal(size=(size, size)), 8
    ).astype(int)
    step = size // slabs
    for row in range(slabs):
        for column in range(slabs):
            image[row * step : (row + 1) * step, column * step : (column + 1) * step] += (
                rng.integers(-9, 10)
            )
    image[::step] -= 35
    image[:, ::step] -= 35
    return np.asarray(np.clip(image, 0, 255), np.uint8)


def foliage(base: Colour, rng: np.random.Generator, size: int = 128) -> Image:
    """Leaves: coarse light and dark clumps and fine speckle."""
    clumps = noise((size, size), rng, octaves=5)
    speckle = rng.normal(size=(size, size))
    return tinted(base, 1.3 * clumps + 0.9 * speckle, 14)


def grass(rng: np.random.Generator, size: int = 128) -> Image:
    """A lawn."""
    return tinted((82, 108, 56), noise((size, size), rng) + 0.7 * rng.normal(size=(size, size)), 9)


def roof(base: Colour, rng: np.random.Generator, size: int = 128) -> Image:
    """Roof tiles in rows."""
    image = tinted(base, noise((size, size), rng), 7).astype(int)
    image[:: size // 16] -= 28
    return np.asarray(np.clip(image, 0, 255), np.uint8)


def storeys(wall: Colour, brick: bool, rng: np.random.Generator, size: int = 256) -> Image:
    """Two storeys of two window bays, 6 m by 6 m, tileable."""
    image = tinted(wall, noise((size, size), rng), 5).astype(int)
    if brick:
        image[:: size // 64] -= 16
        image += rng.integers(-7, 8, (size // 4, size // 4, 1)).repeat(4, 0).repeat(4, 1)
    image = np.asarray(np.clip(image, 0, 255), np.uint8)
    bay = size // 2
    for row in range(2):
        for column in range(2):
            left, top = column * bay + int(bay * 0.29), row * bay + int(bay * 0.24)
            _window(image, (left, top), (int(bay * 0.42), int(bay * 0.52)), rng)
    return image


def _window(
    image: Image, corner: tuple[int, int], size: tuple[int, int], rng: np.random.Generator
) -> None:
    """Draw a window; corner: left and top of the glass, size: its width and height, pixels."""
    (left, top), (width, height) = corner, size
    frame = (228, 226, 220) if image.mean() < 190 else (120, 110, 100)
    cv2.rectangle(image, (left - 4, top - 4), (left + width + 4, top + height + 4), frame, -1)
    cv2.rectangle(
        image,
        (left - 7, top + height + 4),
        (left + width + 7, top + height + 8),
        (150, 146, 140),
        -1,
    )
    glass = np.linspace(95, 45, height)[:, None] + rng.integers(-15, 16)
    image[top : top + height, left : left + width] = np.stack(
        [glass * 0.8, glass * 0.95, glass * 1.1], -1
    )
    if rng.random() < 0.5:
        curtain = int(width * rng.uniform(0.15, 0.35))
        image[top : top + height, left : left + curtain] = (196, 190, 178)
        image[top : top + height, left + width - curtain : left + width] = (196, 190, 178)
    cv2.line(image, (left + width // 2, top), (left + width // 2, top + height), frame, 2)


def ground_floor(
    wall: Colour, shops: bool, rng: np.random.Generator, height: int = 128, width: int = 512
) -> Image:
    """One ground floor, 3.5 m by 14 m: shop fronts with awnings, or doors and windows."""
    image = tinted(wall, noise((height, width), rng), 5)
    units = 4
    for unit in range(units):
        left, span = unit * width // units, width // units
        if shops:
            colour = tuple(int(c) for c in rng.integers(40, 200, 3))
            cv2.rectangle(image, (left + 8, 40), (left + span - 8, height - 12), (40, 48, 54), -1)
            cv2.rectangle(
                image, (left + 12, 46), (left + span - 42, height - 18), (92, 104, 108), -1
            )
            cv2.rectangle(
                image, (left + span - 36, 46), (left + span - 14, height - 12), (70, 62, 56), -1
            )
            cv2.rectangle(image, (left + 6, 22), (left + span - 6, 38), colour, -1)
            for letter in range(left + 22, left + span - 26, 9):
                cv2.rectangle(image, (letter, 27), (letter + 5, 33), (235, 230, 215), -1)
        elif unit % 2:
            cv2.rectangle(
                image,
                (left + span // 2 - 18, 40),
                (left + span // 2 + 18, height),
                (86, 60, 42),
                -1,
            )
            cv2.rectangle(
                image, (left + span // 2 - 12, 48), (left + span // 2 + 12, 74), (120, 130, 132), -1
            )
        else:
            _window(image, (left + span // 2 - 26, 42), (52, 48), rng)
    return image


def bus_side(colour: Colour, rng: np.random.Generator, height: int = 96, width: int = 384) -> Image:
    """The flank of a city bus, 9 m by 2.7 m: window band, doors, stripe."""
    image = np.full((height, width, 3), colour, np.uint8)
    image[64:70] = (238, 236, 230)
    for window in range(7):
        left = 10 + window * 53
        cv2.rectangle(image, (left, 14), (left + 46, 52), (38, 46, 52), -1)
        cv2.line(image, (left + 8, 46), (left + 26, 18), (84, 96, 104), 3)
    for door in (60, 220):
        cv2.rectangle(image, (door, 12), (door + 40, height - 6), (30, 36, 40), -1)
        cv2.line(image, (door + 20, 12), (door + 20, height - 6), (120, 120, 120), 2)
    return np.clip(image + rng.normal(0, 2, image.shape), 0, 255).astype(np.uint8)


def bus_end(colour: Colour, front: bool, height: int = 96, width: int = 96) -> Image:
    """Front or rear of a city bus, 2.5 m by 2.7 m."""
    image = np.full((height, width, 3), colour, np.uint8)
    cv2.rectangle(image, (8, 14), (width - 8, 56 if front else 44), (36, 44, 50), -1)
    cv2.rectangle(image, (22, 3), (width - 22, 11), (235, 170, 40) if front else (60, 60, 60), -1)
    cv2.rectangle(image, (36, 78), (60, 86), (236, 234, 224), -1)
    lamp = (240, 240, 225) if front else (170, 20, 20)
    for left in (8, width - 20):
        cv2.rectangle(image, (left, 66), (left + 12, 76), lamp, -1)
    return image


def add(
    spec: mujoco.MjSpec,
    name: str,
    image: Image,
    repeat: tuple[float, float] = (1, 1),
    **material: object,
) -> None:
    """Declare a texture and the material of the same name that shows it."""
    height, width = image.shape[:2]
    texture = spec.add_texture(
        name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=width, height=height, nchannel=3
    )
    texture.data = np.ascontiguousarray(image).tobytes()
    declared = spec.add_material(
        name=name, texrepeat=repeat, **{"specular": 0.0, "shininess": 0.2, **material}
    )
    declared.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
