"""Policies as ONNX graphs, with the metadata that deployment stacks read.

ONNX is an optional package: `pip install "glassgait[onnx]"`.
"""
