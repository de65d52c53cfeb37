"""Blindspot finds, explains and fixes the blind spots of a camera detector."""

from importlib.metadata import version

__version__ = version("blindspot")
