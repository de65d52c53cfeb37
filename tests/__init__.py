"""The tests. The first import chooses the GL backend, before any of them imports MuJoCo."""

import pipeline.simulators.mujoco  # noqa: F401
