"""The MuJoCo world: towns, road users, weather and camera. Only this package imports MuJoCo."""

from pipeline.simulators.gl import choose_backend, load_triton_first

# MuJoCo reads MUJOCO_GL and loads OpenGL at its first import, so these come before it.
choose_backend()
load_triton_first()
