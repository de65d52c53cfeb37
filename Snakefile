# Finds, explains and fixes the blind spots of a camera detector: the study in params.yaml.
from pipeline.workflow.guards import checked, fail
from pipeline.workflow.plan import lift_default_limit, plan

if not workflow.configfiles:

    configfile: checked("params.yaml")


# In the order of the data. pipeline/steps/<name>.py has the declaration of a step.
PLAN = plan(
    config,
    workflow,
    [
        "define_space",  # the logical scenario space of each scenario
        "render_base",  # a random base set
        "train",  # D_o, the base detector
        "export",  # weights that are only tested
        "calibrate",  # the confidences of detectors that are only tested
        "shard",  # parts of large campaigns, if several machines share them
        "campaign",  # tests in closed loop: the search, later rounds, the held-out sequence
        "measure",  # how well each strategy finds failures
        "cluster",  # failure regions and their rules
        "filter",  # the frames that are fit for training
        "render_scenes",  # new random scenes, for arms that learn from them
        "white_box",  # the neurons that each strategy's frames reach
        "retrain",  # D_r, D_a and the control
        "second_iou",  # the held-out sequence at another IoU
        "compare",  # every version on the held-out sequence
        "report",  # one page with plots and films
        "evidence",  # what a safety case may cite
        "track",  # MLflow
        "detector_report",  # the page of a detector that is only tested
        "front_car_points",  # the front-car study: points to full coverage
        "front_car_snapshots",  # their images
        "front_car_train",  # a detector of the car ahead
        "front_car_evaluate",  # what it gains from the proposed points
        "front_car_report",  # its page
    ],
)


rule all:
    input:
        PLAN.jobs.folders.goals,


include: "pipeline/rules/targets.smk"
include: "pipeline/rules/steps.smk"


onstart:
    lift_default_limit(workflow)


onsuccess:
    PLAN.finish(workflow.dag_settings)


onerror:
    fail()
