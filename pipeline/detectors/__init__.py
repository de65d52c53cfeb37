"""Detectors: adapters of foreign models, scripted stand-ins and, in `yolo`, a network of ours.

A detector takes a frame and returns pedestrians with scores. `onnx`, `ultralytics` and
`hugging_face` run files, `function` any Python function, `scripted` reads the ground truth.
`evaluation` measures detectors and fits their calibration, which `calibrated` applies.
"""
