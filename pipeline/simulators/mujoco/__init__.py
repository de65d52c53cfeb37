"""The MuJoCo world: towns, road users, weather, camera and the closed loop. MuJoCo is imported here alone."""

from pipeline.simulators.gl import choose_backend

choose_backend()  # MuJoCo reads MUJOCO_GL when it is first imported, so this comes before every other module here.
