"""Faults on purpose: wrong configs, flipped bits, kills, a failing cluster; and their one table."""
