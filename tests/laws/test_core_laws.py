"""Laws that hold for any input: bounds, symmetry, round trips, monotone coverage."""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.core.boxes import iou, nms
from pipeline.core.constraints import Constraints, Literal
from pipeline.core.coverage.arrays import covering_array
from pipeline.core.coverage.projection import Demand, projection_coverage
from pipeline.core.coverage.verification import verify
from pipeline.core.detections import Detections
from pipeline.core.distance import mixed_distance
from pipeline.core.matching import match
from pipeline.core.measures import f_measure, failure_sequence
from pipeline.core.statistics import mcnemar, paired_rise_limit, wilson_interval
from pipeline.core.truth import Truth
from tests.spaces import SMALL

pytestmark = pytest.mark.usefixtures("short_annealing")

SEEDS = st.integers(0, 2**32 - 1)
SIZES = st.lists(st.integers(1, 5), min_size=2, max_size=5)


def random_boxes(rng: np.random.Generator, count: int) -> np.ndarray:
    corner = rng.uniform(0, 50, (count, 2))
    return np.column_stack([corner, corner + rng.uniform(1, 30, (count, 2))])


@given(SEEDS, st.integers(0, 8))
def test_iou_is_symmetric_bounded_and_one_with_itself(seed: int, count: int) -> None:
    boxes = random_boxes(np.random.default_rng(seed), count)
    overlaps = iou(boxes, boxes)
    assert (
        np.array_equal(overlaps, overlaps.T) and ((overlaps >= 0) & (overlaps <= 1 + 1e-12)).all()
    )
    assert np.allclose(np.diag(overlaps), 1)


@given(SEEDS, st.integers(0, 12), st.floats(0, 1))
def test_suppression_keeps_exactly_the_boxes_without_a_better_overlapping_one(
    seed: int, count: int, threshold: float
) -> None:
    rng = np.random.default_rng(seed)
    boxes, scores = random_boxes(rng, count), rng.random(count)
    kept = nms(boxes, scores, threshold)
    overlaps = iou(boxes, boxes)
    assert (np.diff(scores[kept]) <= 0).all()
    for i in range(count):
        rivals = [
            k for k in kept if k != i and scores[k] > scores[i] and overlaps[i, k] > threshold
        ]
        assert bool(rivals) != (i in kept)


@given(SEEDS, st.integers(0, 10))
def test_each_frame_has_at_most_one_true_positive_and_every_detection_an_outcome(
    seed: int, count: int
) -> None:
    rng = np.random.default_rng(seed)
    box = (20.0, 20.0, 40.0, 60.0)
    boxes = np.array(box) + rng.normal(0, 8, (count, 4))
    detections = Detections(
        boxes.astype(np.float32), np.sort(rng.random(count).astype(np.float32))[::-1]
    )
    result = match(
        detections, Truth(box, box, int(rng.integers(0, 60)), 800, float(rng.uniform(0, 16)))
    )
    outcomes = result.outcomes
    assert len(outcomes) == count and outcomes.count("true_positive") <= 1
    assert (
        result.false_positives + outcomes.count("true_positive") + outcomes.count("ignored")
        == count
    )
    assert "duplicate" not in outcomes or "true_positive" in outcomes


@given(SEEDS)
def test_distance_is_a_bounded_metric(seed: int) -> None:
    points = SMALL.sample(6, np.random.default_rng(seed))
    d = mixed_distance(SMALL, points, points)
    assert np.allclose(d, d.T) and np.allclose(np.diag(d), 0) and ((d >= 0) & (d <= 1)).all()
    assert (d[:, None, :] <= d[:, :, None] + d[None, :, :] + 1e-12).all()


@given(SEEDS)
def test_points_survive_decoding_and_encoding(seed: int) -> None:
    for point in SMALL.sample(5, np.random.default_rng(seed)):
        assert np.array_equal(SMALL.encode(SMALL.decode(point)), point)


@given(SEEDS)
def test_a_representative_lies_in_its_category(seed: int) -> None:
    categories = SMALL.categorise(SMALL.sample(20, np.random.default_rng(seed)))
    assert np.array_equal(SMALL.categorise(SMALL.representatives(categories)), categories)


@given(SEEDS, SIZES)
@settings(max_examples=40)
def test_coverage_grows_with_points_and_never_passes_one(seed: int, sizes: list[int]) -> None:
    rng = np.random.default_rng(seed)
    points = rng.integers(0, sizes, (30, len(sizes)))
    covered = [
        projection_coverage(points[:n], Demand(Constraints(tuple(sizes)), 2)).ratio
        for n in (0, 1, 10, 30)
    ]
    assert covered[0] == 0 and covered == sorted(covered) and covered[-1] <= 1


