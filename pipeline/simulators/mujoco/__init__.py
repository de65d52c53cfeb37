"""The MuJoCo world: towns, road users, weather, camera and the closed loop.

Only this package imports MuJoCo.
"""

from pipeline.simulators.gl import choose_backend

choose_backend()  # Before every other module here: MuJoCo reads MUJOCO_GL at its first import.
