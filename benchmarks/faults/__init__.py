"""Faults on purpose: wrong configs, flipped bits, kills, repairs, a failing cluster, and one table."""