@st.composite
def constrained(draw: st.DrawFn) -> Constraints:
    """Up to six clauses of up to three literals over a few small variables."""
    sizes = tuple(draw(st.lists(st.integers(1, 4), min_size=2, max_size=5)))

    def literal() -> Literal:
        variable = draw(st.integers(0, len(sizes) - 1))
        return Literal(variable, draw(st.integers(0, sizes[variable] - 1)), draw(st.booleans()))

    clauses = []
    for _ in range(draw(st.integers(0, 6))):
        clauses.append(tuple(literal() for _ in range(draw(st.integers(1, 3)))))
    return Constraints(sizes, tuple(clauses))


@given(constrained(), st.integers(1, 3))
@settings(max_examples=80)
def test_feasible_cells_and_contradictions_agree_with_brute_force(
    constraints: Constraints, k: int
) -> None:
    every = np.array(list(product(*map(range, constraints.sizes))))
    feasible = every[constraints.holds(every)]
    for plane in combinations(range(len(constraints.sizes)), min(k, len(constraints.sizes))):
        expected = np.zeros([constraints.sizes[v] for v in plane], bool)
        expected[tuple(feasible[:, list(plane)].T)] = True
        assert np.array_equal(constraints.feasible_cells(plane), expected)
    core = constraints.contradiction()
    assert bool(core) == (len(feasible) == 0)
    for left_out in core:
        fewer = tuple(constraints.clauses[i] for i in core if i != left_out)
        assert Constraints(constraints.sizes, fewer).holds(every).any()


@given(constrained(), st.integers(1, 3), st.integers(0, 99))
@settings(max_examples=40)
def test_constrained_arrays_pass_the_verifier(
    constraints: Constraints, strength: int, seed: int
) -> None:
    strength = min(strength, len(constraints.sizes))
    if constraints.contradiction():
        return
    array = covering_array(constraints, strength, seed=seed)
    checked = verify(array.rows, constraints, strength)
    assert checked.valid and checked.cells == array.cells and array.lower_bound <= array.size


@given(SEEDS, SIZES)
@settings(max_examples=40)
def test_covering_arrays_cover(seed: int, sizes: list[int]) -> None:
    rows = covering_array(Constraints(tuple(sizes)), seed=seed).rows
    assert projection_coverage(rows, Demand(Constraints(tuple(sizes)), 2)).ratio == 1
    first, second = sorted(sizes)[-2:]
    assert len(rows) >= first * second


@given(st.lists(st.booleans()), st.integers(1, 10))
def test_the_f_measure_is_the_test_at_which_the_sequence_reaches_n(
    failures: list[bool], n: int
) -> None:
    theta = failure_sequence(failures)
    needed = f_measure(theta, n)
    if needed is None:
        assert sum(failures) < n
    else:
        assert failures[needed - 1] and theta[needed - 1] == n


@given(st.integers(0, 200), st.integers(0, 200))
def test_the_wilson_interval_contains_the_share(successes: int, others: int) -> None:
    trials = successes + others
    low, high = wilson_interval(successes, trials)
    assert 0 <= low <= high <= 1
    assert trials == 0 or low <= successes / trials <= high


@given(st.lists(st.tuples(st.booleans(), st.booleans())))
def test_mcnemar_is_symmetric(tests: list[tuple[bool, bool]]) -> None:
    before, after = [b for b, _ in tests], [a for _, a in tests]
    there, back = mcnemar(before, after), mcnemar(after, before)
    assert (there.fixes, there.regressions) == (back.regressions, back.fixes)
    assert there.p_value == back.p_value and 0 < there.p_value <= 1


@given(
    st.integers(0, 60), st.integers(0, 60), st.integers(0, 60), st.sampled_from([0.8, 0.95, 0.99])
)
def test_the_rise_limit_rises_with_regressions_and_falls_with_fixes(
    regressions: int, fixes: int, others: int, confidence: float
) -> None:
    tests, rounding = regressions + fixes + others, 1e-12
    limit = paired_rise_limit(regressions, fixes, tests, confidence)
    assert -1 <= limit <= 1
    assert tests == 0 or limit >= (regressions - fixes) / tests - rounding
    if others:
        assert paired_rise_limit(regressions + 1, fixes, tests, confidence) >= limit - rounding
        assert paired_rise_limit(regressions, fixes + 1, tests, confidence) <= limit + rounding
        assert paired_rise_limit(regressions, fixes, tests, 0.999) >= limit - rounding
