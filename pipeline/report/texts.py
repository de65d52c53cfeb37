"""The report's prose: how to read each section, table and figure."""

from __future__ import annotations

from pipeline.analysis.evidence_texts import FITTED, ROAD_USERS, SIMULATED


def _prose(text: str) -> str:
    return " ".join(text.split())


VERDICT = _prose("""
    All versions run the same frozen list of held-out tests. No retraining and no search uses the
    held-out scenarios.
""")
CONTROL = _prose("""
    control gets the same extra training steps as random and adaptive, but no new data. Its changes
    come from longer training, not from data.
""")
MODES = _prose("""
    A test fails when its adjusted time-to-collision (adj. TTC) is at or below the threshold. Adj.
    TTC is the TTC divided by one plus the number of false positives (Eq. 5.3). "By TTC alone"
    counts the failures that remain without this division.
""")
CAUSES = _prose("""
    Every failure has one cause. Never seen: no reported box touches the pedestrian, and no weaker
    one fits it. The next three judge the frames in which a person could see the pedestrian and
    braking would still have helped; the most frequent one counts. Too late: no detection, or the
    brake follows too late or too weakly. Box disagrees: a box on the pedestrian that does not fit.
    Confidence too low: a fitting box that is not reported. False positives: Eq. 5.3 alone makes the
    failure. Not solvable by the camera: no such frame comes in time. Unnecessary braking: emergency
    braking without a collision path.
""")
BRAKING = _prose("""
    In these scenarios the right answer is not to brake. A false activation (unnecessary braking) is
    a run of frames that demand at least 5 m/s² without a collision path. A test with one is a
    failure. Mean duration: per false activation. Mean speed loss: per test with one.
""")
SECOND_IOU = _prose("""
    Detections match the pedestrian above an IoU of {first:g}. Does the verdict depend on it? Here,
    the same tests are judged at {second:g} from their stored detections. Those in which the car
    would have braked differently are executed again.
""")
TABLE = _prose("""
    Failures on each held-out scenario. A test that ended in an error for any version is left out.
    Versions retrained with several seeds have the mean over the seeds with Student's interval.
    Single versions, such as base, have a count without an interval, because the held-out tests are
    a designed list, not a random sample. The p-values compare versions test by test. For
    orientation, thesis Table 7.2 counts D_o (base) 21, 69, 40, 25; D_r (random) 11, 5, 44, 6; D_a
    (adaptive) 6, 4, 25, 3 on F1* to F4*. The thesis uses another simulator, detector, search and
    number of tests.
""")
PLANTED = _prose("""
    People and poses that the base set shows rarely, so we know what a search ought to find.
    Frequency: relative to others. Search: failures / tests of the group in the campaigns. Named by:
    failure regions, by scenario, with a rule that holds for this group alone. Held out: failures /
    tests of the group on the held-out sequence.
""")
LIMITS = _prose("""
    How far a version's failure rate may be above that of {base}: one-sided upper {confidence:g} %
    limit of the rise (Tango's score method for pairs). It treats the tests as a sample of tests
    like these. The gate holds a version back above {allowed:.3g} points, {margin:g} of the failure
    rate of {base}. It also does if the version is significantly worse there (exact McNemar test
    with Holm's correction for all scenarios and groups). Too small: even without any difference, so
    few tests could not show a rise within the margin. Such scenarios and groups hold no version
    back. Groups pool the scenarios and overlap.
""")
PAIRS = _prose("""
    Fixes: tests that the version passes and the other one ("against") fails. Regressions: the
    reverse. p: exact McNemar test on the tests that both completed.
""")
GROUP_PAIRS = _prose("""
    Difference: mean over the seeds of retraining with Student's interval, paired by seed. It covers
    the variation between trainings. p: exact randomisation test over the tests, seeds summed. It
    covers the variation between tests. A difference is shown only if p is at most {alpha:g} and the
    interval excludes 0. Neither covers the variation between searches if all seeds share one, as
    with `retraining.searches: all`.
""")
ROUNDS = _prose("""
    Each round searches with the newest versions, filters the frames and retrains. control gets the
    same training steps without new data. The table lists the failures that each search found in all
    search scenarios together.
""")
HELD_OUT_REGIONS = _prose("""
    Regions in which {base} fails on the held-out sequence, and how many tests inside each rule each
    version fails (mean over seeds). The rules are fitted to the failures of {base}. This alone
    makes every other version look better inside them.
""")
CHANGES = _prose("""
    Tests whose outcome differs between {base} and {of}, regressions first: {shown} of {chosen}.
    changes.csv has all {all} changes of all versions.
""")
NO_FIX = _prose("""
    No fix can be shown: no other version shown here passes a held-out test that {base} fails.
""")
NO_FAILURE = _prose("""
    No fix can be shown: {base} fails no held-out test.
""")
STILLS = _prose("""
    More held-out tests that the upper version fails and the lower one passes. Both see the same
    camera image. Blue: the true pedestrian. Red: the detections with their confidence.
""")
FIRST = _prose("""
    Blue: the true pedestrian. Red: the detections with their confidence. The same test with both
    versions.
""")
PAIR = _prose("""
    A regression: the same concrete scenario with both versions, side by side. Blue: the true
    pedestrian. Red: the detections with their confidence. Purple line: TTC divided by one plus the
    false positives so far.
""")
SEARCH = _prose("""
    Every strategy had the same number of tests to find failures. Intervals are {confidence:g} %.
    The failure rate of random testing has the exact interval over all its tests, because they are
    independent samples of the space. The tests of other strategies depend on each other. Their
    rates, and all other values, have Student's interval over seeds, and none with one seed.
""")
MEASURES = _prose("""
    Base failure rate: failures / tests of the searched version among random tests of the scenario,
    which no search chose. F: tests until the first failure. C: share of tests saved compared with
    {baseline}, for as many failures as {baseline} found. 1 is best; below 0 is slower than
    {baseline}. If {baseline} found none, the test after its last one counts as its first failure.
    Censored: a campaign that ended before it found so many failures. It counts as needing more
    tests than it had (Kaplan-Meier, mean restricted to the longest campaign). If all are censored,
    F is larger and C smaller than shown.
""")
COVERAGE = _prose("""
    Pairs: share of all pairs of variable categories that at least one test, or one failure, covers.
    Pairs tested three times: the same, but each pair counts up to three tests.
""")
WHITE_BOX = _prose("""
    Response of the base detector's {neurons} neurons to the images of each strategy, compared with
    {images} training images. A neuron is a channel of one of the {layers} convolution units; its
    activation is the mean of its map. Active neurons: active at least once. Sections: tenths of the
    neurons' training ranges that are reached. Strongly active: at least as active as in any
    training image. Top: among the two most active neurons of the layer. Pairs: two neurons of a
    layer active together. Full coverage does not mean that everything is tested.
""")
REGIONS = _prose("""
    A region is a group of failures, of one cause if possible, that a rule sets apart from the
    passing tests. Failures in no region are isolated. "every test" means that (nearly) all tests
    fail. Lift: the share of failures inside the rule, divided by that of all tests. The rule is
    fitted to these tests, and the search gathers tests near failures. So the share of failures
    inside is optimistic and has no interval. Held back: the same share for rules that are fitted
    without the tests they are judged on. A rule is confirmed if fresh random tests inside it fail
    significantly more often than those just outside. A failure is not solvable if full braking
    comes too late from every frame in which a person could see the pedestrian. No single-image
    detector can fix such a failure with this camera. Covered by the rule: share of the region's
    failures. Fresh tests: failures / tests with exact intervals. Pictures: a decisive moment of up
    to four failures, as the campaign saw it. Blue: the true pedestrian. Red: detections with their
    score; dashed ones are below the detector's threshold. Bars: failures of the region that pass
    with this one change, all else being equal, the noise of the camera included; with exact
    intervals. "Other noise" changes only the noise: a change that repairs no more than that
    explains nothing. Click a card to see its failures in the table of every test.
""")
NO_FAILURES = _prose("""
    No test failed, so there are no regions. Run more tests, or look at the smallest adj. TTC in the
    figures of the search.
""")
FRAMES = _prose("""
    The filter rejects frames in which the pedestrian is hardly visible, because a detector cannot
    learn from them. To overrule it, set filter.overrules to a CSV file with the columns
    test_id,step,keep.
""")
DETECTION = _prose("""
    Results on the validation images of the base set. Pedestrians that are too small or too faint to
    see are ignored, as COCO ignores crowds. Retrained versions were trained on other images of the
    same towns; a shipped base was not.
""")
CALIBRATION = _prose("""
    The confidences are calibrated on {images} validation images of the base set, before any test:
    calibrated logit = slope · logit + offset (Platt). Error: expected calibration error, the mean
    distance between confidence and share of correct detections. The detector's threshold applies to
    the calibrated confidence.
""")
NOT_CALIBRATED = _prose("""
    {version} could not be calibrated and keeps its confidences: all or none of its detections are
    correct, or more confident ones are not correct more often.
""")
SEEDS = _prose("""
    The same seeds, settings and files give the same tests. A test that ended in an error counts in
    no rate.
""")
NOT_SHOWN = (
    SIMULATED,
    ROAD_USERS,
    "A search samples near failures. Only random tests give a failure rate, and it holds for their "
    "conditions alone.",
    FITTED,
    "A full heat map says that each pair of categories occurred, not that the detector is safe "
    "there.",
    "The version's evidence page gives the failure rate under the chosen exposure, and the claims "
    "that it supports.",
)
EXPLORER = _prose("""
    Click a column's title to sort by it. The field below it filters: text, "a | b", "< 0.1", ">=
    40", "5 .. 10" or "= M 03". In the first plot, drag along an axis to choose a range. In the
    second, press "Choose an area" and drag a rectangle. Click a test to see it and the command that
    executes it again.
""")
FIGURES = {
    "comparison": _prose("""
        Share of the held-out tests that fail, by failure mode.
    """),
    "histogram": _prose("""
        Number of tests by adj. TTC, for base and the newest versions. Further right is safer.
    """),
    "theta": _prose("""
        Failures found after each test; steeper is better.
    """),
    "coverage": _prose("""
        Left: how much of the scenario space the tests cover. Right: how varied the failures are.
    """),
    "pairs": _prose("""
        For each pair of variables, the share of their feasible pairs of categories that the search
        covers, all strategies together. Left: in at least one test. Right: in at least one failure.
        Low numbers on the left show which combinations are untested.
    """),
    "rounds": _prose("""
        Failures on the held-out sequence after each round; round 0 is base.
    """),
    "border": _prose("""
        Frames closest to the filter's thresholds, each cropped around the pedestrian (blue box),
        with its visible pixels and its contrast in grey levels, 0 to 255. Green: kept. Red:
        rejected. Overrule the frames that you would judge otherwise.
    """),
    "detection": _prose("""
        Higher is better. A detector can be better on single images and still brake too late. The
        verdict above decides.
    """),
    "reliability": _prose("""
        How well the confidence matches the share of correct detections, on the validation images
        used for calibration. On the diagonal, eight in ten detections with confidence 0.8 are
        correct. The AEB brakes as hard as the detector is confident, so above the diagonal the car
        brakes too softly. Larger points stand for more detections; bins with fewer than ten are
        left out.
    """),
    "kpi": _prose("""
        One point per test, in order of execution. Tests at or below the dashed line fail;
        unnecessary braking fails above it, too. Solid line: mean of each batch; it should fall for
        an adaptive strategy.
    """),
    "failures": _prose("""
        One line per failure, through its value of each variable. Lines of one colour form one
        region. Where they run close together, the variable matters for the region.
    """),
}
"""By the first part of a figure's name."""
SEARCHES = {
    "theta": "The line is the mean over the seeds; the band runs from minimum to maximum.",
    "coverage": "Thin lines: intervals over seeds.",
    "kpi": "Marker shapes: seeds.",
}
"""More about a figure of searches with several seeds."""
TRAININGS = {
    "histogram": "Retrained versions: mean over the seeds of retraining.",
    "rounds": "Bars: Student's intervals over the seeds of retraining.",
}
"""More about a figure of versions retrained with several seeds."""
