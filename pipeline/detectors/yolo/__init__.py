"""A small detector: network, training, export. The only room that needs PyTorch.

`network` and `loss` define the detector, `training` fits it, `recipe` trains from scratch and
`retraining` continues, `weights` and `export` read and write files.
"""
