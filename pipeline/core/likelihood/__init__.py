"""Failure rates on the road: three estimators, and intervals that hold.

`monte_carlo`, `subset` and `importance` choose their own tests, `reweighted` reuses uniform ones,
and `rate` has the intervals and the sentence that a report prints.
"""
