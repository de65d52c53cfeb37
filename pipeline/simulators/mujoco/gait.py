"""The six animations of thesis Eq. 5.1 as joint trajectories over the gait cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.scenarios.people import Blueprint

ANIMATIONS = ("walking", "texting", "crouching", "limping", "drunk", "stumble")
JOINTS = (
    "pitch",
    "roll",
    "waist",
    "neck",
    "shoulder_l",
    "shoulder_r",
    "spread_l",
    "spread_r",
    "elbow_l",
    "elbow_r",
    "hip_l",
    "hip_r",
    "knee_l",
    "knee_r",
    "ankle_l",
    "ankle_r",
)
REFERENCE_HEIGHT_M = 1.75
STRIDE_AT_REST_M, STRIDE_PER_SPEED_S = 0.7, 0.5
LEG_M = 0.85
"""Hip to ankle at the reference height."""
STANDING_BELOW_MPS = 0.2


@dataclass(frozen=True)
class Posture:
    """Joint angles in radians, and the change of the hips' height in metres, at most 0.

    The height is that of a person of the reference height.
    """

    angles: dict[str, float]
    drop: float = 0.0


def phase(distance_m: float, speed_mps: float, walker: Blueprint) -> float:
    """Gait phase in radians after a walking distance.

    One cycle is one stride, which grows with speed.

    The phase depends on distance, not time, so the feet do not slide and a pedestrian at speed 0
    stands still.
    """
    return 2 * np.pi * distance_m / stride(speed_mps, walker)


def stride(speed_mps: float, walker: Blueprint) -> float:
    """Metres of one gait cycle, two steps: it grows with speed and with the walker's height."""
    return (
        walker.stride
        * (STRIDE_AT_REST_M + STRIDE_PER_SPEED_S * speed_mps)
        * walker.height
        / REFERENCE_HEIGHT_M
    )


def pose(animation: str, phase_rad: float, speed_mps: float, walker: Blueprint) -> Posture:
    """Posture of an animation at a phase of the gait cycle.

    The swing of the legs matches the stride, so the foot on the ground stays put.
    """
    leg_m = LEG_M * walker.height / REFERENCE_HEIGHT_M
    swing = min(1.0, speed_mps / STANDING_BELOW_MPS)
    reach = swing * float(np.arcsin(min(1.0, stride(speed_mps, walker) / (4 * leg_m))))
    angles = dict.fromkeys(JOINTS, 0.0)
    # Each leg stands for half of the cycle, turning back evenly under the hips. In the other half
    # it swings forward, bent.
    drop = 0.0
    for side, q in (("l", phase_rad), ("r", phase_rad + np.pi)):
        angles[f"hip_{side}"] = -reach * float(2 / np.pi * np.arcsin(np.sin(q)))
        angles[f"knee_{side}"] = 0.06 + 1.5 * reach * max(0.0, float(np.cos(q - 0.2))) ** 2
        angles[f"ankle_{side}"] = -0.5 * (angles[f"hip_{side}"] + angles[f"knee_{side}"])
        if np.cos(q) <= 0:
            drop = -LEG_M * (1 - float(np.cos(angles[f"hip_{side}"])))
    _arms(angles, phase_rad, walker.arm_swing * reach)
    drop += _CHARACTERS[animation](angles, phase_rad, min(1.0, speed_mps / 1.6))
    angles["waist"] += walker.stoop
    return Posture(angles, drop)


def _arms(a: dict[str, float], p: float, swing: float) -> None:
    """Each arm swings against its leg."""
    for side, q in (("l", p), ("r", p + np.pi)):
        a[f"shoulder_{side}"] = 0.9 * swing * float(np.sin(q))
        a[f"elbow_{side}"] = -0.2 - 0.5 * swing


def _walking(a: dict[str, float], p: float, swing: float) -> float:
    a["waist"] = 0.04
    return 0.0


def _texting(a: dict[str, float], p: float, swing: float) -> float:
    a.update(shoulder_r=-0.55, elbow_r=-1.55, shoulder_l=-0.45, elbow_l=-1.5, neck=0.55, waist=0.08)
    return 0.0


def _crouching(a: dict[str, float], p: float, swing: float) -> float:
    for side in "lr":
        a[f"hip_{side}"] -= 1.25
        a[f"knee_{side}"] += 1.6
        a[f"ankle_{side}"] = -0.35
    a.update(waist=0.75, neck=-0.4)
    return -0.3


def _limping(a: dict[str, float], p: float, swing: float) -> float:
    a["hip_l"] *= 0.35
    a["knee_l"] = 0.03
    a.update(roll=0.13 * swing * np.cos(p), waist=0.16)
    return float(-0.03 * swing * max(0.0, np.sin(p)))


def _drunk(a: dict[str, float], p: float, swing: float) -> float:
    a.update(
        roll=0.2 * np.sin(0.5 * p),
        pitch=0.14 * np.cos(0.37 * p),
        neck=0.3 * np.sin(0.3 * p),
        spread_l=0.55,
        spread_r=-0.5,
    )
    return 0.0


def _stumble(a: dict[str, float], p: float, swing: float) -> float:
    a.update(
        pitch=0.3 + 0.15 * np.sin(p),
        waist=0.4,
        neck=-0.3,
        shoulder_l=-1.2,
        shoulder_r=-0.9,
        spread_l=0.3,
        spread_r=-0.3,
    )
    a["knee_l"] += 0.45
    return -0.07


_CHARACTERS = {
    "walking": _walking,
    "texting": _texting,
    "crouching": _crouching,
    "limping": _limping,
    "drunk": _drunk,
    "stumble": _stumble,
}
