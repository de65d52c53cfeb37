"""Worlds: `analytic` is a formula, `mujoco` renders. Each implements `pipeline.protocols.World`."""
