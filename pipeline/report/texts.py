"""The report's prose: how to read each section, table and figure."""

from __future__ import annotations


def _prose(text: str) -> str:
    return " ".join(text.split())


VERDICT = _prose("""
    Every version was executed on the same frozen list of tests, which no version was trained on and no search has seen. control had the
    same extra training steps as random and adaptive but no new data: what it changes is due to training longer, not to the data.
""")
MODES = _prose("""
    A test fails when the adjusted time-to-collision (adj. TTC), which false positives divide (Eq. 5.3), drops to the threshold. By TTC
    alone counts the failures that would remain without that division.
""")
TABLE = _prose("""
    Failures on each held-out scenario: means over the seeds of retraining with Student's intervals; of a single version, as the base
    always is, the count with Wilson's. Beside it, what thesis Table 7.2 counts for F1* to F4* with another simulator, detector and number
    of tests: D_o 21, 69, 40, 25; D_r 11, 5, 44, 6; D_a 6, 4, 25, 3. In our words D_o is base, D_r random and D_a adaptive.
""")
PAIRS = _prose("""
    Exact McNemar tests on the tests that both executed.
""")
GROUP_PAIRS = _prose("""
    Mean difference over the seeds of retraining with Student's interval, paired by seed, which holds the luck of training; p of the exact
    sign-flip test over the tests, seeds summed, which holds the luck of the sequence. A difference is shown where both leave no doubt. All
    seeds learn from one search, whose luck neither holds.
""")
ROUNDS = _prose("""
    Each round searches the newest versions, filters what was kept and retrains; control has the same steps without new data. The table
    says what each search found, in all search scenarios together.
""")
HELD_OUT_REGIONS = _prose("""
    Where the base fails on the held-out sequence, and how many of the tests inside each rule the versions fail, means over their seeds.
    The rules were found on the base's own failures: any other version has fewer there by that alone.
""")
CHANGES = _prose("""
    Tests that one of base and {of} fails and the other passes, regressions first; shown are {shown} of the {all} of all versions in
    changes.csv.
""")
PAIR = _prose("""
    The same concrete scenario with two versions, side by side. Blue: where the pedestrian is; red: what the detector reports, with its
    score. The purple line is the time-to-collision so far, divided by the false positives so far.
""")
SEARCH = _prose("""
    Each strategy had the same number of tests to find failures of the base detector. Intervals are {confidence:g} %: Wilson's for
    rates, Student's over seeds for the others; with one seed there is no spread and only the value is shown.
""")
MEASURES = _prose("""
    F: tests until the first failure. C: share of tests saved against {baseline} to find as many failures as it found; 1 is best, below 0
    is slower; where it found none, its next test counts as one. n/a: fewer failures than that.
""")
COVERAGE = _prose("""
    Pairs: share of all pairs of variable categories that some test, or some failure, covers. Projection: the same where each pair asks
    for three tests.
""")
WHITE_BOX = _prose("""
    What the images of each strategy make the {neurons} neurons of the base detector do (channels of its {layers} convolution units, by the
    mean of their maps), against {images} training images: neurons that are active at least once, tenths of the neurons' training ranges
    that are met, neurons that are activated as much as by any training image, neurons among the two most active of their layer, pairs of a
    layer's neurons that are active together. Full coverage does not mean that everything was tested.
""")
REGIONS = _prose("""
    Failures that lie close together in the scenario space form a region. Its rule describes it in a few conditions that hold its failures
    and few passing tests. It was fitted to these very tests, so its precision is optimistic: confirm a rule with new tests inside it. Not
    solvable: full braking from the first frame on in which a person could see the pedestrian would have come too late, so that no detector
    of single images could mend it with this camera.
""")
NO_FAILURES = _prose("""
    No test failed here, so there is nothing to group: test longer, or look at the smallest adj. TTC in the figures of the search.
""")
FRAMES = _prose("""
    A frame teaches only what can be seen in it: those in which the pedestrian is hardly visible are rejected. To overrule a row, name a
    CSV with the columns test_id,step,keep in filter.overrules.
""")
DETECTION = _prose("""
    On the validation images of the base set; pedestrians too small or too faint to see are ignored, as COCO ignores crowds. Retrained
    versions have learnt other images of the same towns, a shipped base has not.
""")
FIGURES = {
    "comparison": _prose("""
        Share of the held-out tests that fail, by failure mode; the line is the confidence interval of the whole bar.
    """),
    "histogram": _prose("""
        How close the tests came, base and the newest versions: number of tests by adj. TTC, a mean where there are several seeds of
        retraining; the further to the right, the safer.
    """),
    "theta": _prose("""
        Failures found after each test; steeper is better. The line is the mean over seeds, the band runs from the least to the most.
    """),
    "coverage": _prose("""
        Left: how much of the scenario space was looked at. Right: how varied the failures are. The thin lines are intervals over seeds.
    """),
    "rounds": _prose("""
        Tests of the held-out sequence that fail after each round; 0 is the base. Bars are Student's intervals over the
        seeds of retraining, of single versions Wilson's.
    """),
    "border": _prose("""
        Frames nearest to the filter's thresholds, in the middle of each crop the pedestrian: green ones were kept, red ones rejected.
        Overrule what you would have judged otherwise.
    """),
    "detection": _prose("""
        Higher is better. A detector can be better in single images and still brake too late: the verdict above is what counts.
    """),
    "reliability": _prose("""
        What a confidence is worth on the validation images, on which it was calibrated: on the diagonal, of the detections with confidence
        0.8 eight in ten are right.
        The AEB brakes as hard as the detector is confident, so a line above the diagonal is a car that brakes too softly. Larger points
        stand for more detections; tenths of the scale with fewer than ten are left out.
    """),
    "kpi": _prose("""
        One point a test, in the order of execution; at or under the dashed line it fails. Marker shapes are seeds. The solid line is the
        mean of each batch: an adaptive strategy should drift down.
    """),
    "failures": _prose("""
        One line a failure, through its value of each variable. Lines of one colour are one region: where they run together, the variable
        matters to it.
    """),
}
"""By the first part of a figure's name."""
