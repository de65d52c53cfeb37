"""Combinatorial coverage: measuring it, completing it, and covering arrays.

`projection` measures the k-projection coverage of points, `proposals` and `completion` say which
points to add, `arrays` and `certified` search for small covering arrays, and `verification` checks
them. `whitebox` measures how much of a network's behaviour images trigger.
"""
